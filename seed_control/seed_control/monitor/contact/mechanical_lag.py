# SPDX-License-Identifier: Apache-2.0
"""Whether a deflection is late by the clock, or by the grasp: membranes stiffen, slide and stick.

What the grasp does depends on the gripper's way, whatever its speed; a clock's lag grows with the speed. So the way
gets everything that a grasp could do besides following in proportion: a curve that bends, and friction, which holds
back by a bounded amount after each turn (`stuck`). A lag is sure only if all of it, without one, is far worse.
"""

import numpy as np

from seed_core.spatial import Array

_BEND, _STUCK = 0.3, 0.3  # deviations: of the deflection, at the end of the way; of the way's share until it slides
_REACHES = 0.1, 0.3  # of the way, after which a part slides


def stuck(way: Array, reach: float) -> Array:
    """How far a part is strained that sticks and slides from `reach` [m] on; way (shifts, N) [m]."""
    strain = np.zeros_like(way)
    for i, step in enumerate(np.diff(way, axis=1).T):
        strain[:, i + 1] = np.clip(strain[:, i] + step, -reach, reach)
    return strain


def certainty(d: Array, X: Array, variance: float, prior: Array, inflation: float) -> float:
    """Chi-square (1 degree of freedom) by which the best lag explains d (N,) better than none, with all of the grasp's.

    Args:
        X: (k, shifts, N) height and places across, for shifts that are symmetric about none.
        variance: of d [m^2]. prior: (k,) variances of the factors of X, about one for the first, else zero.
        inflation: of the variance, as neighbours are alike.
    """
    way = X[0] - X[0].mean(axis=1, keepdims=True)
    size = max(float(np.ptp(way, axis=1).max()), 1e-6)
    bends = [2.0 * way**2 / size, 4.0 * way**3 / size**2]
    X = np.stack((*X, *bends, *(stuck(way, share * size) for share in _REACHES)))
    X, d = X - X.mean(axis=2, keepdims=True), d - d.mean()
    weights = variance / np.concatenate((prior, [_BEND**2] * 2, [_STUCK**2] * 2))
    rest = d - X[0]
    H = np.einsum("ijn,kjn->jik", X, X) + np.diag(weights)
    g = np.einsum("ijn,jn->ji", X, rest)
    cost = (rest**2).sum(axis=1) - np.einsum("ji,ji->j", g, np.linalg.solve(H, g[..., None])[..., 0])
    least, without = float(cost.min()), float(cost[len(cost) // 2])
    return (without - least) / (inflation * max(least / max(len(d) - len(X) - 1, 1), variance))

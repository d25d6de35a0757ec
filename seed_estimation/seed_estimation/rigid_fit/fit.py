# SPDX-License-Identifier: Apache-2.0
"""One rigid motion of the tool that explains the infrared images and the depth of both fingers at once.

Robust Gauss-Newton over xi = [rotation, translation], with the residuals of `sight`, coarse then fine. The membrane may
follow only a share 1 - slip of the motion across the camera's axis (micro-slip), which the image sees and depth does
not; that share's own information is returned, for `slip` to learn from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seed_core.spatial import Array, so3_exp, so3_log
from seed_estimation.images.sampling import Frame
from seed_estimation.rigid_fit.normal_equations import solved
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.rigid_fit.residuals import Residuals, Sight

DONE = 2.0  # a step of less than this many deviations, as residuals that were independent would have them, is the last


@dataclass(frozen=True, eq=False)
class Fit:
    """Outcome of the fit.

    Attributes:
        X_CT: (4, 4).
        H_image, H_depth: (6, 6) information of either kind about xi, in the tool's frame.
        g_image, g_depth: (6,) where either kind would like to go: H^-1 g is its own step.
        scatter: (6, 6) of the gradient, from how parts of the patches contradict each other.
        locked: share of each finger's image that the motion explains, 1 - sum w r^2 / sum w I_0^2.
        depth_rms: robust deviation of the depth residuals of each finger [m]; infinite where too few are left.
        slip_step, slip_information: by how much the images ask to change the slip, and how sure they are.
        slip_effect: (6,) by how much xi changes with the slip.
        iterations: Gauss-Newton steps made.
        sights: each finger's points, residuals and weights at the end.
    """

    X_CT: Array
    H_image: Array
    H_depth: Array
    g_image: Array
    g_depth: Array
    scatter: Array
    locked: Mapping[str, float]
    depth_rms: Mapping[str, float]
    slip_step: float
    slip_information: float
    slip_effect: Array
    iterations: int
    sights: Sequence[Sight]


def motion_vector(X: Array) -> Array:
    """[rotation vector, translation] (6,) of a pose."""
    return np.concatenate([so3_log(X[:3, :3]), X[:3, 3]])


def composed(X_CT: Array, xi: Array) -> Array:
    """X_CT exp(xi)^-1."""
    R = so3_exp(xi[:3]).T
    step = np.eye(4)
    step[:3, :3] = R
    step[:3, 3] = -R @ xi[3:]
    return np.asarray(X_CT @ step)


def _kept_orthogonal(X: Array) -> Array:
    """X (4, 4) without the rounding of many products: one step of Newton's towards the nearest rotation."""
    out, R = X.copy(), X[:3, :3]
    out[:3, :3] = R @ (1.5 * np.eye(3) - 0.5 * (R.T @ R))
    return out


def fit(
    models: Sequence[FingerModel],
    frames: Mapping[str, Frame],
    X_CT: Array,
    slip: float,
    prior: Array,
    steps: tuple[int, int],
) -> Fit:
    """Pose of the tool from the fingers' frames, started at X_CT (4, 4).

    prior: (6, 6) information that holds unobserved axes where they start; steps: most steps, coarse and fine.
    """
    X, count = X_CT, 0
    if steps[0] > 0:
        X, count = _descend([Sight(m, frames[m.finger], X, slip, 0) for m in models], X, prior, steps[0])
    sights = [Sight(m, frames[m.finger], X, slip, 1) for m in models]
    X, fine = _descend(sights, X, prior, steps[1])
    return _summary(sights, _kept_orthogonal(X), prior, count + fine)


def _descend(sights: Sequence[Sight], X: Array, prior: Array, steps: int) -> tuple[Array, int]:
    for i in range(steps):
        H, g = prior.copy(), np.zeros(6)
        for sight in sights:
            sight.evaluate(X, rescale=i < 2)
            H += sight.image.H + sight.depth.H
            g += sight.image.g + sight.depth.g
        xi = solved(H, g)
        X = composed(X, xi)
        if xi @ g < DONE**2:
            break
    return X, i + 1


def _summary(sights: Sequence[Sight], X: Array, prior: Array, count: int) -> Fit:
    """Information of image, depth and slip from the last evaluation."""
    image, depth = [s.image for s in sights], [s.depth for s in sights]
    H_image, g_image = _sum(image)
    H_depth, g_depth = _sum(depth)
    step, information, effect = _slip(sights, X, H_image + H_depth + prior, g_image + g_depth)
    return Fit(
        X_CT=X,
        H_image=H_image,
        H_depth=H_depth,
        g_image=g_image,
        g_depth=g_depth,
        scatter=np.asarray(sum(block.scatter() for block in (*image, *depth))),
        locked={s.model.finger: s.locked() for s in sights},
        depth_rms={s.model.finger: s.depth.deviation if s.depth.r.size else np.inf for s in sights},
        slip_step=step,
        slip_information=information,
        slip_effect=effect,
        iterations=count,
        sights=sights,
    )


def _sum(blocks: Sequence[Residuals]) -> tuple[Array, Array]:
    """Information (6, 6) and gradient (6,) of all blocks."""
    H, g = np.zeros((6, 6)), np.zeros(6)
    for b in blocks:
        H += b.H
        g += b.g
    return H, g


def _slip(sights: Sequence[Sight], X: Array, H: Array, g: Array) -> tuple[float, float, Array]:
    """Change of slip that the images ask for once the pose is free to follow it, its information and effect (6,)."""
    motion = motion_vector(X).astype(np.float32)
    H_s, H_ss, g_s = np.zeros(6), 0.0, 0.0
    for sight in sights:
        b = sight.image
        if b.r.size == 0:
            continue
        column = motion @ sight.points.J_along  # d r / d slip: what the motion does sideways
        H_s += (b.Jw @ column) * b.scale
        H_ss += float(column @ (b.w * column)) * b.scale
        g_s += float(column @ (b.w * b.r)) * b.scale
    effect = solved(H, H_s)
    information = max(H_ss - float(H_s @ effect), 0.0)
    return (g_s - float(g @ effect)) / max(information, 1e-9), information, effect

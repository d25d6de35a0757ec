# SPDX-License-Identifier: Apache-2.0
"""One rigid motion that explains the measurements of all fingers: Gauss-Newton with robust weights.

The covariance is the inverse of the information that the measurements have as far as they are independent, each kind
weighed by how well it fits: r in standard deviations should scatter by 1, and where it scatters more it counts less.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array, make_pose, so3_exp
from seed_estimation.sensors.contract import Observation, Rows

# Information that holds what nothing sees where it was expected: deviations of 0.5 rad and 20 mm
PRIOR = np.diag([1 / 0.5**2] * 3 + [1 / 0.02**2] * 3)
WIDE = 3.0  # [deviations] from which on a measurement counts as an outlier (Cauchy's weight is a half there)
DONE = 2e-5, 5e-7  # [rad], [m] of a step


class Fit(NamedTuple):
    """The best pose X_CT (4, 4), and the covariance (6, 6) of [rotation vector, translation] in C."""

    X_CT: Array
    covariance: Array


def fit(observations: Sequence[Observation], start: Array, iterations: int) -> Fit:
    """The pose from `start` (4, 4) on."""
    X = start
    H = PRIOR
    for _ in range(iterations):
        H, g = PRIOR.copy(), np.zeros(6)
        for observation in observations:
            for rows in observation.rows(X):
                h, b = _information(rows)
                H += h
                g += b
        step = -np.linalg.solve(H, g)
        R = so3_exp(step[:3])
        X = make_pose(R @ X[:3, :3], R @ X[:3, 3] + step[3:])
        if float(np.abs(step[:3]).max()) < DONE[0] and float(np.abs(step[3:]).max()) < DONE[1]:
            break
    return Fit(X, np.asarray(np.linalg.inv(H)))


def _information(rows: Rows) -> tuple[Array, Array]:
    """J^T W J (6, 6) and J^T W r (6,) of one kind, with no more weight than it has independent measurements."""
    if rows.r.size == 0:
        return np.zeros((6, 6)), np.zeros(6)
    w = 1.0 / (1.0 + np.square(rows.r / WIDE))
    scatter = max(float(w @ np.square(rows.r)) / max(float(w.sum()), 1e-9), 1.0)
    WJ = rows.J * (w * (rows.independent / rows.r.size / scatter))[:, None]
    return WJ.T @ rows.J, WJ.T @ rows.r

# SPDX-License-Identifier: Apache-2.0
"""The load that the sensor measures in an identification, and its derivatives by all that is unknown.

The load on the sensor, moved to the nominal tool frame T', is

    w' = Ad(X_T'T) B (K_g xi + h z) + b_g + d s

with B and xi of the stiffness map (Theorem 1), and unknown: six stiffnesses K_g of each grip g, and as nuisances the
frame offset X_T'T, the sensor's bias b_g of each grip, its drift d over the run (s: time, -1/2 to 1/2), and on
hysteretic axes friction h with its state z (seed_sysid.fit.hysteresis).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from seed_core.spatial import Array, skew, so3_exp
from seed_sysid.parameters import FitParameters
from seed_sysid.stiffness_map import frame_derivatives, offset_pose, stiffness_map, wrench_transform


@dataclass(frozen=True)
class Problem:
    """The data of an identification: n samples of G grips.

    Attributes:
        X_TC: (n, 4, 4) displacements; wrench: (n, 6) [N m, N] about T', in T'.
        grip: (n,) number from 0; time: (n,) [s].
        group: (n,) noise that a sample has: 0 along one axis, 1 a combination, whose pose an estimator knows less well.
        path: (m, 4, 4) all points where the arm turned, in order; index: (n,) which of them the samples are.
        z: (n, 6) states of friction, which counts on the `hysteretic` axes.
        grasps: which points of the path begin another grasp.
    """

    X_TC: Array
    wrench: Array
    grip: np.ndarray
    time: Array
    group: np.ndarray
    path: Array
    index: np.ndarray
    z: Array
    hysteretic: tuple[int, ...] = ()
    parameters: FitParameters = field(default_factory=FitParameters)
    grasps: tuple[int, ...] = ()


class Unknowns(NamedTuple):
    """What the fit finds, or the standard deviation of each."""

    stiffness: Array  # (G, 6) [N m/rad, N/m]
    offset: Array  # (6,) rotation vector [rad] and translation [m] of T in T'
    bias: Array  # (G, 6) [N m, N] about T', in T'
    drift: Array  # (6,) [N m, N] over the whole run
    friction: Array  # (6,) [N m, N], 0 on axes that have none

    def vector(self) -> Array:
        """All of them, flat."""
        return np.concatenate([part.ravel() for part in self])

    @classmethod
    def from_vector(cls, vector: Array) -> Unknowns:
        """The inverse of vector()."""
        grips = (len(vector) - 18) // 12
        K, offset, b, drift, friction = np.split(vector, np.cumsum([6 * grips, 6, 6 * grips, 6]))
        return cls(K.reshape(grips, 6), offset, b.reshape(grips, 6), drift, friction)


class LoadModel:
    """Prediction and Jacobian of the measured loads of a problem."""

    def __init__(self, problem: Problem, train: np.ndarray) -> None:
        """Drift counts from the middle of the samples of the mask train (n,)."""
        self.problem = problem
        self.map = stiffness_map(problem.X_TC, problem.parameters.model)
        time = problem.time[train]
        self.s = (problem.time - time.mean()) / (float(np.ptp(time)) or 1.0)
        self.of_grip = np.eye(int(problem.grip.max()) + 1)[problem.grip]  # (n, G): 1 at the sample's own grip

    def mask(self, offset: bool, drift: bool, friction: ArrayLike) -> np.ndarray:
        """Flat, True at stiffness and bias, and where asked for at offset, drift and the friction of each axis (6,)."""
        every = np.ones((self.of_grip.shape[1], 6), dtype=bool)
        return Unknowns(every, np.full(6, offset), every, np.full(6, drift), np.broadcast_to(friction, 6)).vector()

    def spring(self, u: Unknowns) -> Array:
        """(n, 6) the spring's wrench about T, in T: Theorem 1, forward, and friction."""
        load = u.stiffness[self.problem.grip] * self.map.xi + u.friction * self.problem.z
        return np.asarray(np.einsum("nij,nj->ni", self.map.B, load))

    def predict(self, u: Unknowns) -> Array:
        """(n, 6) measured loads about T', in T'."""
        moved = self.spring(u) @ wrench_transform(offset_pose(u.offset)).T
        return np.asarray(moved + u.bias[self.problem.grip] + self.s[:, None] * u.drift)

    def jacobian(self, u: Unknowns) -> Array:
        """(6n, unknowns) derivatives of predict(), flat, by the unknowns, flat."""
        columns = wrench_transform(offset_pose(u.offset)) @ self.map.B
        own = self.of_grip[:, None, :, None]
        blocks = (
            own * (columns * self.map.xi[:, None])[:, :, None],
            self._offset_columns(u),
            own * np.eye(6)[:, None],
            self.s[:, None, None] * np.eye(6),
            columns * self.problem.z[:, None],
        )
        n = len(self.s)
        return np.concatenate([b.reshape(n, 6, -1) for b in blocks], axis=2).reshape(6 * n, -1)

    def _offset_columns(self, u: Unknowns) -> Array:
        """(n, 6, 6): a turn changes the rotation vector through its left Jacobian, and then the shift's lever acts."""
        R = so3_exp(u.offset[:3])
        out = frame_derivatives(self.spring(u) @ np.kron(np.eye(2), R).T)
        out[:, :, :3] = out[:, :, :3] @ left_jacobian(u.offset[:3])
        out[:, :3, :3] += skew(u.offset[3:]) @ out[:, 3:, :3]
        return out


def left_jacobian(v: Array) -> Array:
    """(3, 3) with exp(v + dv) = exp(J dv) exp(v) to first order."""
    angle, K = float(np.linalg.norm(v)), skew(v)
    if angle < 1e-4:
        return np.eye(3) + 0.5 * K + K @ K / 6.0
    a, b = (1.0 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + a * K + b * (K @ K))

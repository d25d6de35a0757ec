# SPDX-License-Identifier: Apache-2.0
"""The stiffness map over many poses at once, linear in the stiffness: what least squares needs.

At displacement X_TC the spring's wrench on the tool is w = B (K xi): xi (6,) are the generalised coordinates [rpy,
translation], K xi the generalised forces, and B (6, 6) carries those into a wrench about T's origin, in T. With a
diagonal K this is seed_core.bushing.Bushing.wrench; a full symmetric K and friction along a coordinate fit in as well.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from seed_core.bushing import MODELS, Model
from seed_core.config import ConfigError
from seed_core.spatial import Array, make_pose, skew, so3_exp

AXES = ("roll", "pitch", "yaw", "x", "y", "z")  # order of every six-vector of stiffnesses here
CHANNELS = ("torque x", "torque y", "torque z", "force x", "force y", "force z")  # order of every wrench here
UNITS = ("N m/rad",) * 3 + ("N/m",) * 3
LOAD_UNITS = ("N m",) * 3 + ("N",) * 3


class Map(NamedTuple):
    """n displacements prepared for the fit."""

    B: Array  # (n, 6, 6): generalised force to wrench
    xi: Array  # (n, 6): roll, pitch, yaw [rad], translation [m]


def stiffness_map(X_TC: Array, model: Model = "midpoint") -> Map:
    """B and xi of displacements X_TC (n, 4, 4)."""
    if model not in MODELS:
        raise ConfigError(f"model = '{model}' must be one of: {', '.join(MODELS)}")
    rotation, p = Rotation.from_matrix(X_TC[:, :3, :3]), X_TC[:, :3, 3]
    q = rotation.as_euler("xyz")
    B = np.zeros((len(X_TC), 6, 6))
    B[:, :3, :3] = np.swapaxes(_gimbal_rates(q), 1, 2)
    if model == "plain":
        B[:, 3:, 3:] = np.eye(3)
        return Map(B, np.hstack([q, p]))
    R_TB = Rotation.from_rotvec(0.5 * rotation.as_rotvec()).as_matrix()
    B[:, 3:, 3:] = R_TB
    B[:, :3, 3:] = 0.5 * skews(p) @ R_TB
    return Map(B, np.hstack([q, np.einsum("nji,nj->ni", R_TB, p)]))


def _gimbal_rates(q: Array) -> Array:
    """N (n, 3, 3) with q_dot = N w at rpy q (n, 3)."""
    c1, s1, c2, s2 = np.cos(q[:, 1]), np.sin(q[:, 1]), np.cos(q[:, 2]), np.sin(q[:, 2])
    zero, one = np.zeros_like(c1), np.ones_like(c1)
    rows = ((c2 / c1, s2 / c1, zero), (-s2, c2, zero), (c2 * s1 / c1, s2 * s1 / c1, one))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=1)


def skews(v: Array) -> Array:
    """(n, 3, 3) with skews(v)[i] @ u = v[i] x u, for v (n, 3)."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - np.swapaxes(out, 1, 2)


def wrench_transform(X_AB: Array) -> Array:
    """(6, 6) that turns a wrench about B's origin, in B, into one about A's, in A; [torque, force]."""
    R, out = X_AB[:3, :3], np.zeros((6, 6))
    out[:3, :3], out[3:, 3:] = R, R
    out[:3, 3:] = skew(X_AB[:3, 3]) @ R
    return out


def offset_pose(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """X (4, 4) of a frame offset given as a rotation vector (3,) [rad] and a translation (3,) [m]."""
    return make_pose(so3_exp(rotation), translation)

# SPDX-License-Identifier: Apache-2.0
"""The stiffness map of Theorem 1, forward, over many poses at once and linear in the stiffness, for least squares.

At displacement X_TC the spring's wrench on the tool is w = B (K xi): xi (6,) are the generalised coordinates [rpy,
translation], K xi the generalised forces, and B (6, 6) carries those into a wrench about T's origin, in T. With a
diagonal K this is seed_core.bushing.Bushing.wrench; a full symmetric K and friction along a coordinate fit in as well.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from seed_core.bushing import MODELS, Model
from seed_core.config import ConfigError
from seed_core.spatial import Array, make_pose, skew, so3_exp

AXES = ("roll", "pitch", "yaw", "x", "y", "z")  # order of every six-vector of stiffnesses here
CHANNELS = ("torque x", "torque y", "torque z", "force x", "force y", "force z")  # order of every wrench here
UNITS = ("N m/rad",) * 3 + ("N/m",) * 3
LOAD_UNITS = ("N m",) * 3 + ("N",) * 3


class StiffnessMap(NamedTuple):
    """n displacements prepared for the fit."""

    B: Array  # (n, 6, 6): generalised force to wrench
    xi: Array  # (n, 6): roll, pitch, yaw [rad], translation [m]


def stiffness_map(X_TC: Array, model: Model = "midpoint") -> StiffnessMap:
    """Theorem 1, forward: B and xi of displacements, whose wrench is B (K xi).

    Args:
        X_TC: (n, 4, 4) poses of C in T.
        model: 'midpoint', or 'plain' (the paper's).

    Raises:
        ConfigError: the model is unknown.
    """
    if model not in MODELS:
        raise ConfigError(f"model = '{model}' must be one of: {', '.join(MODELS)}")
    rotation, p = Rotation.from_matrix(X_TC[:, :3, :3]), X_TC[:, :3, 3]
    q = rotation.as_euler("xyz")
    B = np.zeros((len(X_TC), 6, 6))
    (_, c1, c2), (_, s1, s2) = np.cos(q).T, np.sin(q).T
    zero, one = np.zeros_like(c1), np.ones_like(c1)
    rates = ((c2 / c1, -s2, c2 * s1 / c1), (s2 / c1, c2, s2 * s1 / c1), (zero, zero, one))  # N^T, q_dot = N w
    B[:, :3, :3] = np.moveaxis(np.array(rates), 2, 0)
    if model == "plain":
        B[:, 3:, 3:] = np.eye(3)
        return StiffnessMap(B, np.hstack([q, p]))
    R_TB = Rotation.from_rotvec(0.5 * rotation.as_rotvec()).as_matrix()
    B[:, 3:, 3:] = R_TB
    B[:, :3, 3:] = 0.5 * skews(p) @ R_TB
    return StiffnessMap(B, np.hstack([q, np.einsum("nji,nj->ni", R_TB, p)]))


def skews(v: Array) -> Array:
    """(n, 3, 3) with skews(v)[i] @ u = v[i] x u, for v (n, 3)."""
    return np.cross(np.eye(3), v[:, None])


def frame_derivatives(wrenches: Array) -> Array:
    """(n, 6, 6) derivatives of wrenches (n, 6) by a small turn [rad] and shift [m] of the body that they act on."""
    turned, shifted = -skews(wrenches[:, :3]), -skews(wrenches[:, 3:])
    return np.block([[turned, shifted], [shifted, np.zeros_like(shifted)]])


def wrench_transform(X_AB: Array) -> Array:
    """(6, 6) that turns a wrench about B's origin, in B, into one about A's, in A; [torque, force]."""
    R = X_AB[:3, :3]
    return np.block([[R, skew(X_AB[:3, 3]) @ R], [np.zeros((3, 3)), R]])


def offset_pose(offset: Array) -> Array:
    """X (4, 4) of a frame offset (6,): rotation vector [rad] and translation [m]."""
    return make_pose(so3_exp(offset[:3]), offset[3:])

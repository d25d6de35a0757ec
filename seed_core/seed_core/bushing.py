# SPDX-License-Identifier: Apache-2.0
"""The generalised stiffness map of the grasp (Suh et al., Sec. IV-C, Theorem 1): displacement X_TC to wrench and back.

With q = (r, p, y) = rpy(R_TC), the spring's load on the tool, about T's origin and written in T, is

    torque = N(q)^T diag(k) q,    force = K p_TC                              model 'plain' (the paper's, Eq. 2 and 3)
    force = R_TB K R_TB^T p_TC,   torque = N(q)^T diag(k) q + 1/2 p_TC x force             model 'midpoint' (Drake's)

where N (Eq. 3) maps angular velocity to gimbal rates, q_dot = N w, and R_TB = exp(log(R_TC) / 2) is half the rotation.
The two agree to rounding where the translational stiffness is isotropic and the torque is taken about the midpoint.

Theorem 1: under Assumption 2 the map is a diffeomorphism wherever |pitch| < pi/2. Forward it is `Bushing.wrench`, its
inverse `Bushing.pose`. Assumption 1, that the tool does not slip in the grasp, is the estimator's to watch.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin
from typing import Literal

import numpy as np

from seed_core.config import ConfigError, field
from seed_core.errors import SeedError
from seed_core.spatial import Array, Wrench, cross, make_pose, rotation_from_rpy, rpy_from_rotation, so3_exp, so3_log
from seed_core.vector3 import Vector3

Model = Literal["midpoint", "plain"]
MODELS = ("midpoint", "plain")
COORDINATES = ("roll", "pitch", "yaw", "x", "y", "z")  # of the map, in the order of every vector (6,) of stiffnesses
ROTATIONS, TRANSLATIONS = (1e-6, 1e6), (1e-3, 1e9)  # [N m/rad], [N/m] that a stiffness may have
_ITERATIONS = 50  # the fixed point contracts by |p x f| / (2 k): a dozen steps reach rounding within 30 degrees
_CONVERGED = 1e-14  # [m]


class BushingError(SeedError):
    """A wrench that no displacement within the map's domain produces."""


@dataclass(frozen=True)
class Stiffness:
    """Diagonal, positive stiffness of the grasp: Assumption 2 of the paper, checked here."""

    rotation: Vector3 = field(
        unit="N m/rad", low=ROTATIONS[0], high=ROTATIONS[1], doc="about the gimbal's roll, pitch and yaw axes"
    )
    translation: Vector3 = field(unit="N/m", low=TRANSLATIONS[0], high=TRANSLATIONS[1], doc="along x, y and z")

    def __post_init__(self) -> None:
        for name, unit, (low, high) in (("rotation", "N m/rad", ROTATIONS), ("translation", "N/m", TRANSLATIONS)):
            for i, value in enumerate(getattr(self, name)):
                if not low <= value <= high:
                    raise ConfigError(
                        f"stiffness.{name}[{i}] = {value} {unit} must be within {low:g} and {high:g} {unit}"
                    )

    @classmethod
    def from_vector(cls, vector: Array) -> Stiffness:
        """From [rotation, translation] (6,) [N m/rad, N/m]."""
        roll, pitch, yaw, x, y, z = (float(v) for v in vector)
        return cls((roll, pitch, yaw), (x, y, z))

    def vector(self) -> Array:
        """[rotation, translation] (6,) [N m/rad, N/m]."""
        return np.array(self.rotation + self.translation)

    def scaled(self, factor: float) -> Stiffness:
        """Every stiffness times factor."""
        return Stiffness.from_vector(factor * self.vector())


class Bushing:
    """The stiffness map K of one grasp and its inverse."""

    def __init__(self, stiffness: Stiffness, model: Model = "midpoint") -> None:
        if model not in MODELS:
            raise ConfigError(f"model = '{model}' must be one of: {', '.join(MODELS)}")
        self.stiffness = stiffness
        self.model = model
        self.k = np.array(stiffness.rotation)
        self.K = np.array(stiffness.translation)

    def wrench(self, X_TC: Array) -> Wrench:
        """Theorem 1, forward: the wrench of the grasp's spring on the tool.

        Args:
            X_TC: (4, 4) pose of the compliance frame in the tool's frame; identity is the grasp at rest.

        Returns:
            Torque [N m] and force [N] about T's origin, written in T.
        """
        R, p = X_TC[:3, :3], X_TC[:3, 3]
        torque = self.torque(rpy_from_rotation(R))
        if self.model == "plain":
            return Wrench(torque, self.K * p)  # Eq. 2
        R_TB = so3_exp(0.5 * so3_log(R))
        force = R_TB @ (self.K * (R_TB.T @ p))
        return Wrench(torque + 0.5 * cross(p, force), force)

    def torque(self, rpy: Array) -> Array:
        """N(q)^T diag(k) q (3,) [N m] at q = rpy (3,) [rad]: the rotational half of Eq. 2, N of Eq. 3."""
        roll, pitch, yaw = float(rpy[0]), float(rpy[1]), float(rpy[2])
        kr, kp, ky = self.stiffness.rotation
        c1, s1, c2, s2 = cos(pitch), sin(pitch), cos(yaw), sin(yaw)
        a = (kr * roll + s1 * ky * yaw) / c1
        return np.array((a * c2 - s2 * kp * pitch, a * s2 + c2 * kp * pitch, ky * yaw))

    def energy(self, X_TC: Array) -> float:
        """Elastic energy [J] at X_TC: 1/2 q^T k q + 1/2 p^T K p, p written in B for the midpoint model."""
        R, p = X_TC[:3, :3], X_TC[:3, 3]
        q = rpy_from_rotation(R)
        if self.model == "midpoint":
            p = so3_exp(0.5 * so3_log(R)).T @ p
        return 0.5 * float(q @ (self.k * q) + p @ (self.K * p))

    def angles(self, torque: Array) -> Array:
        """The rpy (3,) [rad] at which N^T diag(k) q is torque (3,) [N m]: Eq. 5, from the bottom row up.

        Raises:
            BushingError: the torque asks for a pitch of 90 degrees or more, or a roll or yaw beyond 180.
        """
        kr, kp, ky = self.stiffness.rotation
        tx, ty, tz = float(torque[0]), float(torque[1]), float(torque[2])
        yaw = tz / ky
        c2, s2 = cos(yaw), sin(yaw)
        pitch = (-s2 * tx + c2 * ty) / kp
        roll = (cos(pitch) * (c2 * tx + s2 * ty) - sin(pitch) * tz) / kr
        for name, value, bound in (("yaw", yaw, pi), ("pitch", pitch, pi / 2), ("roll", roll, pi)):
            if not abs(value) < bound:
                raise BushingError(
                    f"torque {np.round(torque, 3)} N m needs a {name} of {np.rad2deg(value):.0f} degrees; "
                    f"this grasp's map ends at {np.rad2deg(bound):.0f}: ask for less torque or a stiffer grip"
                )
        return np.array((roll, pitch, yaw))

    def pose(self, wrench: Wrench) -> Array:
        """Theorem 1, inverse: the displacement at which the spring's wrench on the tool is the one given.

        Args:
            wrench: torque [N m] and force [N] about T's origin, written in T.

        Returns:
            X_TC (4, 4).

        Raises:
            BushingError: no such displacement within the map's domain.
        """
        if self.model == "plain":
            return make_pose(rotation_from_rpy(self.angles(wrench.torque)), wrench.force / self.K)
        p = wrench.force / self.K
        for _ in range(_ITERATIONS):
            R = rotation_from_rpy(self.angles(wrench.torque - 0.5 * cross(p, wrench.force)))
            p_next = self.translation(wrench.force, R)
            if np.abs(p_next - p).max() < _CONVERGED:
                return make_pose(R, p_next)
            p = p_next
        raise BushingError(
            f"wrench {np.round(wrench.vector(), 3)} (N m, N): the displacement does not settle; "
            "the force bends the grasp too far: ask for less or grip more firmly"
        )

    def translation(self, force: Array, R_TC: Array) -> Array:
        """p_TC (3,) [m] at which the spring's force on the tool, in T, is force (3,) [N] while the rotation is R_TC."""
        if self.model == "plain":
            return np.asarray(force / self.K)
        R_TB = so3_exp(0.5 * so3_log(R_TC))
        return np.asarray(R_TB @ ((R_TB.T @ force) / self.K))

    def translation_stiffness(self, R_TC: Array) -> Array:
        """(3, 3) [N/m] with force_T = K_T p_TC at rotation R_TC: diagonal, or half rotated for the midpoint model."""
        if self.model == "plain":
            return np.diag(self.K)
        R_TB = so3_exp(0.5 * so3_log(R_TC))
        K_T: Array = R_TB @ np.diag(self.K) @ R_TB.T
        return K_T

# SPDX-License-Identifier: Apache-2.0
"""What one image says, once it has met the kinematics of its own moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seed_control.wrench.stiffness_blend import Blend
from seed_core.bushing import Bushing, Stiffness
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Tool, weight_about_T
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, so3_exp, so3_log

ROTATION_DEVIATION = float(np.deg2rad(0.5))  # [rad] of an estimate that states no covariance


@dataclass(frozen=True, slots=True)
class Measurement:
    """Poses at the image's stamp; frames as in the notation.

    Attributes:
        spring: the spring's load on the tool about T's origin, in T.
        on_environment: the tool's load on the environment about the tip, in W.
        variance: of a position component of X_CT [m^2].
        rotation_deviation: standard deviation of a rotation component of X_CT [rad].
        undeflected: (3,) where the tip would be if T's origin were at C's, with the tool's rotation as it is [m].
    """

    stamp: float
    X_WC: Array
    X_WT: Array
    X_TC: Array
    X_CT: Array
    tip: Array
    undeflected: Array
    spring: Wrench
    on_environment: Wrench
    variance: float
    rotation_deviation: float


def observed_part(estimate: RelativePoseEstimate) -> Array:
    """X_CT (4, 4) with the tool where it was grasped on every axis that the estimate does not observe.

    What an estimator says of such an axis may have the wrong sign, and fed forward it would run away.
    """
    if all(estimate.observed):
        return estimate.X_CT
    turn = np.where(estimate.observed_rotation, so3_log(estimate.X_CT[:3, :3]), 0.0)
    return make_pose(so3_exp(turn), np.where(estimate.observed_translation, estimate.X_CT[:3, 3], 0.0))


class Gauge:
    """Turns estimates into measurements, for one tool and stiffness."""

    def __init__(self, tool: Tool, bushing: Bushing, gravity: bool, default_deviation: float) -> None:
        self.tool, self.gravity = tool, gravity
        self._use(bushing)
        self._blend: Blend | None = None
        self.p_Ttip = tool.X_Ttip[:3, 3].copy()
        self._com = np.array(tool.center_of_mass)
        self._default = default_deviation

    def change(self, stiffness: Stiffness, t: float, duration: float) -> None:
        """Take over another stiffness from time t [s] on, within duration [s]."""
        self._blend = Blend(self.bushing.stiffness, stiffness, t, duration)
        if duration == 0.0:
            self.advance(t)

    def advance(self, t: float) -> None:
        """Go on with taking over a stiffness, if one is being taken over."""
        blend = self._blend
        if blend is None:
            return
        self._use(Bushing(blend.at(t), self.bushing.model))
        if blend.share(t) >= 1.0:
            self._blend = None

    def _use(self, bushing: Bushing) -> None:
        self.bushing = bushing
        self.mean_stiffness = sum(bushing.stiffness.translation) / 3.0  # [N/m]

    def weight(self, R_WT: Array) -> Wrench:
        """Weight about T's origin in T; zero for a law without gravity."""
        if not self.gravity:
            return Wrench.zero()
        return weight_about_T(self.tool.mass, self._com, R_WT)

    def measure(self, estimate: RelativePoseEstimate, X_WC: Array) -> Measurement:
        """The measurement of one estimate, the gripper having been at X_WC (4, 4) at its stamp."""
        X_CT = observed_part(estimate)
        X_WT, X_TC = X_WC @ X_CT, inverse_pose(X_CT)
        R_WT = X_WT[:3, :3]
        lever = R_WT @ self.p_Ttip
        spring = self.bushing.wrench(X_TC)
        load = spring.plus(self.weight(R_WT)).about(self.p_Ttip).rotated(R_WT)
        return Measurement(
            estimate.stamp,
            X_WC,
            X_WT,
            X_TC,
            X_CT,
            X_WT[:3, 3] + lever,
            X_WC[:3, 3] + lever,
            spring,
            load,
            self._variance(estimate),
            self._rotation_deviation(estimate),
        )

    def _rotation_deviation(self, estimate: RelativePoseEstimate) -> float:
        stated = sum(estimate.covariance.diagonal()[:3].tolist()) / 3.0
        return stated**0.5 if stated > 0.0 else ROTATION_DEVIATION

    def _variance(self, estimate: RelativePoseEstimate) -> float:
        stated_each, seen = np.diag(estimate.covariance)[3:], np.array(estimate.observed_translation)
        stated = float(np.mean(stated_each[seen] if seen.any() else stated_each))  # force is controlled along these
        return max(stated, 1e-10) if stated > 0.0 else self._default**2

# SPDX-License-Identifier: Apache-2.0
"""The wrench of the tool on the environment, from one image that has met the kinematics of its own moment."""

from typing import NamedTuple

import numpy as np

from seed_control.wrench.stiffness_schedule import StiffnessBlend
from seed_core.bushing import Bushing, Stiffness
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Tool, weight_about_T
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, so3_exp, so3_log

ROTATION_DEVIATION = float(np.deg2rad(0.5))  # [rad] of an estimate that states no covariance


class Measurement(NamedTuple):
    """Poses at the image's stamp; frames as in the notation.

    Attributes:
        tip: (3,) [m] in W. undeflected: (3,) the same if T's origin were at C's, with the tool's rotation as it is.
        spring: the spring's load on the tool about T's origin, in T.
        on_environment: the tool's load on the environment about the tip, in W.
        variance: of a position component of X_CT [m^2].
        rotation_deviation: standard deviation of a rotation component of X_CT [rad].
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


class WrenchEstimator:
    """The stiffness map forwards: estimates to measurements, for one tool and a stiffness that may change.

    Attributes:
        bushing: the map in use.
        p_Ttip: (3,) [m].
    """

    def __init__(self, tool: Tool, bushing: Bushing, gravity: bool, default_deviation: float) -> None:
        """default_deviation: [m] of a position of an estimate that states no covariance."""
        self.tool, self.bushing = tool, bushing
        self.p_Ttip = tool.X_Ttip[:3, 3].copy()
        self._blend: StiffnessBlend | None = None
        self._mass, self._com = tool.mass if gravity else 0.0, np.array(tool.center_of_mass)
        self._default_variance = default_deviation**2

    @property
    def mean_stiffness(self) -> float:
        """Of the three translations [N/m]."""
        return sum(self.bushing.stiffness.translation) / 3.0

    def set_stiffness(self, stiffness: Stiffness, t: float, duration: float) -> None:
        """Take over another stiffness from time t [s] on, within duration [s]."""
        self._blend = StiffnessBlend(self.bushing.stiffness, stiffness, t, duration)
        if duration == 0.0:
            self.advance(t)

    def advance(self, t: float) -> None:
        """Go on with taking over a stiffness, if one is being taken over."""
        blend = self._blend
        if blend is None:
            return
        self.bushing = Bushing(blend.at(t), self.bushing.model)
        if blend.share(t) >= 1.0:
            self._blend = None

    def weight(self, R_WT: Array) -> Wrench:
        """Weight about T's origin in T, of the tool at R_WT (3, 3); zero for a law without gravity."""
        return weight_about_T(self._mass, self._com, R_WT)

    def measure(self, estimate: RelativePoseEstimate, X_WC: Array) -> Measurement:
        """The measurement of one estimate, the gripper having been at X_WC (4, 4) at its stamp."""
        X_CT = observed_part(estimate)
        X_WT, X_TC = X_WC @ X_CT, inverse_pose(X_CT)
        R_WT = X_WT[:3, :3]
        lever = R_WT @ self.p_Ttip
        spring = self.bushing.wrench(X_TC)
        stated, seen = estimate.covariance.diagonal(), np.array(estimate.observed_translation)
        turning = sum(stated[:3].tolist()) / 3.0
        variance = float(np.mean(stated[3:][seen] if seen.any() else stated[3:]))  # force is controlled along these
        return Measurement(
            stamp=estimate.stamp,
            X_WC=X_WC,
            X_WT=X_WT,
            X_TC=X_TC,
            X_CT=X_CT,
            tip=X_WT[:3, 3] + lever,
            undeflected=X_WC[:3, 3] + lever,
            spring=spring,
            on_environment=spring.plus(self.weight(R_WT)).about(self.p_Ttip).rotated(R_WT),
            variance=max(variance, 1e-10) if variance > 0.0 else self._default_variance,
            rotation_deviation=turning**0.5 if turning > 0.0 else ROTATION_DEVIATION,
        )

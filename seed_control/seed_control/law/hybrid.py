# SPDX-License-Identifier: Apache-2.0
"""The full law: Algorithm 2 with what it takes to hold force, torque, position and angle on a real arm.

The default law `seed` is HybridLaw with the surface observer, the law `plain` the same without it.
"""

from seed_control.law.published import PublishedLaw
from seed_control.law.surface_observer import SurfaceObserver
from seed_control.law.tip_reference import HeightReference
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import Flags, HybridSetpoint
from seed_control.wrench.estimate import Measurement, WrenchEstimator
from seed_control.wrench.filters import DeflectionFilter
from seed_core.bushing import Model, Stiffness
from seed_core.spatial import Array, rotation_from_rpy

_APPROACH_SHARE = 0.7  # of the wanted deflection that an approach may cover before the first image of contact acts
_LEAST_MARGIN = 0.1  # of stiffness against tipping that is still told apart
_PRESS_TIME = 0.1  # [s] in which the force may be built up at the soonest, once the surface is known


class HybridLaw(PublishedLaw):
    """Algorithm 2 on the image's own kinematics, with gravity, a smoothed tool, and the tool instead of the gripper
    on the path: the deflection of what is held is fed forward.

    In contact an observer per force direction tells where the surface will be (law `seed`; `plain` goes without).
    """

    synchronised = True
    gravity = True
    model: Model = "midpoint"
    smoothed = True

    def __init__(self, parameters: ControllerParameters, wrench_estimator: WrenchEstimator) -> None:
        super().__init__(parameters, wrench_estimator)
        self.observers: list[SurfaceObserver] = []  # one per force direction, since contact was made along it
        self.deflection = DeflectionFilter(parameters)
        self._tipping_gain = 1.0

    def image(self, m: Measurement, loop_time: float) -> None:
        self.deflection.update(m, loop_time, self._tipping_gain)
        super().image(m, loop_time)

    def release(self) -> None:
        super().release()
        self._tipping_gain = 1.0

    def _observe(self, m: Measurement) -> tuple[int, ...]:
        made, normals = super()._observe(m), self.plan.normals
        if len(self.observers) != len(normals):
            self.observers = [SurfaceObserver(self.parameters) for _ in normals]
        for i, (n, observer) in enumerate(zip(normals, self.observers, strict=True)):
            if i in made:
                observer.start(m.stamp, n, m.tip, m.undeflected)
            if self.touches(i):
                observer.update(m.stamp, n, m.tip, m.undeflected, m.variance)
        return made

    def _solve(self, s: HybridSetpoint, R_W_task: Array, P: Array, normals: Array) -> None:
        # fed-forward deflection has this gain in its loop: its time grows with it, so the loop's speed stays the same
        force_T = self.tool.R_WT.T @ (R_W_task @ s.wrench.force)
        stiffness = self.wrench_estimator.bushing.stiffness
        self._tipping_gain = tipping_gain(force_T, self.p_Ttip, s.torque_axes, stiffness)
        super()._solve(s, R_W_task, P, normals)

    def _held(self, R_WT_des: Array) -> tuple[Array, Array]:
        """The tool is where and how it is wanted: the gripper leads by the slowly filtered deflection."""
        return R_WT_des @ rotation_from_rpy(self.deflection.q), self.deflection.tip_to_C

    def _height_reference(self, s: HybridSetpoint, i: int) -> HeightReference:
        reference = super()._height_reference(s, i)
        if self.parameters.law == "plain":
            return reference
        needed = abs(float(self.plan.wanted[i])) / self.wrench_estimator.mean_stiffness  # [m] of deflection
        if not self.touches(i):  # the grasp must not deflect further within a loop than wanted
            return reference._replace(reach=_APPROACH_SHARE * needed)
        deflection = float(self.plan.normals[i] @ self.tool.R_WT @ self.plan.X_TC[:3, 3])
        offset, gradient = self.observers[i].wanted_height(reference.normal, deflection)
        speed = max(reference.speed, min(self.parameters.press_speed, needed / _PRESS_TIME))
        return HeightReference(reference.normal, offset, gradient, speed)


def tipping_gain(force_T: Array, p_Ttip: Array, torque_axes: Flags, stiffness: Stiffness) -> float:
    """How many times further than the gripper a tool turns that is pressed with F at lever H: G = 1 / (1 - F H / k).

    On the weakest axis k that holds its angle; where k < F H the tool tips (SP14).

    Args:
        force_T: (3,) [N] wanted of the tool on the environment, in T. p_Ttip: (3,) [m].
    """
    moment = float(force_T @ p_Ttip)  # positive when the tip is pressed away from T
    k = [k for k, on in zip(stiffness.rotation, torque_axes, strict=True) if not on]
    if moment <= 0.0 or not k:
        return 1.0
    return 1.0 / max(1.0 - moment / min(k), _LEAST_MARGIN)

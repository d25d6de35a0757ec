# SPDX-License-Identifier: Apache-2.0
"""The little that changes with every step: where the gripper is to go between one image and the next."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

from seed_control.law.features import Features
from seed_control.law.surface_observer import SurfaceObserver
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint
from seed_core.vector3 import Vector3, dot, minus, plus, plus_scaled

_APPROACH_SHARE = 0.7  # of the wanted deflection that an approach may cover before the first image of contact acts
_PRESS_TIME = 0.1  # [s] in which the force may be built up at the soonest, once the surface is known
_SLOWEST = 1e-3  # [m/s]
_ORIGIN = (0.0, 0.0, 0.0)


class Plan(NamedTuple):
    """What an image settles for the steps that follow; vectors in W.

    Attributes:
        normals: force directions, orthonormal.
        wanted: force along each of them [N].
        deflections: wanted of the grasp along each of them [m].
        softness: compliance of the grasp [m/N], its mean.
        tip: filtered place of the tip [m].
        lever: from T's origin to the tip [m].
        tip_to_C: from the wanted tip to the gripper, the deflection fed forward [m].
        approach_speed: towards contact [m/s].
    """

    normals: Sequence[Vector3]
    wanted: Sequence[float]
    deflections: Sequence[float]
    softness: float
    tip: Vector3
    lever: Vector3
    tip_to_C: Vector3
    approach_speed: float


class Course(NamedTuple):
    """Along one force direction: wanted height of the undeflected tip, and the bounds on its speed.

    Attributes:
        normal: the direction, in W.
        offset, gradient: with the tip's wanted place, height = offset + gradient . tip [m].
        speed: [m/s], at most.
        reach: [m] that may be covered within one loop time.
    """

    normal: Vector3
    offset: float
    gradient: Vector3
    speed: float
    reach: float


class Walk:
    """Moves the undeflected tip along the force directions with bounded speed; elsewhere it follows the path."""

    def __init__(self, features: Features, parameters: ControllerParameters) -> None:
        self.features, self.parameters = features, parameters
        self.reset()

    def reset(self) -> None:
        """No set-point, no force direction."""
        self.observers: list[SurfaceObserver] = []  # one per force direction
        self.undeflected: Vector3 = _ORIGIN  # commanded place of the tip if the grasp were not deflected
        self._courses: list[Course] = []
        self._lever = self._tip_to_undeflected = _ORIGIN

    def renew(self, plan: Plan, contact: bool) -> None:
        """Take over what an image, or another set-point, has settled."""
        self._lever, self._tip_to_undeflected = plan.lever, plus(plan.tip_to_C, plan.lever)
        self._courses = [self._course(i, plan, contact) for i in range(len(self.observers))]

    def target(self, s: HybridSetpoint, dt: float, lead: float, loop_time: float) -> Vector3:
        """Wanted gripper position p_WC [m] for this step of dt [s].

        Args:
            lead: [s] by which the arm trails its command.
            loop_time: [s] from an image to the arm's answer, which bounds the approach.
        """
        (x, y, z), (u, v, w) = s.motion
        tip = x + lead * u, y + lead * v, z + lead * w
        path = goal = plus(tip, self._tip_to_undeflected)
        for n, offset, gradient, speed, reach in self._courses:
            now = dot(n, self.undeflected)
            bound = min(speed, max(reach / loop_time, _SLOWEST)) * dt
            step = min(max(offset + dot(gradient, tip) - now, -bound), bound)
            goal = plus_scaled(goal, now + step - dot(n, path), n)
        self.undeflected = goal
        return minus(goal, self._lever)

    def _course(self, i: int, plan: Plan, contact: bool) -> Course:
        n = plan.normals[i]
        offset, gradient = self._height(i, plan, contact)
        needed, v = abs(plan.wanted[i]) * plan.softness, plan.approach_speed
        if not self.features.observer:
            return Course(n, offset, gradient, v, inf)
        if contact:
            return Course(n, offset, gradient, max(v, min(self.parameters.press_speed, needed / _PRESS_TIME)), inf)
        # before contact the grasp must not deflect further within a loop than wanted
        return Course(n, offset, gradient, v, _APPROACH_SHARE * needed)

    def _height(self, i: int, plan: Plan, contact: bool) -> tuple[float, Vector3]:
        """Wanted height along normal i as offset and gradient over the tip's place."""
        n = plan.normals[i]
        if contact and self.features.observer:
            return self.observers[i].course(n, plan.deflections[i])
        if not contact and plan.wanted[i] == 0.0:  # nothing to walk towards: along the path
            return dot(n, self._tip_to_undeflected), n
        return dot(n, plan.tip) + plan.deflections[i], _ORIGIN

# SPDX-License-Identifier: Apache-2.0
"""The little that changes with every step: where the gripper is to go between one image and the next."""

from __future__ import annotations

from typing import NamedTuple

from seed_control.features import Features
from seed_control.observer import SurfaceObserver
from seed_control.parameters import ControllerParameters
from seed_control.setpoints import HybridSetpoint
from seed_control.vectors import Rows, Triple, along, dot, minus, plus, turned

_APPROACH_SHARE = 0.7  # of the wanted deflection that an approach may cover before the first image of contact acts
_PRESS_TIME = 0.1  # [s] in which the force may be built up at the soonest, once the surface is known
_SLOWEST = 1e-3  # [m/s]
_ORIGIN = (0.0, 0.0, 0.0)


class Plan(NamedTuple):
    """What an image settles for the steps that follow; vectors in W.

    Attributes:
        normals: force directions.
        wanted: force along each of them [N].
        deflections: wanted of the grasp along each of them [m].
        softness: compliance of the grasp [m/N], its mean.
        position_part: I - P (3, 3), what follows the path.
        tip: filtered place of the tip [m].
        lever: from T's origin to the tip [m].
        tip_to_C: from the wanted tip to the gripper, the deflection fed forward [m].
    """

    normals: tuple[Triple, ...] = ()
    wanted: tuple[float, ...] = ()
    deflections: tuple[float, ...] = ()
    softness: float = 1e-3
    position_part: Rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    tip: Triple = _ORIGIN
    lever: Triple = _ORIGIN
    tip_to_C: Triple = _ORIGIN


class Walk:
    """Moves the undeflected tip along the force directions with bounded speed; elsewhere it follows the path."""

    def __init__(self, features: Features, parameters: ControllerParameters) -> None:
        self.features, self.parameters = features, parameters
        self.observers: list[SurfaceObserver] = []  # one per force direction
        self.undeflected: Triple = _ORIGIN  # commanded place of the tip if the grasp were not deflected

    def target(self, s: HybridSetpoint, plan: Plan, contact: bool, dt: float, lead: float, loop_time: float) -> Triple:
        """Wanted gripper position p_WC [m] for this step of dt [s].

        Args:
            lead: [s] by which the arm trails its command.
            loop_time: [s] from an image to the arm's answer, which bounds the approach.
        """
        tip = along(s.X_W_tip[:3, 3].tolist(), lead, s.velocity.tolist())
        if not self.observers:
            return plus(tip, plan.tip_to_C)
        undeflected = plus(plus(tip, plan.tip_to_C), plan.lever)
        goal = turned(plan.position_part, undeflected)
        for i, n in enumerate(plan.normals):
            now = dot(n, self.undeflected)
            step = self._height(i, plan, contact, tip, undeflected) - now
            bound = self._speed(i, plan, contact, s.approach_speed, loop_time) * dt
            goal = along(goal, now + min(max(step, -bound), bound), n)
        self.undeflected = goal
        return minus(goal, plan.lever)

    def _height(self, i: int, plan: Plan, contact: bool, tip: Triple, undeflected: Triple) -> float:
        """Wanted height of the undeflected tip along normal i."""
        n = plan.normals[i]
        if contact and self.features.observer:
            observer = self.observers[i]
            return dot(n, observer.place) + observer.target(n, tip, plan.deflections[i])
        if not contact and plan.wanted[i] == 0.0:  # nothing to walk towards
            return dot(n, undeflected)
        return dot(n, plan.tip) + plan.deflections[i]

    def _speed(self, i: int, plan: Plan, contact: bool, approach_speed: float | None, loop_time: float) -> float:
        """Bound on the speed along n: before contact the grasp must not deflect further within a loop than wanted."""
        v = approach_speed or self.parameters.approach_speed
        if not self.features.observer:
            return v
        needed = abs(plan.wanted[i]) * plan.softness
        if contact:
            return max(v, min(self.parameters.press_speed, needed / _PRESS_TIME))
        return min(v, max(_APPROACH_SHARE * needed / loop_time, _SLOWEST))

# SPDX-License-Identifier: Apache-2.0
"""The gripper's wanted place at every step between two images: along the path, and with bounded speed along forces."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_core.vector3 import ZERO, Vector3, dot, minus, plus, plus_scaled

_SLOWEST = 1e-3  # [m/s]


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
    reach: float = inf


class TipReference:
    """Moves the undeflected tip along its courses; elsewhere it follows the path.

    Attributes:
        undeflected: commanded place of the tip if the grasp were not deflected [m].
        to_undeflected: from the wanted tip to it, by the deflection that is fed forward [m].
    """

    def __init__(self) -> None:
        self.undeflected = self.to_undeflected = self._lever = ZERO
        self._courses: Sequence[Course] = ()

    def place(self, lever: Vector3, tip_to_C: Vector3) -> None:
        """Where an image has the grasp, in W: lever [m] from T's origin to the tip, tip_to_C [m] fed forward."""
        self._lever, self.to_undeflected = lever, plus(tip_to_C, lever)

    def follow(self, courses: Sequence[Course]) -> None:
        """One course per force direction, from now on."""
        self._courses = courses

    def target(self, s: HybridSetpoint, dt: float, lead: float, loop_time: float) -> Vector3:
        """Wanted gripper position p_WC [m] for this step of dt [s].

        Args:
            lead: [s] by which the arm trails its command.
            loop_time: [s] from an image to the arm's answer, which bounds the approach.
        """
        tip = plus_scaled(s.X_W_tip[:3, 3].tolist(), lead, s.velocity.tolist())
        path = goal = plus(tip, self.to_undeflected)
        for n, offset, gradient, speed, reach in self._courses:
            now = dot(n, self.undeflected)
            bound = min(speed, max(reach / loop_time, _SLOWEST)) * dt
            step = min(max(offset + dot(gradient, tip) - now, -bound), bound)
            goal = plus_scaled(goal, now + step - dot(n, path), n)
        self.undeflected = goal
        return minus(goal, self._lever)

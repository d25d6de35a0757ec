# SPDX-License-Identifier: Apache-2.0
"""How far the gripper may go towards a wanted displacement of the grasp that nothing resists.

A tool that is free goes with the gripper, which would follow it on and on. The way is kept while something else is
followed: see left_way.py.
"""

from math import degrees, radians

import numpy as np

from seed_control.command.left_way import LeftWay
from seed_core.arm.quaternion import Quaternion, turn_between, turned
from seed_core.bushing import Stiffness
from seed_core.spatial import Array, so3_log
from seed_core.vector3 import Vector3, minus, norm, scaled

_REACHED = 0.7  # share of the wanted displacement from which on something resists it
_LEAST = 1e-3  # [J] of a wanted displacement: less is told from noise by nothing


class DisplacementTravel:
    """The way since the displacement was last reached.

    `image` with each image, `step` with each command, or `leave` while something else is followed.
    """

    def __init__(self, way: float, turn: float) -> None:
        """Bounds [m] and [deg]."""
        self._way, self._turn = way, turn
        self._start: tuple[Vector3, Quaternion] | None = None
        self._left = LeftWay(way), LeftWay(radians(turn))  # [m], [rad], while something else is followed
        self._now: tuple[Vector3, Quaternion] | None = None  # where that has come to, ...
        self._own = True  # ... by a place that was asked for

    def restart(self) -> None:
        """It is counted from where the command is next."""
        self._start = self._now = None
        for left in self._left:
            left.forget()

    def leave(self, p_WC: Vector3, q_WE: Quaternion, dt: float, own: bool) -> None:
        """A step of dt [s] of something else, to a place of C [m] and a rotation of the flange.

        Args:
            own: it goes to a place that was asked for, not in search of a force.
        """
        if self._start is not None:
            p, q = self._start
            for left, gone in zip(self._left, (minus(p_WC, p), turn_between(q_WE, q)), strict=True):
                left.leave(gone)
            self._start = None
        else:
            self._went(p_WC, q_WE, dt)
        self._now, self._own = (p_WC, q_WE), own

    def _went(self, p_WC: Vector3, q_WE: Quaternion, dt: float) -> None:
        """The step before was one of what was followed then."""
        if self._own and self._now is not None:
            p, q = self._now
            for left, went in zip(self._left, (minus(p_WC, p), turn_between(q_WE, q)), strict=True):
                left.move(went, dt)

    def image(self, wanted: Array, measured: Array, stiffness: Stiffness) -> None:
        """Take in an image: wanted and measured X_TC (4, 4)."""
        a, b, K = _vector(wanted), _vector(measured), stiffness.vector()
        energy = float(a @ (K * a))
        if energy > _LEAST and float(a @ (K * b)) > _REACHED * energy:
            self.restart()

    def step(self, p_WC: Vector3, q_WE: Quaternion, dt: float) -> str:
        """Take in the commanded place of C [m] and rotation of the flange after dt [s]; why to hold, '' for nothing."""
        if self._start is None:
            self._went(p_WC, q_WE, dt)
            gone, turned_by = (left.gone for left in self._left)
            self._start, self._now = (minus(p_WC, gone), turned(q_WE, scaled(turned_by, -1.0))), None
        p, q = self._start
        way, turn = norm(minus(p_WC, p)), degrees(norm(turn_between(q_WE, q)))
        if way <= self._way and turn <= self._turn:
            return ""
        return (
            f"the displacement is not reached within max_free_travel = {1e3 * self._way:.0f} mm and max_drift = "
            f"{self._turn:g} degrees (gone: {1e3 * way:.0f} mm, {turn:.0f} degrees): nothing resists the tool there"
        )


def _vector(X: Array) -> Array:
    return np.concatenate((so3_log(X[:3, :3]), X[:3, 3]))

# SPDX-License-Identifier: Apache-2.0
"""How far the gripper may go towards a wanted displacement of the grasp that nothing resists.

A tool that is free goes with the gripper, which would follow it on and on. The way is kept while something else is
followed: see left_way.py.
"""

from collections.abc import Callable
from math import degrees, radians

import numpy as np

from seed_control.command.left_way import LeftWay
from seed_core.arm.quaternion import Quaternion, turn_between, turned
from seed_core.bushing import Stiffness
from seed_core.spatial import Array, so3_log
from seed_core.vector3 import Vector3, minus, norm, plus_scaled, scaled

_REACHED = 0.7  # share of the wanted displacement from which on something resists it
_LEAST = 1e-3  # [J] of a wanted displacement: less is told from noise by nothing

Stopping = Callable[[float], float]


class DisplacementTravel:
    """The way since the displacement was last reached.

    `image` with each image, `step` with each command, or `leave` while something else is followed.
    """

    def __init__(self, way: float, turn: float, stopping: Stopping, turning: Stopping) -> None:
        """Bounds [m] and [deg]. stopping, turning: way [m], [rad] to rest from a speed [m/s], [rad/s]."""
        self._way, self._turn, self._stopping, self._turning = way, turn, stopping, turning
        self._before: tuple[Vector3, Quaternion] | None = None  # where the command was a step ago
        self._start: tuple[Vector3, Quaternion] | None = None
        self._left = LeftWay(way), LeftWay(radians(turn))  # [m], [rad], while something else is followed
        self._now: tuple[Vector3, Quaternion] | None = None  # where that has come to, ...
        self._own = True  # ... by a place that was asked for

    def restart(self) -> None:
        """It is counted from where the command is next."""
        self._start = self._now = self._before = None
        for left in self._left:
            left.forget()

    def leave(self, p_WC: Vector3, q_WE: Quaternion, dt: float, own: bool) -> None:
        """A step of dt [s] of something else, to a place of C [m] and a rotation of the flange.

        Args:
            own: it goes to a place that was asked for, not in search of a force.
        """
        self._before = None
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
            way_gone, turn_gone = (left.gone for left in self._left)
            self._start, self._now = (minus(p_WC, way_gone), turned(q_WE, scaled(turn_gone, -1.0))), None
        p, q = self._start
        gone, turned_by = minus(p_WC, p), turn_between(q_WE, q)
        p, q = self._before or (p_WC, q_WE)
        self._before = p_WC, q_WE
        way = _at_rest(gone, minus(p_WC, p), dt, self._stopping)
        turn = degrees(_at_rest(turned_by, turn_between(q_WE, q), dt, self._turning))
        if way <= self._way and turn <= self._turn:
            return ""
        return (
            f"the displacement is not reached within max_free_travel = {1e3 * self._way:.0f} mm and max_drift = "
            f"{self._turn:g} degrees (gone: {1e3 * norm(gone):.0f} mm, {degrees(norm(turned_by)):.0f} degrees, and the "
            "way to rest): nothing resists the tool there"
        )


def _vector(X: Array) -> Array:
    return np.concatenate((so3_log(X[:3, :3]), X[:3, 3]))


def _at_rest(gone: Vector3, moved: Vector3, dt: float, stopping: Stopping) -> float:
    """How far [m], [rad] it is at rest, if it brakes after a step more; at least how far it is now."""
    size = norm(moved)
    ahead = 0.0 if not size else 1.0 + stopping(size / dt) / size  # steps as the last one
    return max(norm(gone), norm(plus_scaled(gone, ahead, moved)))

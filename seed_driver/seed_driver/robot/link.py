# SPDX-License-Identifier: Apache-2.0
"""Judgement of the link to the robot, and of the robot's ability to move, from measurements alone.

ur_rtde's return values say nothing about the link (a dead one accepts commands for ever), so they are not used.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, pi

from seed_core.errors import FailedError
from seed_ur.models import JOINT_NAMES

LOST_AFTER = 0.06  # [s] without an advancing controller clock
AWAKE = 0.04  # [s] of it we must have been awake, so that our own pause is not taken for the robot's
CYCLE = 0.01  # [s] a longer one is a pause
GIVE_UP_AFTER = 0.5  # [s] ur_rtde would reconnect by itself, and crash, at 2.5 s
PLAYING = 2  # runtime state of a program that runs
ENDED = (0, 1)  # runtime states of a program that stops, or has
RUNNING = 7  # robot mode of an arm that can move
_SAFETY_STOPS = {  # by their bit in safety_status_bits, the most telling first
    2: "protective stop",
    7: "emergency stop",
    6: "emergency stop (robot)",
    5: "emergency stop (system)",
    4: "safeguard stop",
    3: "recovery mode",
    8: "safety violation",
    9: "safety fault",
    10: "stopped by safety",
}
_ANY_STOP = sum(1 << bit for bit in _SAFETY_STOPS)
_MODES = {
    -1: "no controller",
    0: "disconnected",
    1: "waiting for a safety confirmation",
    2: "booting",
    3: "powered off",
    4: "powered on, brakes closed",
    5: "idle, brakes closed",
    6: "in backdrive",
    8: "updating its firmware",
}


JOINT_RANGE = 2.0 * pi  # [rad] either way, of every joint of every arm
NEAR = 0.06  # [rad] from it


class LinkError(FailedError):
    """The controller cannot be used as it is; the message says why and what to do."""


class AbsentError(LinkError):
    """Nobody is there yet, or nobody who answers: waiting is enough, nothing was refused."""


@dataclass
class LinkWatch:
    """Follows a sign of life: the controller's clock, or whatever else changes while it lives."""

    sign: float = -1.0
    advanced_at: float = 0.0
    _looked_at: float = 0.0
    _awake: float = 0.0

    def update(self, sign: float, now: float) -> bool:
        """Note the sign at our time `now` [s]; True when it has changed."""
        if sign != self.sign:
            self.restart(sign, now)
            return True
        self._awake += min(CYCLE, now - self._looked_at)
        self._looked_at = now
        return False

    def restart(self, sign: float, now: float) -> None:
        """The controller lives at our time `now` [s]."""
        self.sign, self.advanced_at, self._looked_at, self._awake = sign, now, now, 0.0

    def _silent(self, now: float, seconds: float) -> bool:
        return now - self.advanced_at > seconds and self._awake >= AWAKE

    def lost(self, now: float) -> bool:
        """Whether there has been no sign for too long."""
        return self._silent(now, LOST_AFTER)

    def hopeless(self, now: float) -> bool:
        """Whether ur_rtde has to be put down before it tries to help itself."""
        return self._silent(now, GIVE_UP_AFTER)


def safety_stop(safety_bits: int) -> str:
    """Name of the safety stop in force, empty when the arm may move."""
    if not safety_bits & _ANY_STOP:  # this runs in every cycle
        return ""
    return next((name for bit, name in _SAFETY_STOPS.items() if safety_bits >> bit & 1), "")


def at_range_end(q: Sequence[float]) -> str:
    """Which joint is at the end of its range, as the robot's stop does not tell; empty when none is."""
    for name, angle in zip(JOINT_NAMES, q, strict=True):
        if abs(angle) > JOINT_RANGE - NEAR:
            end = f"its range ends at {degrees(JOINT_RANGE):.0f}"
            return f"{name} is at {degrees(angle):.1f} degrees, {end}: turn it back on the pendant"
    return ""


def unable(robot_mode: int, safety_bits: int) -> str:
    """Why the arm cannot move, empty when it can."""
    if stop := safety_stop(safety_bits):
        return stop
    return "" if robot_mode == RUNNING else f"robot is {_MODES.get(robot_mode, f'in mode {robot_mode}')}"

# SPDX-License-Identifier: Apache-2.0
"""Whether the link to the robot is alive and the robot able to move, judged from measurements alone.

ur_rtde's return values say nothing about the link (a dead one accepts commands for ever), so they are not used.
"""

from __future__ import annotations

from dataclasses import dataclass

LOST_AFTER = 0.06  # [s] without an advancing controller clock
LOST_TICKS = 10  # and this many of our own cycles, so that our own pause is not taken for the robot's
GIVE_UP_AFTER = 0.5  # [s] ur_rtde would reconnect by itself, and crash, at 2.5 s
PLAYING = 2
RUNNING = 7
_SAFETY_STOPS = {
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


@dataclass
class LinkWatch:
    """Follows the controller's clock."""

    timestamp: float = -1.0
    advanced_at: float = 0.0
    ticks_since: int = 0

    def update(self, timestamp: float, now: float) -> bool:
        """Note the controller's clock at our time `now` [s]; True when it has advanced."""
        self.ticks_since += 1
        if timestamp == self.timestamp:
            return False
        self.timestamp, self.advanced_at, self.ticks_since = timestamp, now, 0
        return True

    def lost(self, now: float) -> bool:
        """Whether the clock has stood still for too long."""
        return now - self.advanced_at > LOST_AFTER and self.ticks_since >= LOST_TICKS

    def hopeless(self, now: float) -> bool:
        """Whether ur_rtde has to be put down before it tries to help itself."""
        return now - self.advanced_at > GIVE_UP_AFTER and self.ticks_since >= LOST_TICKS


def safety_stop(safety_bits: int) -> str:
    """Name of the safety stop in force, empty when the arm may move."""
    if not safety_bits & _ANY_STOP:
        return ""
    return next((name for bit, name in _SAFETY_STOPS.items() if safety_bits >> bit & 1), "")


def unable(robot_mode: int, safety_bits: int) -> str:
    """Why the arm cannot move, empty when it can."""
    stop = safety_stop(safety_bits)
    if stop:
        return stop
    return "" if robot_mode == RUNNING else f"robot is {_MODES.get(robot_mode, f'in mode {robot_mode}')}"

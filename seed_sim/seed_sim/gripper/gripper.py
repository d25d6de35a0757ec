# SPDX-License-Identifier: Apache-2.0
"""A parallel gripper between command and fingers: it answers late, moves at a limited speed and pushes only so much."""

from collections import deque
from dataclasses import dataclass
from math import isfinite, nan

from seed_core.config import field

_INNER = 0.01  # [s] of the loop that turns a wanted force into motion


@dataclass(frozen=True)
class GripperSection:
    """The gripper's own limits."""

    speed: float = field(0.15, unit="m/s", low=0.001, high=5.0, doc="of the width")
    latency: float = field(0.015, unit="s", low=0.0, high=1.0, doc="from a command to any motion")
    max_force: float = field(
        40.0, unit="N", low=0.1, high=500.0, doc="push of each finger at which it closes no further"
    )
    min_width: float = field(0.0, unit="m", low=0.0, high=0.2, doc="its fingers come no closer")
    max_width: float = field(0.11, unit="m", low=0.0, high=0.5, doc="its fingers open no further")
    answers: bool = field(True, doc="false: it takes commands and does nothing")


class SimulatedGripper:
    """Fingers at `width` [m]. `command_width` or `command_force`, then `advance` in time with the push of a finger."""

    def __init__(self, section: GripperSection, width: float) -> None:
        self.section, self.width = section, width
        self._waiting: deque[tuple[float, float, float]] = deque()  # due [s], width [m], force [N]; one is nan
        self._width, self._force = width, nan

    def restart(self, width: float) -> None:
        """At rest at a width [m], without commands."""
        self.width = self._width = width
        self._force = nan
        self._waiting.clear()

    def command_width(self, t: float, width: float) -> None:
        """Go to a width [m]; asked at t [s]."""
        self._take(t, width, nan)

    def command_force(self, t: float, force: float) -> None:
        """Push with a force [N] of each finger; asked at t [s]."""
        self._take(t, nan, force)

    def _take(self, t: float, width: float, force: float) -> None:
        if self.section.answers and (isfinite(width) or isfinite(force)):
            self._waiting.append((t + self.section.latency, width, force))

    def advance(self, t: float, dt: float, push: float, rise: float) -> float:
        """The width [m] after dt [s] up to t [s].

        Args:
            push: [N] of each finger now.
            rise: [N/m] of that push per closed metre of width, about.
        """
        s = self.section
        while self._waiting and self._waiting[0][0] <= t + 1e-9:
            _, self._width, self._force = self._waiting.popleft()
        if isfinite(self._force):
            way = (push - min(self._force, s.max_force)) / max(rise, 1.0) * min(dt / _INNER, 1.0)
        else:
            way = self._width - self.width
        if way < 0.0 and push >= s.max_force:
            way = 0.0
        way = min(max(way, -s.speed * dt), s.speed * dt)
        self.width = min(max(self.width + way, s.min_width), s.max_width)
        return self.width

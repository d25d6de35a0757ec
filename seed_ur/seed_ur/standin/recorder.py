# SPDX-License-Identifier: Apache-2.0
"""The record of what a stand-in received and how its arm moved, for tests and benchmarks."""

from array import array
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from itertools import pairwise
from math import hypot
from typing import Any, NamedTuple

from seed_core.vector3 import Vector3


class Sample(NamedTuple):
    """The arm at one cycle."""

    time: float  # [s] host's monotonic clock
    position: Vector3  # of the TCP in W [m]
    speed: float  # of the TCP [m/s]
    turning: float  # of the TCP [rad/s]


class Recorder:
    """Statistics since the last reset and the motion of the last minute."""

    def __init__(self) -> None:
        self.history: deque[Sample] = deque(maxlen=30_000)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.history.clear()
        self.commands: Counter[int] = Counter()
        self.servo_times: deque[float] = deque(maxlen=120_000)  # [s] monotonic, when servo commands arrived
        self.targets: deque[tuple[float, ...]] = deque(maxlen=5_000)  # time, then the six numbers of the command
        self.lateness = array("d")  # [s] of ticks
        self.top_speed = self.top_turning = self.top_joint = 0.0
        self.outputs_sent = self.outputs_dropped = 0

    def command(self, command: int, now: float, numbers: Sequence[float]) -> None:
        """A package that wrote the command register."""
        self.commands[command] += 1
        if command in (11, 24):
            self.servo_times.append(now)
            self.targets.append((now, *numbers))

    def state(self, now: float, pose: Sequence[float], speed: Sequence[float], qd: Sequence[float]) -> None:
        """The arm after a cycle: pose and velocity (linear first) of the TCP, joint speeds."""
        linear, turning = hypot(*speed[:3]), hypot(*speed[3:])
        self.history.append(Sample(now, (pose[0], pose[1], pose[2]), linear, turning))
        self.top_speed = max(self.top_speed, linear)
        self.top_turning = max(self.top_turning, turning)
        self.top_joint = max(self.top_joint, max(qd), -min(qd))

    def tick(self, lateness: float) -> None:
        """How late a cycle started."""
        if len(self.lateness) < 500_000:
            self.lateness.append(lateness)

    def report(self) -> dict[str, Any]:
        """Everything as JSON data."""
        gaps = [b - a for a, b in pairwise(self.servo_times)]
        return {
            "commands": {str(k): v for k, v in self.commands.items()},
            "servo_count": len(self.servo_times),
            "servo_period": _quantiles(gaps),
            "top_speed": self.top_speed,
            "top_turning": self.top_turning,
            "top_joint_speed": self.top_joint,
            "tick_lateness": _quantiles(self.lateness),
            "outputs_sent": self.outputs_sent,
            "outputs_dropped": self.outputs_dropped,
        }

    def motion(self, since: float) -> list[list[float]]:
        """[time, x, y, z, speed, turning] of every cycle after `since` (monotonic) [s]."""
        return [[s.time, *s.position, s.speed, s.turning] for s in self.history if s.time > since]


def _quantiles(values: Iterable[float]) -> dict[str, float | None]:
    ordered = sorted(values)
    shares = {"p50": 0.5, "p99": 0.99, "max": 1.0}
    last = len(ordered) - 1
    return {name: ordered[min(last, int(q * len(ordered)))] if ordered else None for name, q in shares.items()}

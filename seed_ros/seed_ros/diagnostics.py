# SPDX-License-Identifier: Apache-2.0
"""A node's own health: events counted by cause, and a status on /diagnostics once a second.

By one convention every status has the values
- `rate_hz`: of the node's main output, since the last report,
- `latency_ms`: mean age of what that output stands on, empty where nothing ages,
- `lost`: messages, images or targets that came, or should have come, and were not used,
- `reason`: why it is not well, in words; empty while the level is OK,
and then those of its own.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from seed_core.errors import SeedError
from seed_ros.conversions import stamp_from_seconds

OK, WARN, ERROR, STALE = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE
Report = tuple[bytes, str, Mapping[str, object]]  # level, message, values
PERIOD = 1.0  # [s] between two reports, by the machine's clock: a simulated one may stand still
SELDOM = 600.0  # [s] between two lines of the same words, after they were said twice as seldom each time
MOST_CAUSES, OTHERS = 60, "others"  # words with numbers in them make many causes, and a node may run for months


class Counters:
    """Nothing is dropped silently: counts events by cause, logs each now and then, keeps the last words."""

    def __init__(self, node: Node, repeat: float = 5.0) -> None:
        """repeat: [s] the same cause is not logged earlier; one with the same words each time twice as late."""
        self._node, self._repeat = node, repeat
        self._counts: Counter[str] = Counter()
        self._total = 0
        self._logged: dict[str, tuple[float, float, str]] = {}  # by cause: [s] when it was last, [s] until again, words
        self.last = ""

    def add(self, cause: str, reason: str) -> None:
        """One event of a cause (a word for diagnostics), with its reason in words."""
        if cause not in self._counts and len(self._counts) >= MOST_CAUSES:
            cause = OTHERS
        self._counts[cause] += 1
        self._total += 1
        self.last = reason
        now = self._node.get_clock().now().nanoseconds * 1e-9
        last, pause, words = self._logged.get(cause, (float("-inf"), self._repeat, reason))
        waited = now - last
        if waited < 0.0 or waited >= (pause if words == reason else self._repeat):
            goes_on = words == reason and 0.0 <= waited < 2.0 * pause
            self._logged[cause] = now, min(2.0 * pause, SELDOM) if goes_on else self._repeat, reason
            self._node.get_logger().warning(reason)

    @contextmanager
    def refusing(self, cause: str) -> Iterator[None]:
        """Count a SeedError raised in this context."""
        try:
            yield
        except SeedError as error:
            self.add(cause, str(error))

    def __getitem__(self, cause: str) -> int:
        return self._counts[cause]

    def values(self) -> Mapping[str, int]:
        """Every count so far."""
        return dict(self._counts)

    def total(self) -> int:
        """All events."""
        return self._total


class Beats:
    """A node's main output: how often it comes, and how old what it stands on is."""

    def __init__(self) -> None:
        self._count, self._aged, self._ages, self._since = 0, 0, 0.0, time.monotonic()

    def add(self, latency: float | None = None) -> None:
        """One output; latency: age of what it stands on [s], None where nothing ages."""
        self._count += 1
        if latency is not None and np.isfinite(latency):
            self._aged, self._ages = self._aged + 1, self._ages + latency

    def take(self) -> dict[str, object]:
        """Rate and latency since the last call."""
        now = time.monotonic()
        rate = self._count / max(now - self._since, 1e-3)
        latency = round(1e3 * self._ages / self._aged, 3) if self._aged else ""
        self._count, self._aged, self._ages, self._since = 0, 0, 0.0, now
        return {"rate_hz": round(rate, 2), "latency_ms": latency}


def percentiles_ms(name: str, samples: Sequence[float], digits: int) -> dict[str, float]:
    """Median and 99th percentile of samples [s] as diagnostic values in ms."""
    p50, p99 = np.percentile(np.array(samples) * 1e3, (50, 99))
    return {f"{name}_p50_ms": round(float(p50), digits), f"{name}_p99_ms": round(float(p99), digits)}


class Diagnostics:
    """Publishes what `report()` returns, once a second."""

    def __init__(
        self,
        node: Node,
        hardware_id: str,
        report: Callable[[], Report],
        beats: Beats,
        counters: Counters,
        name: str = "",
        timed: bool = True,
    ) -> None:
        """Publish from now on.

        Args:
            hardware_id: of the device that the status is about.
            report: returns level, message and values; a value `lost` counts beside the counters.
            beats, counters: of the node, for the values of the convention.
            name: of the status; empty: the node's own.
            timed: once a second by a timer; otherwise at each call of `publish` alone.
        """
        self._hardware_id, self._report = hardware_id, report
        self._now: Callable[[], float] = getattr(node, "now", lambda: node.get_clock().now().nanoseconds * 1e-9)
        self._beats, self._counters = beats, counters
        self._name = name or node.get_fully_qualified_name()
        self.publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        if timed:
            node.create_timer(PERIOD, self.publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def publish(self) -> None:
        """Publish now."""
        array = DiagnosticArray(status=[self.status()])
        array.header.stamp = stamp_from_seconds(self._now())
        self.publisher.publish(array)

    def status(self) -> DiagnosticStatus:
        """What is published; rate and latency are those since the last call."""
        level, message, values = self._report()
        status = DiagnosticStatus(level=level, name=self._name, message=message, hardware_id=self._hardware_id)
        own = dict(values)
        lost = self._counters.total() + int(str(own.pop("lost", 0)))
        said = message if level != OK else ""
        shared = self._beats.take() | {"lost": lost, "reason": said}
        status.values = [KeyValue(key=str(k), value=str(v)) for k, v in (shared | own).items()]
        return status

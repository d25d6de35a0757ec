# SPDX-License-Identifier: Apache-2.0
"""A node's own health: events counted by cause, and a status on /diagnostics once a second."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from seed_core.errors import SeedError
from seed_ros.conversions import stamp_from_seconds

OK, WARN, ERROR, STALE = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE
Report = tuple[bytes, str, Mapping[str, object]]  # level, message, values
PERIOD = 1.0  # [s] between two reports


class Counters:
    """Nothing is dropped silently: counts events by cause, logs each now and then, keeps the last words."""

    def __init__(self, node: Node, repeat: float = 5.0) -> None:
        """repeat: [s] the same cause is not logged earlier."""
        self._node, self._repeat = node, repeat
        self._counts: Counter[str] = Counter()
        self._total = 0  # asked for in every period, while words with numbers in them make many causes
        self._logged: dict[str, float] = {}  # [s] when each cause was logged last
        self.last = ""

    def add(self, cause: str, reason: str) -> None:
        """One event of a cause (a word for diagnostics), with its reason in words."""
        self._counts[cause] += 1
        self._total += 1
        self.last = reason
        now = self._node.get_clock().now().nanoseconds * 1e-9
        if not 0.0 <= now - self._logged.get(cause, float("-inf")) < self._repeat:
            self._logged[cause] = now
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


def percentiles_ms(name: str, samples: Sequence[float], digits: int) -> dict[str, float]:
    """Median and 99th percentile of samples [s] as diagnostic values in ms."""
    p50, p99 = np.percentile(np.array(samples) * 1e3, (50, 99))
    return {f"{name}_p50_ms": round(float(p50), digits), f"{name}_p99_ms": round(float(p99), digits)}


class Diagnostics:
    """Publishes what `report()` returns, once a second."""

    def __init__(
        self, node: Node, hardware_id: str, report: Callable[[], Report], name: str = "", timed: bool = True
    ) -> None:
        """Publish from now on.

        Args:
            hardware_id: of the device that the status is about.
            report: returns level, message and values.
            name: of the status; empty: the node's own.
            timed: once a second by a timer; otherwise at each call of `publish` alone.
        """
        self._hardware_id, self._report = hardware_id, report
        self._now: Callable[[], float] = getattr(node, "now", lambda: node.get_clock().now().nanoseconds * 1e-9)
        self._name = name or node.get_fully_qualified_name()
        self.publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        if timed:
            node.create_timer(PERIOD, self.publish)

    def publish(self) -> None:
        """Publish now."""
        level, message, values = self._report()
        status = DiagnosticStatus(level=level, name=self._name, message=message, hardware_id=self._hardware_id)
        status.values = [KeyValue(key=str(k), value=str(v)) for k, v in values.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = stamp_from_seconds(self._now())
        self.publisher.publish(array)

# SPDX-License-Identifier: Apache-2.0
"""Nothing is dropped silently: events by cause, and the last words about each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from rclpy.node import Node

REPEAT = 5.0  # [s] the same kind of complaint is not logged earlier


class Complaints:
    """Counts what was refused, logs it at most every 5 s per kind, and keeps the last reason."""

    def __init__(self, node: Node) -> None:
        self._logger = node.get_logger()
        self._clock = node.get_clock()
        self._counts: Counter[str] = Counter()
        self._said: dict[str, float] = {}
        self.last = ""

    def add(self, kind: str, reason: str) -> None:
        """One event of a kind (a word for diagnostics), with its reason in words."""
        self._counts[kind] += 1
        self.last = reason
        now = self._clock.now().nanoseconds * 1e-9
        if not 0.0 <= now - self._said.get(kind, float("-inf")) < REPEAT:
            self._said[kind] = now
            self._logger.warning(reason)

    def __getitem__(self, kind: str) -> int:
        return self._counts[kind]

    def values(self) -> Mapping[str, int]:
        """Every count so far."""
        return dict(self._counts)

    def total(self) -> int:
        """All events."""
        return sum(self._counts.values())

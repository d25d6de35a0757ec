# SPDX-License-Identifier: Apache-2.0
"""Answers that do not come: every one that is waited for has a time until which it must be there."""

import threading
import time
from typing import Any

from rclpy.task import Future

from seed_core.errors import SeedError


class NotDoneError(SeedError):
    """The cell did not do what was asked, in its own words."""


class UnansweredError(NotDoneError):
    """Nobody knows whether the cell did it."""


class Deadlines:
    """`look` often: what is late by then has an UnansweredError for an answer."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._awaited: list[tuple[float, Future, str]] = []

    def expect(self, future: Future, patience: float, name: str) -> None:
        """An answer that does not come within patience [s] is an error."""
        with self._lock:
            self._awaited.append((time.monotonic() + patience, future, name))

    async def within(self, future: Future, patience: float, name: str) -> Any:
        """The answer."""
        self.expect(future, patience, name)
        return await future

    def look(self, now: float) -> None:
        """End what was waited for too long at now [s, monotonic]."""
        with self._lock:
            late = [d for d in self._awaited if now > d[0]]
            self._awaited = [d for d in self._awaited if now <= d[0] and not d[1].done()]
        for _, future, name in late:
            if not future.done():
                future.set_exception(UnansweredError(f"no answer of {name}"))

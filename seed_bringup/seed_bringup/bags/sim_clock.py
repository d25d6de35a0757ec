# SPDX-License-Identifier: Apache-2.0
"""What a simulated clock showed at a moment of this computer's, between two of its messages."""

from bisect import bisect_right

SILENT = 5 * 10**9  # [ns] after which a clock that says nothing stands


class SimClock:
    """`heard` takes its messages; `at` tells it. Times are in [ns]."""

    def __init__(self) -> None:
        self._arrived: list[int] = []
        self._shown: list[int] = []

    def __bool__(self) -> bool:
        """Whether it was heard."""
        return bool(self._arrived)

    def heard(self, arrived: int, shown: int) -> None:
        """A message that has arrived then, by this computer."""
        if not self._arrived or arrived > self._arrived[-1]:
            self._arrived.append(arrived)
            self._shown.append(shown)

    def at(self, arrived: int, now: int) -> int | None:
        """What it showed, straight between two messages; None while the one after may still come.

        Before the first it is 0. One that was set back, or is silent until `now`, shows what it has shown last.
        """
        i = bisect_right(self._arrived, arrived)
        if i == 0:
            return 0 if self._arrived or now - arrived > SILENT else None
        if i == len(self._arrived):
            return self._shown[-1] if now - arrived > SILENT else None
        (before, after), (a, b) = self._arrived[i - 1 : i + 1], self._shown[i - 1 : i + 1]
        return a + max(b - a, 0) * (arrived - before) // (after - before)

    def forget(self, arrived: int) -> None:
        """What is not needed to tell a moment from then on."""
        i = max(bisect_right(self._arrived, arrived) - 1, 0)
        del self._arrived[:i], self._shown[:i]

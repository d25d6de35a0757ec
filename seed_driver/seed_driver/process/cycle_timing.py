# SPDX-License-Identifier: Apache-2.0
"""Times of the servo cycles: the deadlines to keep, and the distribution of the periods that came of it."""

from typing import Any

CLOSEST = 0.85  # [periods] from a command to the cycle of the next
BIN = 20e-6  # [s]
BINS = 1000


class Deadlines:
    """Absolute deadlines, so that the rate is exact; a late cycle moves all that follow, and nothing is caught up.

    A robot that gets two commands in one of its cycles takes them as one long step.
    """

    def __init__(self, period: float, now: float) -> None:
        """period, now: [s]; the first cycle is due now."""
        self._period, self._due = period, now

    def next(self, sent: float) -> float:
        """Time at which the next cycle is due [s], after the last one's command went out at `sent` [s]."""
        self._due = max(self._due + self._period, sent + CLOSEST * self._period)
        return self._due


class PeriodHistogram:
    """Counts periods without keeping them; p50, p99, largest [s] are those of the last second's worth of cycles."""

    def __init__(self) -> None:
        self.p50 = self.p99 = self.largest = 0.0
        self._counts = [0] * (BINS + 1)
        self._longest = 0.0
        self._last = 0.0
        self._recent: list[float] = []

    def tick(self, now: float) -> None:
        """A cycle starts at `now` [s]; a pause over half a second starts afresh."""
        period, self._last = now - self._last, now
        if period > 0.5:
            return
        self._counts[min(BINS, int(period / BIN))] += 1
        self._longest = max(self._longest, period)
        self._recent.append(period)
        if len(self._recent) >= 500:
            ordered = sorted(self._recent)
            self.p50, self.p99, self.largest = ordered[250], ordered[495], ordered[-1]
            self._recent.clear()

    def counts(self) -> dict[str, Any]:
        """All periods so far: {bin_s, counts, max_s}."""
        return {"bin_s": BIN, "counts": self._counts, "max_s": self._longest}

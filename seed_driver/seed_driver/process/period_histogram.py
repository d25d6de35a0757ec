# SPDX-License-Identifier: Apache-2.0
"""The distribution of the servo cycle's period, in bins of 20 microseconds, without keeping samples."""

from __future__ import annotations

from typing import Any

BIN = 20e-6  # [s]
BINS = 1000


class Periods:
    """Counts periods; `p50`, `p99` and `largest` are those of the last whole second's worth of cycles."""

    def __init__(self) -> None:
        self.counts = [0] * (BINS + 1)
        self.p50 = self.p99 = self.largest = 0.0
        self.overall = 0.0
        self._last = 0.0
        self._recent: list[float] = []

    def tick(self, now: float) -> None:
        """A cycle starts at `now` [s]; a pause over half a second starts afresh."""
        period, self._last = now - self._last, now
        if period > 0.5:
            return
        self.counts[min(BINS, int(period / BIN))] += 1
        self.overall = max(self.overall, period)
        self._recent.append(period)
        if len(self._recent) >= 500:
            ordered = sorted(self._recent)
            self.p50, self.p99, self.largest = ordered[250], ordered[495], ordered[-1]
            self._recent.clear()

    def histogram(self) -> dict[str, Any]:
        """All periods so far: {bin_s, counts, max_s}."""
        return {"bin_s": BIN, "counts": self.counts, "max_s": self.overall}


def share_within(histogram: dict[str, Any], period: float, tolerance: float) -> float:
    """Share of cycles whose period is within `tolerance` [s] of `period` [s]."""
    counts, width = histogram["counts"], histogram["bin_s"]
    near = sum(n for i, n in enumerate(counts) if abs((i + 0.5) * width - period) <= tolerance)
    total = sum(counts)
    return near / total if total else 0.0

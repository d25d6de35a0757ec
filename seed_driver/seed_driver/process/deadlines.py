# SPDX-License-Identifier: Apache-2.0
"""When the servo cycles are due: a robot that gets two commands in one of its cycles takes them as one long step."""

from __future__ import annotations

CLOSEST = 0.85  # [periods] from a command to the cycle of the next


class Pace:
    """Absolute deadlines, so that the rate is exact; a late cycle moves all that follow, and nothing is caught up."""

    def __init__(self, period: float, now: float) -> None:
        """period, now: [s]; the first cycle is due now."""
        self._period, self._due = period, now

    def next(self, sent: float) -> float:
        """When the next cycle is due [s], after the last one's command went out at `sent` [s]."""
        self._due = max(self._due + self._period, sent + CLOSEST * self._period)
        return self._due

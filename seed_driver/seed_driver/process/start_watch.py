# SPDX-License-Identifier: Apache-2.0
"""Whether a process that has not spoken yet gets on: a start may be slow, from a cold disk of a busy machine."""

from __future__ import annotations

from pathlib import Path

WORKING = "RD"  # states of a process that waits for a processor or a disk


class Start:
    """The start of a process; `idle` is called often."""

    def __init__(self, pid: int, now: float) -> None:
        """pid: process number; now: [s]."""
        self._file = Path(f"/proc/{pid}/stat")
        self.began = self._worked_at = now
        self._used = 0  # [ticks] of processor time

    def idle(self, now: float) -> float:
        """For how long it has neither worked nor waited for its turn [s]: it is stopped, or in a deadlock."""
        try:
            state, *numbers = self._file.read_text().rpartition(")")[2].split()
        except OSError:  # it has ended
            return 0.0
        used = int(numbers[10]) + int(numbers[11])
        if state in WORKING or used > self._used:
            self._used, self._worked_at = used, now
        return now - self._worked_at

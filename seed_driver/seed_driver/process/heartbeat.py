# SPDX-License-Identifier: Apache-2.0
"""The signs of life of the servo process: work while it starts, and its heartbeat from then on."""

from pathlib import Path
from typing import NamedTuple

from seed_driver.process.shared_memory import ServoState, Stage

LONGEST_START = 40.0  # [s] without a heartbeat while the process starts, from a cold disk of a busy machine
WORKING = "RD"  # states of a process that waits for a processor or a disk


class Patience(NamedTuple):
    """How long a process may give no sign of life [s]."""

    gone: float  # then it counts as gone
    hopeless: float  # then it is to be killed


IDLE = Patience(1.5, 3.0)  # while it starts
SILENT = {
    Stage.SEARCHING: Patience(3.0, 6.0),
    Stage.BUSY: Patience(1.5, 7.0),
    Stage.MONITORING: Patience(0.09, 0.5),
    Stage.SERVOING: Patience(0.09, 0.5),
}


class Heartbeat:
    """Judges one process at a time."""

    def __init__(self) -> None:
        self._longest_start = LONGEST_START
        self.restart(0, 0.0)

    def restart(self, pid: int, now: float) -> None:
        """A process of this number has been started at `now` [s]."""
        self._file = Path(f"/proc/{pid}/stat")
        self._began = self._worked_at = now
        self._used = 0  # [ticks] of processor time

    def doubts(self, now: float, state: ServoState) -> tuple[bool, bool]:
        """Whether the process counts as gone, and whether it is to be killed; called often with its newest state."""
        if state.stage != Stage.STARTING:
            silent, patience = now - state.heartbeat, SILENT[state.stage]
        elif now - self._began > self._longest_start:
            self._longest_start *= 2.0  # a slow machine gets there in the end
            return True, True
        else:
            silent, patience = self._idle(now), IDLE
        return silent > patience.gone, silent > patience.hopeless

    def _idle(self, now: float) -> float:
        """Time [s] in which it has neither worked nor waited for its turn: it is stopped, or in a deadlock."""
        try:
            state, *numbers = self._file.read_text().rpartition(")")[2].split()
        except OSError:  # it has ended
            return 0.0
        used = int(numbers[10]) + int(numbers[11])
        if state in WORKING or used > self._used:
            self._used, self._worked_at = used, now
        return now - self._worked_at

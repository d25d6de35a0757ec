# SPDX-License-Identifier: Apache-2.0
"""The task of the environment: wipe a strip of table with 10 N, and what that is worth."""

import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array

LENGTH = 0.25  # [m] of the strip, along x of the task frame from its origin
CELLS = 25  # of the strip
FORCE = 10.0  # [N] to press with
TOLERANCE = 2.0  # [N] either way within which a pass cleans
FORCE_PRICE = 0.1  # [1/s] for a force that is FORCE off
FAILED = -1.0  # when the arm holds


class Strip:
    """Cells of the strip that are clean, and the reward.

    Attributes:
        clean: (CELLS,) whether each has been passed with the wanted force.
    """

    def __init__(self) -> None:
        self.clean: NDArray[np.bool_] = np.zeros(CELLS, bool)
        self._error, self._count = 0.0, 0

    @property
    def done(self) -> bool:
        """Whether all of it is clean."""
        return bool(self.clean.all())

    def passed(self, tip: Array, force: float) -> None:
        """The tip (3,) [m] in the task frame is there, and presses with this force [N]."""
        off = abs(force - FORCE)
        self._error += min(off / FORCE, 1.0)
        self._count += 1
        cell = int(np.floor(tip[0] / LENGTH * CELLS))
        if off <= TOLERANCE and 0 <= cell < CELLS:
            self.clean[cell] = True

    def reward(self, before: float, duration: float) -> float:
        """Of the passes since the last call: share of the strip that became clean, less the price of wrong force.

        before: share that was clean; duration: [s] of these passes.
        """
        off = self._error / max(self._count, 1)
        self._error, self._count = 0.0, 0
        return float(self.clean.mean() - before - FORCE_PRICE * duration * off)

# SPDX-License-Identifier: Apache-2.0
"""Progress along an axis, and what a wrench without progress means: a jam or a wedge.

D. E. Whitney, "Quasi-static assembly of compliantly supported rigid parts", J. Dyn. Sys. Meas. Control 104, 1982: a peg
jams where lateral force or moment are too large for the axial force, and goes on once their ratio is mended. It is
wedged where the contact forces point at each other: no push, however well directed, moves it on.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array, length

_PUSHES = 0.6  # of the wanted force from which on it counts as pushing
_LEAST = 3e-4  # [m] of progress in the time that is allowed for none
_RATIO = 0.2  # lateral over axial force of a jam
_LEVER = 4e-3  # [m] moment over axial force of a jam


class Push(NamedTuple):
    """One image: time [s], depth [m], axial force [N] along the push, lateral force (3,) [N], moment (3,) [N m]."""

    t: float
    depth: float
    axial: float
    lateral: Array
    moment: Array


class StuckWatch:
    """Whether pushes come to nothing, over a window of time.

    Attributes:
        kind: 'jam' or 'wedge' once it is stuck, '' before.
        moment: (3,) [N m], mean over the window. ratio: lateral over axial force. lever: [m] moment over axial force.
    """

    def __init__(self, wanted: float, window: float) -> None:
        """wanted: [N] along the push. window: [s]."""
        self._wanted, self._window = wanted, window
        self.restart()

    def restart(self) -> None:
        """A new try."""
        self._pushes: deque[Push] = deque()
        self.kind, self.moment, self.ratio, self.lever = "", np.zeros(3), 0.0, 0.0

    def update(self, push: Push) -> str:
        """Take in an image; the kind."""
        pushes = self._pushes
        pushes.append(push)
        if push.t - pushes[0].t < self._window:
            return ""
        while push.t - pushes[0].t > self._window:
            pushes.popleft()
        third = max(len(pushes) // 3, 1)
        depths, axial = np.array([p.depth for p in pushes]), float(np.mean([p.axial for p in pushes]))
        progress = float(depths[-third:].mean() - depths[:third].mean())
        if progress > _LEAST or axial < _PUSHES * self._wanted:
            return ""
        lateral = np.mean([p.lateral for p in pushes], axis=0)
        self.moment = np.mean([p.moment for p in pushes], axis=0)
        self.ratio = length(lateral) / axial
        self.lever = length(self.moment) / axial
        self.kind = "jam" if self.ratio > _RATIO or self.lever > _LEVER else "wedge"
        return self.kind

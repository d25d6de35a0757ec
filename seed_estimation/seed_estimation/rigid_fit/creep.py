# SPDX-License-Identifier: Apache-2.0
"""Doubt in a pose because the membrane creeps: it slides on the tool bit by bit, here and there, and lags behind it.

Each bit stays where it came to rest, so the patch as a whole has turned less than the tool, and every dot agrees with
its neighbours: nothing in one image contradicts the pose. But the dots no longer lie as they did at the grasp, so the
images are explained less well than they were. By how much the pose may be off goes with the furthest that the tool has
been from where it was grasped.
"""

import numpy as np

from seed_core.spatial import Array, so3_log
from seed_estimation.rigid_fit.fit import Fit

# Chosen on bubbles with mechanics, membranes 1 to 3 (docs/estimation_figures.md has the outcome on others): error of
# rotation 4 to 20 % of the furthest turn, of position 1 to 4 % of the furthest way, where the share is 0.025 lower
TURN, WAY = 0.10, 0.03  # [1] of the furthest turn and way
ORDINARY, CREEPT = 0.01, 0.03  # [1] loss of the share explained that is nothing, and that means as much as TURN and WAY
MOST = 1.5  # times that
FIRST = 8  # frames that tell what share is explained at the grasp
MEMORY = 0.1  # weight of one frame in the share's average


class Creep:
    """Of one grasp."""

    def __init__(self) -> None:
        self._frames = 0
        self._share = self._first = 0.0  # [1] explained of the images: now, averaged; in the first frames
        self._turn = self._way = 0.0  # furthest from the grasp [rad], [m]

    def update(self, fit: Fit) -> Array:
        """(6,) variances of [rotation, translation], in any frame, of a fit that is believed."""
        share = float(np.mean(list(fit.explained.values())))
        if self._frames < FIRST:
            self._frames += 1
            self._first += (share - self._first) / self._frames
        self._share += (share - self._share) * max(MEMORY, 1.0 / self._frames)
        self._turn = max(self._turn, float(np.linalg.norm(so3_log(fit.X_CT[:3, :3]))))
        self._way = max(self._way, float(np.linalg.norm(fit.X_CT[:3, 3])))
        crept = float(np.clip((self._first - self._share - ORDINARY) / (CREEPT - ORDINARY), 0.0, MOST))
        return np.repeat(np.square((crept * TURN * self._turn, crept * WAY * self._way)), 3)

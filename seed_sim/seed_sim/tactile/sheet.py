# SPDX-License-Identifier: Apache-2.0
"""The flat sheet of a bubble: the share of the tool's motion by which each point of its material follows.

Material in contact at the grasp sticks to the tool; between it and the fixed rim displacement is harmonic, as in
a stretched sheet. Friction that bears a load lets go from the patch's edge inwards: see `follow_shares`.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_sim.tactile.geometry import Image
from seed_sim.tactile.parameters import TactileParameters

Mask = NDArray[np.bool_]
CELL = 0.001  # [m] of the grid
_LOADS = (0.0, 0.4, 0.7, 0.85, 0.95, 1.0)  # [1] shares of the largest load for which the sheet is solved
_GRIDS = ((8, 200), (4, 200), (2, 200), (1, 300))  # cells per cell of a coarser grid, and steps on it


class Sheet:
    """Shares by load, on cells (z, x) of the sheet.

    Attributes:
        reach: root mean square distance of the patch from its middle [m].
    """

    def __init__(self, touched: NDArray[np.float32], p: TactileParameters) -> None:
        """touched (n, 2): x and z in C of material that the tool touches at the grasp [m]."""
        h, w = int(2 * p.rim_z / CELL) + 3, int(2 * p.rim_x / CELL) + 3
        x, z = np.meshgrid(np.arange(w) - 0.5 * (w - 1), np.arange(h) - 0.5 * (h - 1))
        inside = (x * CELL / p.rim_x) ** 2 + (z * CELL / p.rim_z) ** 2 < 1.0
        patch = np.zeros((h, w), np.uint8)
        column = np.clip(np.round(touched[:, 0] / CELL + 0.5 * (w - 1)).astype(int), 0, w - 1)
        row = np.clip(np.round(touched[:, 1] / CELL + 0.5 * (h - 1)).astype(int), 0, h - 1)
        patch[row, column] = 1
        patch = cv2.morphologyEx(patch, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        cells = np.argwhere(patch)
        self.reach = math.sqrt(float((cells - cells.mean(axis=0)).var(axis=0).sum())) * CELL
        self._shares = follow_shares(patch > 0, inside, _LOADS if p.hold > 0.0 else _LOADS[:1])

    def share(self, load: float) -> Image:
        """Share (z, x) of its motion by which material follows the point of the tool that sticks longest.

        load: share of the largest tangential load, from 0 (all of the patch sticks) to 1 (all of it slides).
        """
        i = min(int(np.searchsorted(_LOADS, load, side="right")) - 1, len(self._shares) - 2)
        if i < 0:
            return self._shares[0]
        weight = np.float32((load - _LOADS[i]) / (_LOADS[i + 1] - _LOADS[i]))
        return np.asarray(self._shares[i] + weight * (self._shares[i + 1] - self._shares[i]))


def share_at(share: Image, m: NDArray[np.float32]) -> Image:
    """Share (z, x) of material m (2, h, w) [m]; 0 beyond the rim."""
    h, w = share.shape
    x = m[0] * np.float32(1.0 / CELL) + np.float32(0.5 * (w - 1))
    z = m[1] * np.float32(1.0 / CELL) + np.float32(0.5 * (h - 1))
    return np.asarray(cv2.remap(share, x, z, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT))


def follow_shares(patch: Mask, inside: Mask, loads: tuple[float, ...]) -> list[Image]:
    """Displacement of the sheet (h, w) over the tool's, for each share of the largest tangential load.

    Coulomb's friction bears up to mu p on the patch, p the bubble's pressure: -laplace(u) = mu p / tension where the
    sheet slides, u = 1 where it sticks. The largest load is the one whose solution just reaches 1 at a single point.
    """
    most = float(_relax(patch, inside, 1.0, math.inf).max())
    return [_relax(patch, inside, math.inf if load == 0.0 else 1.0 / (most * load), 1.0) for load in loads]


def _relax(patch: Mask, inside: Mask, traction: float, ceiling: float) -> Image:
    """u (h, w) <= ceiling, -laplace(u) = traction per cell^2 on `patch`, 0 elsewhere and outside; coarse to fine.

    An infinite traction holds the patch at the ceiling.
    """
    field = patch.astype(np.float32)
    kernel = np.array(((0, 1, 0), (1, 0, 1), (0, 1, 0)), np.float32) / 4.0
    for scale, steps in _GRIDS:
        size = (max(3, patch.shape[1] // scale), max(3, patch.shape[0] // scale))
        one = cv2.resize(patch.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        zero = cv2.resize(inside.astype(np.float32), size, interpolation=cv2.INTER_AREA) < 0.5
        field = cv2.resize(field, size, interpolation=cv2.INTER_LINEAR)
        source = one * np.float32(traction * scale**2 / 4.0) if math.isfinite(traction) else None
        for _ in range(steps):
            field = cv2.filter2D(field, -1, kernel)
            if source is None:
                field[one > 0.5] = ceiling
            else:
                field = np.minimum(field + source, np.float32(ceiling))
            field[zero] = 0.0
    return np.asarray(field, np.float32)

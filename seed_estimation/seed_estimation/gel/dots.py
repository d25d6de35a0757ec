# SPDX-License-Identifier: Apache-2.0
"""Dots on a gel's coat: where they are in an image, to a fraction of a pixel."""

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array
from seed_estimation.images.tactile_images import Mask

LEAST, MOST = 0.25, 3.0  # of a dot's area, from which to which a blot is one


class DotFinder:
    """Of one size of dots."""

    def __init__(self, diameter: float, contrast: float) -> None:
        """diameter [px]; contrast: by which a dot is darker than what is around."""
        side = 2 * round(0.8 * diameter) + 1
        self._box = np.ones((side, side), np.uint8)
        self._area = 0.25 * np.pi * diameter**2
        self._share = contrast
        grow = 2 * max(round(0.15 * diameter), 1) + 1
        self._grow = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (grow, grow))

    def find(self, rgb: NDArray[np.uint8]) -> tuple[Array, Mask]:
        """Middles (N, 2) as (u, v) [px] of dots in an image (H, W, 3), and where dark blots hide the coat (H, W)."""
        grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
        around = cv2.morphologyEx(grey, cv2.MORPH_CLOSE, self._box)
        dark = cv2.subtract(around, grey)
        mask = cv2.compare(dark, cv2.convertScaleAbs(around, alpha=self._share), cv2.CMP_GT)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4, ltype=cv2.CV_16U)
        at = cv2.findNonZero(mask)
        hidden = np.asarray(cv2.dilate(mask, self._grow) > 0, np.uint8)
        if at is None:
            return np.zeros((0, 2)), hidden
        u, v = at.reshape(-1, 2).T
        label, weight = labels[v, u], dark[v, u].astype(float)
        total = np.maximum(np.bincount(label, weight, count), 1e-9)
        middles = np.stack((np.bincount(label, weight * u, count), np.bincount(label, weight * v, count)), 1)
        area = stats[:, cv2.CC_STAT_AREA]
        inside = (stats[:, 0] > 1) & (stats[:, 1] > 1)
        inside &= (stats[:, 0] + stats[:, 2] < grey.shape[1] - 1) & (stats[:, 1] + stats[:, 3] < grey.shape[0] - 1)
        good = inside & (area > LEAST * self._area) & (area < MOST * self._area)
        good[0] = False
        return (middles / total[:, None])[good], hidden


def matched(found: Array, expected: Array, within: float) -> NDArray[np.intp]:
    """For each of expected (N, 2), the index of the found (M, 2) that is nearest, if each is the other's; else -1."""
    if len(found) == 0 or len(expected) == 0:
        return np.full(len(expected), -1)
    square = ((expected[:, None] - found[None]) ** 2).sum(-1)
    nearest, back = square.argmin(1), square.argmin(0)
    mine = np.arange(len(expected))
    good = (back[nearest] == mine) & (square[mine, nearest] < within**2)
    return np.where(good, nearest, -1)

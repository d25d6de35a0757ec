# SPDX-License-Identifier: Apache-2.0
"""One synchronised pair of images, depth and infrared (or grey), of one finger; types of images and points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array32 = NDArray[np.float32]  # single precision, for work at the frame rate
Image = Array32  # (H, W)
Mask = NDArray[np.uint8]  # (H, W)
Bools = NDArray[np.bool_]
COUNTS = 16.0  # infrared counts of 12 bits for one of 8
NOTHING = -100.0  # [m, 1] stands for a value that is not there: so far out that robust weights leave it no say


@dataclass(frozen=True, eq=False)
class TactileImages:
    """The images that one camera inside a bubble takes at one time.

    Attributes:
        depth: (H, W) float32, distance along the optical axis [m]; NaN where there is none.
        ir: (H, W) float32, infrared amplitude or grey value [counts], pixel for pixel on depth's geometry.
        stamp: when the images were taken [s].
    """

    depth: Image
    ir: Image
    stamp: float

    def reduced(self, n: int, correction: Image) -> TactileImages:
        """Every n-th pixel and line, infrared averaged; depth with the correction (h, w) [m] added."""
        box = n | 1  # odd: about the pixel of the depth
        ir = cv2.blur(np.asarray(self.ir, np.float32), (box, box))[::n, ::n] if n > 1 else self.ir
        depth = self.depth[::n, ::n] + correction
        return TactileImages(np.ascontiguousarray(depth, np.float32), np.ascontiguousarray(ir, np.float32), self.stamp)


def eight_bits(infrared: NDArray[np.floating[Any]]) -> NDArray[np.uint8]:
    """(H, W) of an infrared image of 12 bits; 0 where there is none."""
    return np.asarray(np.clip(np.nan_to_num(infrared) / COUNTS, 0.0, 255.0), np.uint8)

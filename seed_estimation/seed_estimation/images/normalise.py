# SPDX-License-Identifier: Apache-2.0
"""Infrared images made comparable: brightness in a bubble changes with contact, distance and angle, contrast hardly.

N = (L - mean(L)) / (deviation(L) + floor) with L = log(I + offset), slightly blurred; mean and deviation are local.
"""

import cv2
import numpy as np

from seed_estimation.images.tactile_images import Image

LARGEST = 65535.0  # [counts] that an image can have; an infinite pixel would spoil all around it
OFFSET = 20.0  # [counts] keeps the noise of dark pixels small
FLOOR = 0.03  # [1] where there is no contrast there shall be none afterwards
MEAN_BOX = 5  # [px] a marker and little more: shading goes with the tool's outline, not with the membrane's material
COARSE_MEAN_BOX = 11  # [px] wider than the spacing of the markers (7 px)
DEVIATION_BOX = 13  # [px]
FINE, COARSE = 0.5, 1.8  # [px] blur of the two levels


def normalised(ir: Image) -> Image:
    """(H, W) float32 of zero mean and about unit deviation everywhere, of ir (H, W) [counts]."""
    return _normalised(ir, (5, 5), FINE, MEAN_BOX)


def coarse(ir: Image) -> Image:
    """The same at the coarse level, whose broader features lead home from further away."""
    return _normalised(ir, (0, 0), COARSE, COARSE_MEAN_BOX)


def _normalised(ir: Image, kernel: tuple[int, int], blur: float, box: int) -> Image:
    image = cv2.GaussianBlur(cv2.log(cv2.min(cv2.max(ir, 0.0), LARGEST) + np.float32(OFFSET)), kernel, blur)
    centred = cv2.subtract(image, cv2.blur(image, (box, box)))
    variance = cv2.blur(cv2.multiply(centred, centred), (DEVIATION_BOX, DEVIATION_BOX))
    return np.asarray(cv2.divide(centred, cv2.add(cv2.sqrt(variance), FLOOR)), np.float32)

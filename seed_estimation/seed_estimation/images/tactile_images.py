# SPDX-License-Identifier: Apache-2.0
"""One synchronised pair of images, depth and infrared (or grey), of one finger."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
NOTHING = -100.0  # [m, 1] stands for a value that is not there: so far out that robust weights leave it no say


@dataclass(frozen=True, eq=False)
class TactileImages:
    """What one camera inside a bubble sees at one time.

    Attributes:
        depth: (H, W) float32, distance along the optical axis [m]; NaN where there is none.
        ir: (H, W) float32, infrared amplitude or grey value [counts], pixel for pixel on depth's geometry.
        stamp: when the images were taken [s].
    """

    depth: Image
    ir: Image
    stamp: float


def depth_problem(depth: Image, shape: tuple[int, int], near: float, far: float, least: float) -> str:
    """Why a depth image is of no use, or '' when it is good: shape (H, W), share `least` within near to far [m]."""
    if depth.ndim != 2 or depth.shape != shape:
        return f"depth image has shape {depth.shape}; the camera's calibration says {shape}"
    some = np.ascontiguousarray(depth[::4, ::4], np.float32)
    share = cv2.countNonZero(cv2.inRange(some, near, far)) / some.size  # NaN is not in range
    if share < least:
        return f"only {share:.0%} of the depth image lies within {near:g} and {far:g} m; at least {least:.0%} must"
    return ""


def ir_problem(ir: Image, shape: tuple[int, int], saturation: float) -> str:
    """Why an infrared image is of no use, or '' when it is good; saturation [counts]."""
    if ir.ndim != 2 or ir.shape != shape:
        return f"infrared image has shape {ir.shape}; the camera's calibration says {shape}"
    some = np.ascontiguousarray(ir[::4, ::4], np.float32)
    total, largest = float(some.sum()), float(some.max())
    if not isfinite(total):
        return "infrared image has values that are not finite"
    if largest <= 0.0:
        return "infrared image is black"
    if largest >= saturation and np.count_nonzero(some >= saturation) > 0.5 * some.size:
        return f"more than half of the infrared image is saturated ({saturation:g} counts): lower the exposure"
    if float(cv2.meanStdDev(some)[1][0, 0]) < 1e-3 * max(total / some.size, 1.0):
        return "infrared image is constant: no dots to follow"
    return ""

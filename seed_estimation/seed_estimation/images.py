# SPDX-License-Identifier: Apache-2.0
"""One synchronised pair of images, depth and infrared (or grey), of one finger."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seed_core.errors import SeedError

Image = NDArray[np.float32]
NOTHING = -100.0  # [m, 1] stands for a value that is not there: so far out that robust weights leave it no say


class ImageError(SeedError):
    """An image that cannot be used; the message says why."""


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
    with np.errstate(invalid="ignore"):
        share = float(np.count_nonzero((depth > near) & (depth < far))) / depth.size
    if share < least:
        return f"only {share:.0%} of the depth image lies within {near:g} and {far:g} m; at least {least:.0%} must"
    return ""


def ir_problem(ir: Image, shape: tuple[int, int], saturation: float) -> str:
    """Why an infrared image is of no use, or '' when it is good; saturation [counts]."""
    if ir.ndim != 2 or ir.shape != shape:
        return f"infrared image has shape {ir.shape}; the camera's calibration says {shape}"
    sample = ir[::3, ::3]
    if not np.isfinite(sample).all():
        return "infrared image has values that are not finite"
    if float(sample.max()) <= 0.0:
        return "infrared image is black"
    if float(np.count_nonzero(sample >= saturation)) > 0.5 * sample.size:
        return f"more than half of the infrared image is saturated ({saturation:g} counts): lower the exposure"
    if float(sample.std()) < 1e-3 * max(float(sample.mean()), 1.0):
        return "infrared image is constant: no dots to follow"
    return ""

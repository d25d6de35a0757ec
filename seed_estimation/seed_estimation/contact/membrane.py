# SPDX-License-Identifier: Apache-2.0
"""A bubble that touches nothing, as its camera sees it: the no-contact reference that contact is measured against.

Real depth images have holes, and values metres away beside the membrane. So only pixels count as membrane that are
within range and steady while the reference is taken.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from seed_core.spatial import Array
from seed_estimation.contact.surface import fitted_parabolas, rest_surface
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.checks import EstimatorError
from seed_estimation.images.tactile_images import Array32, Image, Mask
from seed_estimation.parameters import EstimatorParameters

FLAT = 1e-3  # [m] of relief that every bubble has in view
PATTERN_BLUR = 20.0  # [px] a membrane at rest is a parabola over so short a way


class Membrane(NamedTuple):
    """One bubble at rest.

    Attributes:
        X_CX: (4, 4) pose of the camera's optical frame in C.
        area: (H, W) 1 where a pixel shows membrane, else 0.
        depth: (H, W) [m] without the fixed pattern; NaN beside the membrane.
        correction: (H, W) [m] to be added to every depth image: the camera's fixed pattern, with its sign turned.
        rest: (H, W, 3) smooth depth [m] and slopes: see `rest_surface`.
    """

    finger: str
    camera: PinholeCamera
    X_CX: Array
    area: Mask
    depth: Image
    correction: Image
    rest: Array32


def membrane_at_rest(
    finger: str, camera: PinholeCamera, X_CX: Array, frames: Sequence[Image], p: EstimatorParameters
) -> Membrane:
    """The membrane in depth images (H, W) [m] of a bubble that touches nothing.

    Raises:
        EstimatorError: too little membrane in view, or no dome.
    """
    mean, deviation = mean_depth(frames, p.near, p.far)
    area = _steady_area(mean, deviation, p)
    share = float(area.mean())
    if share < 0.5 * p.least_valid:
        raise EstimatorError(
            f"{finger} bubble: only {share:.0%} of the reference image is steady membrane between {p.near:g} and "
            f"{p.far:g} m; at least {0.5 * p.least_valid:.0%} is needed: check camera, range and `steady`"
        )
    relief = float(np.ptp(np.percentile(mean[area > 0], (2.0, 98.0))))
    if relief < FLAT:
        raise EstimatorError(
            f"{finger} bubble: the reference image reads {float(np.median(mean[area > 0])):.4f} m throughout, within "
            f"{1e3 * relief:.2f} mm, and a bubble is a dome of millimetres: is this the camera's depth, and is the "
            "bubble inflated?"
        )
    pattern = _fixed_pattern(mean, deviation, area, len(frames))
    depth = np.where(area > 0, mean - pattern, np.nan).astype(np.float32)
    return Membrane(finger, camera, X_CX, area, depth, -pattern, rest_surface(camera, depth))


def mean_depth(frames: Sequence[Image], near: float, far: float) -> tuple[Image, Image]:
    """Mean and deviation over time, both (H, W) [m], of the values within near to far; NaN where half are missing."""
    stack = np.stack([np.asarray(f, np.float32) for f in frames])
    with np.errstate(invalid="ignore", divide="ignore"):
        good = (stack > near) & (stack < far)
        count = good.sum(axis=0).astype(np.float32)
        filled = np.where(good, stack, 0.0)
        mean = filled.sum(axis=0) / count
        square = np.where(good, (stack - mean) ** 2, 0.0).sum(axis=0)
        deviation = np.sqrt(square / np.maximum(count - 1.0, 1.0))
    mean[count < 0.5 * len(stack)] = np.nan
    return mean.astype(np.float32), deviation.astype(np.float32)


def _steady_area(mean: Image, deviation: Image, p: EstimatorParameters) -> Mask:
    """The largest piece of steady pixels, closed, without its rim."""
    steady: Mask = cv2.medianBlur((np.isfinite(mean) & (deviation < p.steady)).astype(np.uint8), 5)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(steady)
    if count < 2:
        return np.zeros_like(steady)
    largest: Mask = (labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))).astype(np.uint8)
    whole = cv2.morphologyEx(largest, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    side = 2 * p.rim + 1
    inner = cv2.erode(whole, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), borderValue=0)
    return np.asarray(inner & np.isfinite(mean), np.uint8)


def _fixed_pattern(mean: Image, deviation: Image, area: Mask, count: int) -> Image:
    """(H, W) [m] by which each pixel always reads too far: a membrane at rest is smooth. 0 beside it.

    Of what stands out from the smoothed mean of `count` frames, the share that noise does not explain (Wiener).
    """
    membrane = area > 0
    smooth = fitted_parabolas(mean, membrane, PATTERN_BLUR)
    rough = np.where(membrane & np.isfinite(smooth), mean - smooth, np.float32(0.0))
    power = float(np.mean(rough[membrane] ** 2))
    noise = float(np.mean(deviation[membrane] ** 2)) / count
    share = max(1.0 - noise / power, 0.0) if count > 1 and power > 0.0 else 0.0
    return np.asarray(np.float32(share) * rough, np.float32)

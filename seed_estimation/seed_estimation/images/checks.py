# SPDX-License-Identifier: Apache-2.0
"""Checks of incoming images: which can be used, and why not."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import isfinite

import cv2
import numpy as np

from seed_core.errors import SeedError
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.tactile_images import Image, TactileImages
from seed_estimation.parameters import EstimatorParameters

_UNITS = (("millimetres", 1e3), ("tenths of a millimetre", 1e4))  # of depth; how many a metre has
Frame = Mapping[str, TactileImages]  # images of one time by finger
IMAGES = "TactileImages(depth, brightness, stamp)"
FRAME = f"give {{'left': {IMAGES}, 'right': ...}}"
KINDS = {"depth": "depth", "ir": "infrared"}
SET_BACK = 0.5  # [s] images older than the last by this: the camera's clock was set back, and the track is lost


class EstimatorError(SeedError):
    """A reference or grasp that cannot be captured from the images given."""


def frame_problem(frame: Frame, cameras: Mapping[str, PinholeCamera], p: EstimatorParameters) -> str:
    """Why the images of one time cannot be used, or ''; cameras: of the full images, by finger."""
    if not isinstance(frame, Mapping):
        return _no_frame(frame)
    missing = [f for f in cameras if f not in frame]
    if missing:
        other = [repr(f) for f in frame if f not in cameras]
        has = f"; it has {', '.join(other)}: the keys must be {' and '.join(map(repr, cameras))}" if other else ""
        return f"no image of the {' and '.join(missing)} finger{has or ': is the camera running?'}"
    problem = next(filter(None, (image_problem(f, frame[f], cameras[f].shape, p) for f in cameras)), "")
    if problem:
        return problem
    stamps = [frame[f].stamp for f in cameras]
    skew = max(stamps) - min(stamps)
    if not skew <= p.max_skew:
        return f"images of left and right are {skew:.3f} s apart (at most {p.max_skew:g} s)"
    return ""


def _no_frame(frame: object) -> str:
    return f"the images of one time are a {type(frame).__name__}: {FRAME}"


def usable_images(
    frames: Sequence[Frame], finger: str, camera: PinholeCamera, p: EstimatorParameters, purpose: str
) -> list[TactileImages]:
    """The good images of one finger.

    Raises:
        EstimatorError: there are none; the message names the purpose.
    """
    good, problem = [], "no images"
    for frame in frames:
        problem = f"no image of the {finger} finger"
        if not isinstance(frame, Mapping):
            problem = _no_frame(frame)
        elif finger in frame:
            problem = image_problem(finger, frame[finger], camera.shape, p)
            good += [] if problem else [frame[finger]]
    if not good:
        raise EstimatorError(f"{purpose}: no usable image of the {finger} finger: {problem}")
    return good


def image_problem(finger: str, images: TactileImages, shape: tuple[int, int], p: EstimatorParameters) -> str:
    """Why one finger's images cannot be used, or ''; shape: (H, W) of its camera."""
    if not isinstance(images, TactileImages):
        return f"{finger}: its images are a {type(images).__name__}: give {IMAGES}"
    for image in (images.depth, images.ir):
        if not isinstance(image, np.ndarray) or image.dtype.kind not in "fui":
            return f"{finger}: an image is no array of numbers: give numpy arrays (H, W)"
    problem = _depth_problem(images.depth, shape, p) or _ir_problem(images.ir, shape, p.saturation)
    return f"{finger}: {problem}" if problem else ""


def _depth_problem(depth: Image, shape: tuple[int, int], p: EstimatorParameters) -> str:
    if depth.shape != shape:
        return f"depth image has shape {depth.shape}; the camera's calibration says {shape}"
    some = np.ascontiguousarray(depth[::4, ::4], np.float32)
    share = cv2.countNonZero(cv2.inRange(some, p.near, p.far)) / some.size  # NaN is not in range
    if share < p.least_valid:
        return (
            f"only {share:.0%} of the depth image lies within {p.near:g} and {p.far:g} m; "
            f"at least {p.least_valid:.0%} must{_other_unit(some, p)}"
        )
    return ""


def _other_unit(depth: Image, p: EstimatorParameters) -> str:
    """What to do about a depth image that would be good if its numbers were millimetres, or tenths of them."""
    for name, per_metre in _UNITS:
        low, high = p.near * per_metre, p.far * per_metre
        if cv2.countNonZero(cv2.inRange(depth, low, high)) / depth.size >= p.least_valid:
            return f". Its numbers look like {name}: divide depth by {per_metre:g}, it must be in metres"
    return ""


def _ir_problem(ir: Image, shape: tuple[int, int], saturation: float) -> str:
    if ir.shape != shape:
        grey = "; make it grey" if ir.ndim == 3 and ir.shape[:2] == shape else ""
        return f"infrared image has shape {ir.shape}; the camera's calibration says {shape}{grey}"
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


class Alive:
    """Whether a camera still sees: images of one that does are never alike to the last bit, since they have noise.

    A driver that sends its last image again and again, with new stamps, looks like a tool that stands still.
    """

    def __init__(self, series: Mapping[str, Sequence[TactileImages]]) -> None:
        """series: images of each finger. Where two in a row are alike nothing is judged: there is no noise in them."""
        self._last: dict[tuple[str, str], Image] = {}
        for finger, images in series.items():
            for name in KINDS:
                some = [_some(i, name) for i in images]
                if not any(np.array_equal(a, b, equal_nan=True) for a, b in pairwise(some)):
                    self._last[finger, name] = some[-1]

    def problem(self, frame: Frame) -> str:
        """Which image of a frame is the one before, or ''."""
        problem = ""
        for (finger, name), last in self._last.items():
            self._last[finger, name] = now = _some(frame[finger], name)
            if not problem and np.array_equal(now, last, equal_nan=True):
                problem = f"{finger}: its {KINDS[name]} image is the one before, to the last bit: does the camera run?"
        return problem


def _some(images: TactileImages, name: str) -> Image:
    """Every fourth pixel of an image, as many as tell it from another."""
    return np.asarray(getattr(images, name)[::4, ::4], np.float32).copy()

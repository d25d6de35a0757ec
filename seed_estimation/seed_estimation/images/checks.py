# SPDX-License-Identifier: Apache-2.0
"""What comes in from the cameras: which images can be used and why not, at the working resolution, depth corrected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from seed_core.errors import SeedError
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.tactile_images import Image, TactileImages, depth_problem, ir_problem
from seed_estimation.parameters import EstimatorParameters

Pair = Mapping[str, TactileImages]


class EstimatorError(SeedError):
    """A reference or grasp that cannot be captured from the images given."""


class Intake:
    """Images of the fingers of one hand.

    Attributes:
        range_offset: (H, W) [m] by finger, true minus measured, of the full images.
        pattern: (h, w) [m] by finger, to be added to depth at the working resolution: see PatchFinder.correction.
    """

    def __init__(self, cameras: Mapping[str, PinholeCamera], parameters: EstimatorParameters) -> None:
        """cameras: of the full images, by finger."""
        self.parameters, self.cameras = parameters, dict(cameras)
        self.range_offset: dict[str, Image] = {}
        self.pattern: dict[str, Image] = {}
        self._added: dict[str, Image] = {}

    def correct(self, range_offset: Mapping[str, Image], pattern: Mapping[str, Image]) -> None:
        """Both corrections of depth from now on.

        Raises:
            EstimatorError: a map's shape is not its image's.
        """
        n, added = self.parameters.decimate, {}
        for finger, camera in self.cameras.items():
            offset = np.asarray(range_offset.get(finger, np.zeros(camera.shape)), np.float32)
            if offset.shape != camera.shape:
                raise EstimatorError(
                    f"range offset of {finger} has shape {offset.shape}; its camera has {camera.shape}"
                )
            if finger in range_offset or finger in pattern:
                added[finger] = np.nan_to_num(offset[::n, ::n]) + pattern.get(finger, np.float32(0.0))
        self.range_offset, self.pattern, self._added = dict(range_offset), dict(pattern), added

    def problem(self, images: Pair) -> str:
        """Why a set of images cannot be used, or ''."""
        missing = [f for f in self.cameras if f not in images]
        if missing:
            return f"no image of the {' and '.join(missing)} finger: is the camera running?"
        problem = next((p for p in (self._image_problem(f, images[f]) for f in self.cameras) if p), "")
        stamps = [images[f].stamp for f in self.cameras]
        skew = max(stamps) - min(stamps)
        if not problem and not skew <= self.parameters.max_skew:
            return f"images of left and right are {skew:.3f} s apart (at most {self.parameters.max_skew:g} s)"
        return problem

    def reduced(self, finger: str, images: TactileImages) -> TactileImages:
        """Images at the working resolution, depth corrected."""
        n = self.parameters.decimate
        depth, ir = images.depth[::n, ::n], images.ir
        if n > 1:
            ir = cv2.blur(np.asarray(ir, np.float32), (n, n))[::n, ::n]
        if finger in self._added:
            depth = depth + self._added[finger]
        return TactileImages(
            np.ascontiguousarray(depth, np.float32), np.ascontiguousarray(ir, np.float32), images.stamp
        )

    def usable(self, frames: Sequence[Pair], what: str) -> dict[str, list[TactileImages]]:
        """The good images of each finger, reduced.

        Raises:
            EstimatorError: a finger has none.
        """
        out: dict[str, list[TactileImages]] = {}
        for finger in self.cameras:
            problems = [
                self._image_problem(finger, images[finger]) if finger in images else f"no image of the {finger} finger"
                for images in frames
            ]
            out[finger] = [self.reduced(finger, i[finger]) for i, p in zip(frames, problems, strict=True) if not p]
            if not out[finger]:
                last = problems[-1] if problems else "no images"
                raise EstimatorError(f"{what}: no usable image of the {finger} finger: {last}")
        return out

    def _image_problem(self, finger: str, images: TactileImages) -> str:
        p, shape = self.parameters, self.cameras[finger].shape
        for image in (images.depth, images.ir):
            if not isinstance(image, np.ndarray) or image.dtype.kind not in "fui":
                return f"{finger}: an image is no array of numbers"
        problem = depth_problem(images.depth, shape, p.near, p.far, p.least_valid)
        problem = problem or ir_problem(images.ir, shape, p.saturation)
        return f"{finger}: {problem}" if problem else ""

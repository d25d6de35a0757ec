# SPDX-License-Identifier: Apache-2.0
"""One finger's images of one time, cropped around the tool and prepared for sampling at moving points."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from seed_estimation.images.normalise import coarse, normalised
from seed_estimation.images.tactile_images import NOTHING, Array32, Image, TactileImages

MARGIN = 18  # [px] local normalisation needs 9; the rest is for motion beyond the prediction
MISSING = 10.0  # [m] of pixels without depth
FARTHEST = 1.0  # [m] beyond which a depth is none: no bubble is that deep
FEWEST = 4  # of 3 x 3 pixels, whose mean is a depth


@dataclass(frozen=True, eq=False)
class Crop:
    """Crops of one finger's images with the common corner `origin` (u, v) [px].

    Attributes:
        ir: infrared (h, w) [counts].
        depth: (h, w) mean of those of 3 x 3 pixels that have one [m]; far out where too few do.
    """

    ir: Image
    depth: Image
    origin: tuple[int, int]

    @cached_property
    def fine(self) -> Image:
        """Normalised infrared (h, w)."""
        return normalised(self.ir)

    @cached_property
    def coarse(self) -> Image:
        """The same at the coarse level."""
        return coarse(self.ir)


def crop(images: TactileImages, pixels: Array32 | None = None) -> Crop:
    """The part of the images around pixels (2, N), u and v, at which the tool is expected; all of them without."""
    h, w = images.depth.shape
    if pixels is None:
        pixels = np.array(((0, w), (0, h)), np.float32)
    u0, v0 = (max(0, _whole(value) - MARGIN) for value in pixels.min(axis=1).tolist())
    u1, v1 = (_whole(value) + MARGIN + 1 for value in pixels.max(axis=1).tolist())
    u1, v1 = min(w, u1), min(h, v1)
    if u1 - u0 < 8 or v1 - v0 < 8:  # the tool has left the view: any crop shows that
        u0, u1, v0, v1 = 0, w, 0, h
    return Crop(images.ir[v0:v1, u0:u1], _mean(images.depth[v0:v1, u0:u1]), (u0, v0))


def _mean(depth: Image) -> Image:
    """Mean of 3 x 3 pixels (h, w) [m] without those that are missing or broken; MISSING where few are left.

    Cameras leave out pixels here and there. One that counted would spoil nine means, and they all that is sampled
    between them.
    """
    present = (depth > 0.0) & (depth < FARTHEST)  # of nan, neither
    if present.all():
        return np.asarray(cv2.blur(depth, (3, 3)), np.float32)
    share = cv2.blur(present.astype(np.float32), (3, 3))
    mean = cv2.blur(np.where(present, depth, np.float32(0.0)), (3, 3)) / np.maximum(share, np.float32(1e-3))
    return np.where(share > (FEWEST - 0.5) / 9.0, mean, np.float32(MISSING))


def _whole(value: float) -> int:
    """A coordinate as a pixel's; 0 for one that cannot be told, far out for one that is."""
    return int(min(max(value, -1e5), 1e5)) if value == value else 0


def sample(image: Image, pixels: Array32) -> Array32:
    """Values (N,), or (N, 3) of three channels, of an image at pixels (2, N), bilinear; NOTHING outside."""
    if pixels.shape[1] == 0:
        return np.zeros((0, 3) if image.ndim == 3 else 0, np.float32)
    values = cv2.remap(
        image, pixels[0], pixels[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(NOTHING,) * 3
    )
    return np.asarray(values).reshape(-1) if image.ndim == 2 else np.asarray(values).reshape(-1, 3)

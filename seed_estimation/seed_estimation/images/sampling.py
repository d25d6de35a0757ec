# SPDX-License-Identifier: Apache-2.0
"""One finger's images of one time, prepared for sampling at moving points, and the sampling itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from seed_estimation.contact.surface import Vec
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.normalise import coarse, normalised
from seed_estimation.images.tactile_images import NOTHING, Image

CROP_MARGIN = 18  # [px] local normalisation needs 9; the rest is for motion beyond the prediction

MISSING = 10.0  # [m]

Box = tuple[int, int, int, int]


@dataclass(frozen=True, eq=False)
class Frame:
    """Crops of one finger's images with the common corner `origin` (u, v) [px]."""

    ir: Image
    depth: Image  # mean of 3 x 3 pixels [m]; far out where one of them is missing
    origin: tuple[int, int]

    @cached_property
    def fine(self) -> Image:
        """Normalised infrared."""
        return normalised(self.ir)

    @cached_property
    def coarse(self) -> Image:
        """The same at the coarse level."""
        return coarse(self.ir)


def prepare(ir: Image, depth: Image, box: Box) -> Frame:
    """Frame from infrared (H, W) [counts] and depth (H, W) [m] around box (first, last u, first, last v) [px]."""
    h, w = depth.shape
    u0, u1 = max(0, box[0] - CROP_MARGIN), min(w, box[1] + CROP_MARGIN + 1)
    v0, v1 = max(0, box[2] - CROP_MARGIN), min(h, box[3] + CROP_MARGIN + 1)
    if u1 - u0 < 8 or v1 - v0 < 8:  # the tool has left the view: any crop shows that
        u0, u1, v0, v1 = 0, w, 0, h
    return Frame(ir[v0:v1, u0:u1], averaged_depth(depth[v0:v1, u0:u1]), (u0, v0))


def averaged_depth(depth: Image) -> Image:
    """Mean over 3 x 3 [m]; what is missing or broken throws it so far out that robust weights leave it no say."""
    bounded = np.clip(depth, -MISSING, MISSING)
    cv2.patchNaNs(bounded, MISSING)
    return np.asarray(cv2.blur(bounded, (3, 3)), np.float32)


def project32(camera: PinholeCamera, p: Vec) -> Vec:
    """Pixels (2, N) of points (3, N) in the optical frame, in single precision."""
    single = camera.single
    if single is None:
        return np.ascontiguousarray(camera.project(p.T).T, dtype=np.float32)
    out = p[:2] / p[2]
    if single.distorted:
        k1, k2, p1, p2, k3 = single.D
        square = out * out
        r2 = square[0] + square[1]
        c = ((k3 * r2 + k2) * r2 + k1) * r2 + np.float32(1.0)
        if single.tangential:
            xy = np.float32(2.0) * out[0] * out[1]
            shift = np.stack((p1 * xy + p2 * (r2 + 2 * square[0]), p1 * (r2 + 2 * square[1]) + p2 * xy))
            out = np.asarray(out * c + shift, np.float32)
        else:
            out *= c
    out *= single.focal
    out += single.centre
    return np.asarray(out, np.float32)


def sample(image: Image, pixels: Vec) -> Vec:
    """Values (N,), or (N, 3) of three channels, of an image at pixels (2, N), bilinear; NOTHING outside."""
    if pixels.shape[1] == 0:
        return np.zeros((0, 3) if image.ndim == 3 else 0, np.float32)
    values = cv2.remap(
        image, pixels[0], pixels[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(NOTHING,) * 3
    )
    return np.asarray(values).reshape(-1) if image.ndim == 2 else np.asarray(values).reshape(-1, 3)

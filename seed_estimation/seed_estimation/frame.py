# SPDX-License-Identifier: Apache-2.0
"""One finger's images of one time, prepared for sampling at moving points, and the sampling itself."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from seed_estimation.camera import Camera
from seed_estimation.finger_model import Vec
from seed_estimation.images import Image
from seed_estimation.normalise import coarse, normalised

NOTHING = -100.0  # [m, 1] stands for a value that is not there: so far out that robust weights leave it no say
CROP_MARGIN = 24  # [px] local normalisation needs 20; the rest is for motion beyond the prediction

Box = tuple[int, int, int, int]


@dataclass(frozen=True, eq=False)
class Frame:
    """Crops of one finger's images with the common corner `origin` (u, v) [px]."""

    fine: Image
    coarse: Image
    depth: Image  # mean of 3 x 3 valid pixels [m]; NOTHING where there are none
    origin: tuple[int, int]


def prepare(ir: Image, depth: Image, box: Box, near: float, far: float) -> Frame:
    """Frame from infrared (H, W) [counts] and depth (H, W) [m] around box (first, last u, first, last v) [px]."""
    h, w = depth.shape
    u0, u1 = max(0, box[0] - CROP_MARGIN), min(w, box[1] + CROP_MARGIN + 1)
    v0, v1 = max(0, box[2] - CROP_MARGIN), min(h, box[3] + CROP_MARGIN + 1)
    if u1 - u0 < 8 or v1 - v0 < 8:  # the tool has left the view: any crop shows that
        u0, u1, v0, v1 = 0, w, 0, h
    fine = normalised(ir[v0:v1, u0:u1])
    return Frame(fine, coarse(fine), averaged_depth(depth[v0:v1, u0:u1], near, far), (u0, v0))


def averaged_depth(depth: Image, near: float, far: float) -> Image:
    """Mean over 3 x 3 of the values within near to far [m]; NOTHING where fewer than half of them are."""
    good = cv2.inRange(depth, near, far)  # 0 for NaN
    count = cv2.boxFilter(good, cv2.CV_32F, (3, 3), normalize=False)
    total = cv2.boxFilter(cv2.bitwise_and(depth, depth, mask=good), cv2.CV_32F, (3, 3), normalize=False)
    mean = total / cv2.max(count, 1.0) * np.float32(255.0)
    mean[count < 4.5 * 255.0] = NOTHING
    return np.asarray(mean, np.float32)


def project32(camera: Camera, p: Vec) -> Vec:
    """Pixels (2, N) of points (3, N) in the optical frame, in single precision."""
    if camera.model != "plumb_bob":
        return np.ascontiguousarray(camera.project(p.T).T, dtype=np.float32)
    k1, k2, p1, p2, k3 = (np.float32(d) for d in camera.D)
    out = p[:2] / p[2]
    if camera.D.any():
        square = out * out
        r2 = square[0] + square[1]
        c = ((k3 * r2 + k2) * r2 + k1) * r2 + np.float32(1.0)
        if abs(p1) > 1e-9 or abs(p2) > 1e-9:
            xy = np.float32(2.0) * out[0] * out[1]
            shift = np.stack((p1 * xy + p2 * (r2 + 2 * square[0]), p1 * (r2 + 2 * square[1]) + p2 * xy))
            out = np.asarray(out * c + shift, np.float32)
        else:
            out *= c
    K = camera.K.astype(np.float32)
    out *= K[(0, 1), (0, 1)][:, None]
    out += K[:2, 2:]
    return np.asarray(out, np.float32)


def sample(image: Image, pixels: Vec, origin: tuple[int, int]) -> Vec:
    """Values (N,) of a crop at pixels (2, N), bilinear; NOTHING outside."""
    shifted = pixels - np.array(origin, np.float32)[:, None]
    values = cv2.remap(
        image, shifted[0], shifted[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=NOTHING
    )
    return np.asarray(values).reshape(-1)

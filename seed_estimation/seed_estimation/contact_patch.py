# SPDX-License-Identifier: Apache-2.0
"""Where a bubble touches: difference of depth to the no-contact reference, cleaned, largest piece (Sec. VII-A).

Real depth images have holes, and values metres away beside the membrane. So only pixels count that were membrane in
the reference (within range and steady), and differences that no membrane can make are dropped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.errors import SeedError
from seed_estimation.camera import Array, Camera
from seed_estimation.images import Image
from seed_estimation.parameters import EstimatorParameters

Mask = NDArray[np.uint8]


class NoReferenceError(SeedError):
    """A no-contact reference that is none."""


def _nowhere() -> Array:
    return np.full(3, np.nan)


@dataclass(frozen=True, eq=False)
class ContactPatch:
    """Contact of one finger at one time.

    Attributes:
        centroid: (3,) mean of the patch in the optical frame [m]; NaN without contact.
        centroid_C: (3,) the same in the compliance frame [m].
        area: of the patch as seen by the camera [m^2].
        mean_indentation, max_indentation: of the membrane within the patch, along the camera's axis [m].
    """

    finger: str
    in_contact: bool = False
    centroid: Array = field(default_factory=_nowhere)
    centroid_C: Array = field(default_factory=_nowhere)
    pixels: int = 0
    area: float = 0.0
    mean_indentation: float = 0.0
    max_indentation: float = 0.0


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


class PatchFinder:
    """Finds the contact patch of one finger, against one no-contact reference."""

    def __init__(
        self, finger: str, camera: Camera, X_CX: Array, frames: Sequence[Image], p: EstimatorParameters
    ) -> None:
        """frames: depth images (H, W) [m] without contact; X_CX: pose of the optical frame in C.

        Raises:
            NoReferenceError: too little membrane in view.
        """
        self.finger, self.camera, self.X_CX, self.parameters = finger, camera, X_CX, p
        mean, deviation = mean_depth(frames, p.near, p.far)
        self.membrane = self._membrane(mean, deviation)
        share = float(self.membrane.mean())
        if share < 0.5 * p.least_valid:
            raise NoReferenceError(
                f"{finger} bubble: only {share:.0%} of the reference image is steady membrane between {p.near:g} and "
                f"{p.far:g} m; at least {0.5 * p.least_valid:.0%} is needed: check camera, range and `steady`"
            )
        self.depth: Image = np.where(self.membrane > 0, mean, np.nan).astype(np.float32)
        self._ellipse = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (p.opening, p.opening))
        v, u = np.nonzero(self.membrane)
        self._roi = (slice(int(v.min()), int(v.max()) + 1), slice(int(u.min()), int(u.max()) + 1))
        self._inside = self.membrane[self._roi] * np.uint8(255)
        self._filled = np.nan_to_num(self.depth[self._roi], nan=0.0)
        rays = camera.rays32[self._roi]
        self._rays = np.ascontiguousarray(rays[..., 0]), np.ascontiguousarray(rays[..., 1])

    def _membrane(self, mean: Image, deviation: Image) -> Mask:
        p = self.parameters
        steady: Mask = (np.isfinite(mean) & (deviation < p.steady)).astype(np.uint8)
        steady = cv2.medianBlur(steady, 5)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(steady)
        if count < 2:
            return np.zeros_like(steady)
        largest: Mask = (labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))).astype(np.uint8)
        side = 2 * p.rim + 1
        whole = cv2.morphologyEx(largest, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
        inner = cv2.erode(whole, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), borderValue=0)
        return np.asarray(inner & np.isfinite(mean), np.uint8)

    def indentation(self, depth: Image) -> Image:
        """Towards the camera, (h, w) over the membrane's box [m]; 0 off the membrane and where depth is broken."""
        difference = self._filled - depth[self._roi]
        good = cv2.inRange(difference, -self.parameters.largest, self.parameters.largest)  # 0 for NaN
        return np.asarray(cv2.bitwise_and(difference, difference, mask=cv2.bitwise_and(good, self._inside)), np.float32)

    def find(self, depth: Image) -> tuple[Mask, ContactPatch]:
        """Mask (H, W) of the patch, 0 or 1, and the patch; depth (H, W) float32 [m]."""
        p = self.parameters
        raw = self.indentation(depth)
        smooth = cv2.blur(raw, (p.smooth, p.smooth))
        binary = cv2.morphologyEx(cv2.inRange(smooth, p.threshold, 1.0), cv2.MORPH_OPEN, self._ellipse)
        mask = np.zeros(self.camera.shape, np.uint8)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(binary, connectivity=4)
        if count < 2:
            return mask, ContactPatch(self.finger)
        best = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
        if stats[best, cv2.CC_STAT_AREA] < p.least_area:
            return mask, ContactPatch(self.finger)
        piece = (labels == best).view(np.uint8)
        mask[self._roi] = piece
        return mask, self._describe(piece, raw, smooth, depth[self._roi])

    def core(self, depth: Image, mask: Mask) -> Mask:
        """The part of the mask (H, W) that lies on the tool: around it the membrane hangs free, as a skirt.

        A skirt falls off exponentially from the tool's edge, so a depth of `core` times the deepest is mostly tool.
        """
        p = self.parameters
        smooth = np.zeros(self.camera.shape, np.float32)
        smooth[self._roi] = cv2.blur(self.indentation(depth), (p.smooth, p.smooth))
        deepest = float(np.percentile(smooth[mask > 0], 98.0))
        return np.asarray(mask & (smooth > p.core * deepest), np.uint8)

    def _describe(self, piece: Mask, raw: Image, smooth: Image, depth: Image) -> ContactPatch:
        known = cv2.compare(raw, 0.0, cv2.CMP_NE)  # broken pixels inside the patch have no place of their own
        seen = cv2.bitwise_and(piece, known)
        if not cv2.countNonZero(seen):
            return ContactPatch(self.finger)
        z = cv2.bitwise_and(depth, depth, mask=known)
        x, y, z_mean = (cv2.mean(image, seen)[0] for image in (self._rays[0] * z, self._rays[1] * z, z))
        centroid = np.array((x, y, z_mean))
        pixels = cv2.countNonZero(piece)
        return ContactPatch(
            finger=self.finger,
            in_contact=True,
            centroid=centroid,
            centroid_C=self.X_CX[:3, :3] @ centroid + self.X_CX[:3, 3],
            pixels=pixels,
            area=z_mean * z_mean * pixels / float(self.camera.K[0, 0] * self.camera.K[1, 1]),
            mean_indentation=cv2.mean(smooth, piece)[0],
            max_indentation=float(cv2.minMaxLoc(smooth, piece)[1]),
        )

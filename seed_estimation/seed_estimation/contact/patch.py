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
from seed_core.spatial import Array
from seed_estimation.contact.surface import at_rest, rest_surface
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.tactile_images import Image
from seed_estimation.parameters import EstimatorParameters

Mask = NDArray[np.uint8]
PATTERN_BLUR = 20.0  # [px] a membrane at rest is a parabola over so short a way
QUICK = 2  # [px] step of the grid that is enough at the frame rate


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


class _Grid:
    """Every n-th pixel and line of the membrane's box, with what each frame is compared to."""

    def __init__(self, finder: PatchFinder, n: int) -> None:
        v, u = np.nonzero(finder.membrane)
        self.n = n
        self.box = (slice(int(v.min()), int(v.max()) + 1, n), slice(int(u.min()), int(u.max()) + 1, n))
        self.inside: Mask = np.ascontiguousarray(finder.membrane[self.box] * np.uint8(255))
        self.rest: Image = np.nan_to_num(finder.depth[self.box], nan=0.0)
        rays = finder.camera.rays32[self.box]
        self.rays = np.ascontiguousarray(np.nan_to_num(rays[..., :2]).reshape(-1, 2).T)
        opening, smooth = (max(side // n, 1) | 1 for side in (finder.parameters.opening, finder.parameters.smooth))
        self.ellipse = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (opening, opening))
        self.smooth = (smooth, smooth)

    def indentation(self, depth: Image, largest: float) -> tuple[Image, Mask]:
        """Towards the camera (h, w) [m], and where it is known (h, w), 255; 0 elsewhere."""
        difference = self.rest - depth[self.box]
        good = cv2.bitwise_and(cv2.inRange(difference, -largest, largest), self.inside)  # 0 for NaN
        return np.asarray(cv2.bitwise_and(difference, difference, mask=good), np.float32), np.asarray(good, np.uint8)

    def whole(self, piece: Mask, shape: tuple[int, int]) -> Mask:
        """A mask (h, w) of the grid as one of the image (H, W)."""
        mask = np.zeros(shape, np.uint8)
        rows, columns = (slice(s.start, s.stop) for s in self.box)
        large = cv2.resize(piece, None, fx=self.n, fy=self.n, interpolation=cv2.INTER_NEAREST)
        mask[rows, columns] = large[: rows.stop - rows.start, : columns.stop - columns.start]
        return mask


def _fixed_pattern(mean: Image, deviation: Image, membrane: NDArray[np.bool_], count: int) -> Image:
    """What each pixel (H, W) reads too far [m], always: a membrane at rest is smooth. 0 beside it.

    Of what stands out from the smoothed mean of `count` frames, the share that noise does not explain (Wiener).
    """
    smooth = at_rest(mean, membrane, PATTERN_BLUR)
    rough = np.where(membrane & np.isfinite(smooth), mean - smooth, np.float32(0.0))
    power = float(np.mean(rough[membrane] ** 2))
    noise = float(np.mean(deviation[membrane] ** 2)) / count
    share = max(1.0 - noise / power, 0.0) if count > 1 and power > 0.0 else 0.0
    return np.asarray(np.float32(share) * rough, np.float32)


class PatchFinder:
    """Finds the contact patch of one finger, against one no-contact reference."""

    def __init__(
        self, finger: str, camera: PinholeCamera, X_CX: Array, frames: Sequence[Image], p: EstimatorParameters
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
        pattern = _fixed_pattern(mean, deviation, self.membrane > 0, len(frames))
        self.correction: Image = -pattern
        self.depth: Image = np.where(self.membrane > 0, mean - pattern, np.nan).astype(np.float32)
        self.rest = rest_surface(camera, self.depth)
        self._grids = {n: _Grid(self, n) for n in (1, QUICK)}

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

    def find(self, depth: Image, step: int = 1) -> tuple[Mask, ContactPatch]:
        """Mask (H, W) of the patch, 0 or 1, and the patch; depth (H, W) float32 [m]; step: 1, or QUICK."""
        p, grid = self.parameters, self._grids[step]
        raw, good = grid.indentation(depth, p.largest)
        smooth = cv2.blur(raw, grid.smooth)
        binary = cv2.morphologyEx(cv2.inRange(smooth, p.threshold, 1.0), cv2.MORPH_OPEN, grid.ellipse)
        count, labels = cv2.connectedComponents(binary, connectivity=4, ltype=cv2.CV_16U)
        sizes = np.bincount(labels.ravel(), minlength=2)[1:]
        best = 1 + int(np.argmax(sizes))
        if count < 2 or sizes[best - 1] * step * step < p.least_area:
            return np.zeros(self.camera.shape, np.uint8), ContactPatch(self.finger)
        piece = (labels == best).view(np.uint8)
        seen = cv2.bitwise_and(piece, good)
        return grid.whole(piece, self.camera.shape), self._describe(grid, piece, seen, raw, smooth)

    def core(self, depth: Image, mask: Mask) -> Mask:
        """The part of the mask (H, W) that lies on the tool: around it the membrane hangs free, as a skirt.

        A skirt falls off exponentially from the tool's edge, so a depth of `core` times the deepest is mostly tool.
        """
        p, grid = self.parameters, self._grids[1]
        smooth = np.zeros(self.camera.shape, np.float32)
        smooth[grid.box] = cv2.blur(grid.indentation(depth, p.largest)[0], grid.smooth)
        deepest = float(np.percentile(smooth[mask > 0], 98.0))
        return np.asarray(mask & (smooth > p.core * deepest), np.uint8)

    def _describe(self, grid: _Grid, piece: Mask, seen: Mask, raw: Image, smooth: Image) -> ContactPatch:
        """seen: the piece without broken pixels, which have no place of their own."""
        weight = seen.astype(np.float32).ravel()
        count, pixels = float(weight.sum()), cv2.countNonZero(piece)
        if not count:
            return ContactPatch(self.finger)
        z = (grid.rest - raw).ravel() * weight
        z_mean = float(z.sum()) / count
        centroid = np.array((*(grid.rays @ z / np.float32(count)), z_mean), float)
        return ContactPatch(
            finger=self.finger,
            in_contact=True,
            centroid=centroid,
            centroid_C=self.X_CX[:3, :3] @ centroid + self.X_CX[:3, 3],
            pixels=pixels * grid.n**2,
            area=z_mean * z_mean * pixels * grid.n**2 / float(self.camera.K[0, 0] * self.camera.K[1, 1]),
            mean_indentation=float(cv2.mean(smooth, piece)[0]),
            max_indentation=float(cv2.minMaxLoc(smooth, piece)[1]),
        )

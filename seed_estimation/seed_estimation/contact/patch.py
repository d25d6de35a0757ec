# SPDX-License-Identifier: Apache-2.0
"""Contact patch of one bubble (Sec. VII-A): depth against the no-contact reference, thresholded, opened, largest piece.

Differences that no membrane can make are dropped: broken pixels have no place of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from seed_core.spatial import Array
from seed_estimation.contact.membrane import membrane_at_rest
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.tactile_images import Image, Mask
from seed_estimation.parameters import EstimatorParameters

QUICK = 2  # [px] step of the grid that is enough at the frame rate


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


class PatchFinder:
    """Finds the contact patch of one finger, against one no-contact reference.

    Attributes:
        X_CX: (4, 4) pose of the camera's optical frame in C.
        correction: (H, W) [m] to be added to depth images before they are given to `find` or `core`.
        rest: (H, W, 3) the membrane at rest: see `rest_surface`.
    """

    def __init__(
        self, finger: str, camera: PinholeCamera, X_CX: Array, frames: Sequence[Image], p: EstimatorParameters
    ) -> None:
        """frames: depth images (H, W) [m] without contact.

        Raises:
            NoReferenceError: too little membrane in view.
        """
        self.finger, self.camera, self.X_CX = finger, camera, X_CX
        membrane = membrane_at_rest(finger, camera, frames, p)
        self.correction, self.rest = membrane.correction, membrane.rest
        self._grids = {n: _Grid(camera, membrane.area, membrane.depth, n) for n in (1, QUICK)}

    def find(self, depth: Image, p: EstimatorParameters, step: int = 1) -> tuple[Mask, ContactPatch]:
        """The contact patch in one depth image.

        Args:
            depth: (H, W) float32 [m].
            p: in force.
            step: 1, or QUICK: every second pixel only.

        Returns:
            (H, W) mask of the patch, 0 or 1, and the patch.
        """
        grid = self._grids[step]
        raw, good, smooth = grid.indentation(depth, p)
        side = _odd(p.opening, step)
        ellipse = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
        binary = cv2.morphologyEx(cv2.inRange(smooth, p.threshold, 1.0), cv2.MORPH_OPEN, ellipse)
        count, labels = cv2.connectedComponents(binary, connectivity=4, ltype=cv2.CV_16U)
        sizes = np.bincount(labels.ravel(), minlength=2)[1:]
        best = 1 + int(np.argmax(sizes))
        if count < 2 or sizes[best - 1] * step * step < p.least_area:
            return np.zeros(self.camera.shape, np.uint8), ContactPatch(self.finger)
        piece = (labels == best).view(np.uint8)
        return grid.whole(piece), self._described(grid, piece, good, raw, smooth)

    def core(self, depth: Image, mask: Mask, p: EstimatorParameters) -> Mask:
        """The part of the mask (H, W) that lies on the tool: around it the membrane hangs free, as a skirt.

        A skirt falls off exponentially from the tool's edge, so a depth of `core` times the deepest is mostly tool.
        """
        grid = self._grids[1]
        smooth = np.zeros(self.camera.shape, np.float32)
        smooth[grid.box] = grid.indentation(depth, p)[2]
        deepest = float(np.percentile(smooth[mask > 0], 98.0))
        return np.asarray(mask & (smooth > p.core * deepest), np.uint8)

    def _described(self, grid: _Grid, piece: Mask, good: Mask, raw: Image, smooth: Image) -> ContactPatch:
        """Mean of the patch's points (Sec. VII-A), area and indentation."""
        weight = cv2.bitwise_and(piece, good).astype(np.float32).ravel()
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


class _Grid:
    """Every n-th pixel and line of the membrane's box, with what each frame is compared to."""

    def __init__(self, camera: PinholeCamera, area: Mask, depth: Image, n: int) -> None:
        v, u = np.nonzero(area)
        self.n, self._shape = n, camera.shape
        self.box = (slice(int(v.min()), int(v.max()) + 1, n), slice(int(u.min()), int(u.max()) + 1, n))
        self._inside: Mask = np.ascontiguousarray(area[self.box] * np.uint8(255))
        self.rest: Image = np.nan_to_num(depth[self.box], nan=0.0)
        self.rays = np.ascontiguousarray(np.nan_to_num(camera.rays32[self.box][..., :2]).reshape(-1, 2).T)

    def indentation(self, depth: Image, p: EstimatorParameters) -> tuple[Image, Mask, Image]:
        """Towards the camera (h, w) [m], 0 where it is not known; where it is known, 255; and the former averaged."""
        difference = self.rest - depth[self.box]
        good = cv2.bitwise_and(cv2.inRange(difference, -p.largest, p.largest), self._inside)  # 0 for NaN
        raw = np.asarray(cv2.bitwise_and(difference, difference, mask=good), np.float32)
        side = _odd(p.smooth, self.n)
        return raw, np.asarray(good, np.uint8), np.asarray(cv2.blur(raw, (side, side)), np.float32)

    def whole(self, piece: Mask) -> Mask:
        """A mask (h, w) of the grid as one of the image (H, W)."""
        mask = np.zeros(self._shape, np.uint8)
        rows, columns = (slice(s.start, s.stop) for s in self.box)
        large = cv2.resize(piece, None, fx=self.n, fy=self.n, interpolation=cv2.INTER_NEAREST)
        mask[rows, columns] = large[: rows.stop - rows.start, : columns.stop - columns.start]
        return mask


def _odd(side: int, n: int) -> int:
    """A side in pixels as an odd one of every n-th pixel."""
    return max(side // n, 1) | 1

# SPDX-License-Identifier: Apache-2.0
"""Contact patch of one bubble (Sec. VII-A): depth against the no-contact reference, thresholded, opened, largest piece.

Differences that no membrane can make are dropped: broken pixels have no place of their own.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np

from seed_core.spatial import Array
from seed_estimation.contact.membrane import Membrane
from seed_estimation.images.tactile_images import Image, Mask
from seed_estimation.parameters import EstimatorParameters

QUICK = 2  # [px] step that is enough at the frame rate


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
    centroid: Array = field(default_factory=lambda: np.full(3, np.nan))
    centroid_C: Array = field(default_factory=lambda: np.full(3, np.nan))
    pixels: int = 0
    area: float = 0.0
    mean_indentation: float = 0.0
    max_indentation: float = 0.0


class PatchFinder:
    """Finds the contact patch against one no-contact reference, in every n-th pixel and line of the membrane's box."""

    def __init__(self, membrane: Membrane, n: int = 1) -> None:
        self.membrane, self._n = membrane, n
        v, u = np.nonzero(membrane.area)
        self._box = (slice(int(v.min()), int(v.max()) + 1, n), slice(int(u.min()), int(u.max()) + 1, n))
        self._inside: Mask = np.ascontiguousarray(membrane.area[self._box] * np.uint8(255))
        self._rest: Image = np.nan_to_num(membrane.depth[self._box], nan=0.0)
        rays = membrane.camera.rays32[self._box][..., :2]
        self._rays = np.ascontiguousarray(np.nan_to_num(rays).reshape(-1, 2).T)

    def find(self, depth: Image, p: EstimatorParameters) -> tuple[Mask, ContactPatch]:
        """Mask (H, W) of the patch, 0 or 1, and the patch; depth (H, W) float32 [m], corrected."""
        raw, good, smooth = self._indentation(depth, p)
        side = self._odd(p.opening)
        ellipse = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
        binary = cv2.morphologyEx(cv2.inRange(smooth, p.threshold, 1.0), cv2.MORPH_OPEN, ellipse)
        count, labels = cv2.connectedComponents(binary, connectivity=4, ltype=cv2.CV_16U)
        sizes = np.bincount(labels.ravel(), minlength=2)[1:]
        best = 1 + int(np.argmax(sizes))
        mask = np.zeros(depth.shape, np.uint8)
        if count < 2 or sizes[best - 1] * self._n * self._n < p.least_area:
            return mask, ContactPatch(self.membrane.finger)
        piece = (labels == best).view(np.uint8)
        large = cv2.resize(piece, None, fx=self._n, fy=self._n, interpolation=cv2.INTER_NEAREST)
        whole = mask[tuple(slice(s.start, s.stop) for s in self._box)]
        whole[:] = large[: whole.shape[0], : whole.shape[1]]
        return mask, self._described(piece, good, raw, smooth)

    def core(self, depth: Image, mask: Mask, p: EstimatorParameters) -> Mask:
        """The part of the mask (H, W) that lies on the tool: around it the membrane hangs free, as a skirt.

        A skirt falls off exponentially from the tool's edge, so a depth of `core` times the deepest is mostly tool.
        """
        smooth = np.zeros(depth.shape, np.float32)
        smooth[self._box] = self._indentation(depth, p)[2]
        deepest = float(np.percentile(smooth[mask > 0], 98.0))
        return np.asarray(mask & (smooth > p.core * deepest), np.uint8)

    def _indentation(self, depth: Image, p: EstimatorParameters) -> tuple[Image, Mask, Image]:
        """Towards the camera (h, w) [m], 0 where it is not known; where it is known, 255; and the former averaged."""
        difference = self._rest - depth[self._box]
        good = cv2.bitwise_and(cv2.inRange(difference, -p.largest, p.largest), self._inside)  # 0 for NaN
        raw = np.asarray(cv2.bitwise_and(difference, difference, mask=good), np.float32)
        side = self._odd(p.smooth)
        return raw, np.asarray(good, np.uint8), np.asarray(cv2.blur(raw, (side, side)), np.float32)

    def _odd(self, side: int) -> int:
        """A side in pixels as an odd one of every n-th pixel."""
        return max(side // self._n, 1) | 1

    def _described(self, piece: Mask, good: Mask, raw: Image, smooth: Image) -> ContactPatch:
        """Mean of the patch's points (Sec. VII-A), area and indentation."""
        camera, X_CX = self.membrane.camera, self.membrane.X_CX
        weight = cv2.bitwise_and(piece, good).astype(np.float32).ravel()
        count, pixels = float(weight.sum()), cv2.countNonZero(piece) * self._n**2
        if not count:
            return ContactPatch(self.membrane.finger)
        z = (self._rest - raw).ravel() * weight
        z_mean = float(z.sum()) / count
        centroid = np.array((*(self._rays @ z / np.float32(count)), z_mean), float)
        return ContactPatch(
            finger=self.membrane.finger,
            in_contact=True,
            centroid=centroid,
            centroid_C=X_CX[:3, :3] @ centroid + X_CX[:3, 3],
            pixels=pixels,
            area=z_mean * z_mean * pixels / float(camera.K[0, 0] * camera.K[1, 1]),
            mean_indentation=float(cv2.mean(smooth, piece)[0]),
            max_indentation=float(cv2.minMaxLoc(smooth, piece)[1]),
        )

# SPDX-License-Identifier: Apache-2.0
"""One gel as a `Sensor`: dots for the motion along it, slopes and depth for turns and the way into it.

A point that lay at p_0 in the optical frame at the grasp, with slope g_0 of the surface, lies at p = X p_0 now. It
predicts where its dot is seen (dots), the slope where p is seen (slopes), and how deep the gel is pressed in there
(depth). All three are compared with the image at each step of the fit.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array, inverse_pose
from seed_estimation.contact.patch import ContactPatch
from seed_estimation.gel.depth import Integrator
from seed_estimation.gel.dots import DotFinder, matched
from seed_estimation.gel.image import GelImage
from seed_estimation.gel.observation import GelGrasp, GelObservation, Seen
from seed_estimation.gel.settings import GelSettings
from seed_estimation.gel.shading import Canvas, Shading, change, filled, mean_colour
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.checks import EstimatorError
from seed_estimation.images.tactile_images import Array32, Image, Mask

NEAR = 0.45  # of the dots' distance, within which a dot is looked for


class Gel:
    """One gel; a `Sensor` of `GelImage`."""

    def __init__(
        self, finger: str, settings: GelSettings, camera: PinholeCamera, X_CX: Array, shading: Shading
    ) -> None:
        """X_CX (4, 4): the optical frame in C; shading: as calibrated."""
        self.finger, self.settings, self.camera = finger, settings, camera
        self._canvas = Canvas(camera, settings.distance, settings.decimate)
        self._shading, self._maps = shading, shading.maps(self._canvas)
        self._integrator = Integrator(self._canvas)
        self._X_CX, self._X_XC = X_CX, inverse_pose(X_CX)
        per_metre = float(camera.K[0, 0]) / settings.distance
        self._dots = DotFinder(settings.dot * per_metre, settings.contrast)
        self._near = NEAR * settings.pitch * per_metre
        self._free: Array32 | None = None  # (h, w, 3) [counts] of the free gel, dots filled in
        self._grasp: GelGrasp | None = None
        self._last: tuple[GelImage, Seen] | None = None

    def problem(self, image: GelImage) -> str:
        """Why an image cannot be used, or ''."""
        rgb = image.rgb
        if not isinstance(rgb, np.ndarray) or rgb.dtype != np.uint8 or rgb.ndim != 3 or rgb.shape[2] != 3:
            return "an image is no array (H, W, 3) of uint8"
        if rgb.shape[:2] != self.camera.shape:
            return f"image has shape {rgb.shape[:2]}; the camera's calibration says {self.camera.shape}"
        some = rgb[::8, ::8]
        if int(some.max()) < 8:
            return "image is black: are the lamps on?"
        if np.count_nonzero(some == 255) > 0.5 * some.size:
            return "more than half of the image is saturated: lower the exposure"
        return ""

    def capture_reference(self, images: Sequence[GelImage]) -> None:
        """The gel touches nothing. Raises EstimatorError: no dots."""
        mean = mean_colour([i.rgb for i in images])
        whole = np.rint(mean).astype(np.uint8)
        dots, hidden = self._dots.find(whole)
        if len(dots) < self.settings.least_dots:
            raise EstimatorError(
                f"{self.finger}: {len(dots)} dots are seen, at least {self.settings.least_dots} must be: has the gel "
                "dots, and do `dot` and `pitch` fit it?"
            )
        h, w = self._canvas.shape
        n = self.settings.decimate
        full = filled(mean, hidden, 0.8 * self.settings.dot * float(self.camera.K[0, 0]) / self.settings.distance)
        self._free = cv2.resize(full[: h * n, : w * n], (w, h), interpolation=cv2.INTER_AREA)
        self._grasp = None

    def initialize_grasp(self, images: Sequence[GelImage]) -> ContactPatch:
        """The tool is grasped and rests. Raises EstimatorError: nothing touches, or too few dots do."""
        p, mean = self.settings, mean_colour([i.rgb for i in images])
        seen = self.look(GelImage(np.rint(mean).astype(np.uint8), images[-1].stamp))
        if not seen.patch.in_contact:
            raise EstimatorError(
                f"{self.finger} gel touches nothing: no {p.least_area * 1e6:g} mm^2 are pressed in by "
                f"{p.threshold * 1e3:g} mm. Close the gripper. A flat tool that fills the view is not seen either: the "
                "edges of the contact must be in view"
            )
        grasp = GelGrasp(seen, self._canvas, self._X_XC, p)
        if np.count_nonzero(grasp.core_dots) < p.least_dots:
            raise EstimatorError(
                f"{self.finger} gel: {np.count_nonzero(grasp.core_dots)} dots lie on the tool, at least {p.least_dots} "
                "must: press more, or hold it where more of it touches"
            )
        self._grasp = grasp
        return seen.patch

    def observe(self, image: GelImage, X_CT: Array) -> GelObservation:
        """One image; X_CT (4, 4): where the tool should be."""
        seen = self.look(image)
        self._last = image, seen
        grasp = self._grasp
        if grasp is None:
            return GelObservation(seen, None, np.zeros(0, np.intp), self.settings, self._canvas)
        dots = matched(seen.dots, grasp.expected_dots(X_CT), self._near)
        return GelObservation(seen, grasp, dots, self.settings, self._canvas)

    def look(self, image: GelImage) -> Seen:
        """Slopes, depth, patch and dots of an image."""
        assert self._free is not None
        dots, hidden_full = self._dots.find(image.rgb)
        h, w = self._canvas.shape
        n = self.settings.decimate
        hidden = np.asarray(
            cv2.resize(hidden_full[: h * n, : w * n] * 255, (w, h), interpolation=cv2.INTER_AREA) > 0, np.uint8
        )
        small = self._canvas.small(image.rgb).astype(np.float32)
        gx, gy = self._shading.slopes(change(small, self._free), self._maps)
        sigma = 0.6 * self.settings.dot / float(np.median(self._canvas.pitch[0]))
        both = filled(cv2.merge((gx, gy)), hidden, sigma)
        gx, gy = np.ascontiguousarray(both[..., 0]), np.ascontiguousarray(both[..., 1])
        u = self._integrator.imprint(gx, gy)
        mask = self._mask(u, gx, gy)
        return Seen(gx, gy, u, mask, hidden, dots, self._patch(mask, u))

    def _mask(self, u: Image, gx: Image, gy: Image) -> Mask:
        """(h, w) where the gel lies on the tool: beside it, it hangs as a skirt that falls by e over `decay`."""
        p = self.settings
        steep = (gx * gx + gy * gy) * np.float32(p.decay**2) < np.float32(0.5) * u * u
        deep = np.float32(max(p.threshold, 0.35 * float(u.max())))
        mask = np.asarray(steep & (u > deep), np.uint8)
        return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)), np.uint8)

    def _patch(self, mask: Mask, u: Image) -> ContactPatch:
        inside = mask > 0
        cell = self._canvas.pitch[0] * self._canvas.pitch[1]
        area = float(cell[inside].sum())
        if area < self.settings.least_area:
            return ContactPatch(self.finger)
        depth = u[inside]
        x, y = self._canvas.place[0][inside], self._canvas.place[1][inside]
        middle = np.array((x.mean(), y.mean(), self.settings.distance - depth.mean()), float)
        return replace(
            ContactPatch(self.finger, True, middle, self._X_CX[:3, :3] @ middle + self._X_CX[:3, 3]),
            pixels=int(np.count_nonzero(inside)), area=area, mean_indentation=float(depth.mean()),
            max_indentation=float(depth.max()),
        )  # fmt: skip

    def picture(self) -> NDArray[np.uint8]:
        """(H, W, 3) BGR of the last image: the patch outlined, dots marked."""
        if self._last is None:
            return np.zeros((*self.camera.shape, 3), np.uint8)
        image, seen = self._last
        panel = np.ascontiguousarray(image.rgb[..., ::-1])
        outline, _ = cv2.findContours(seen.mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        n = self.settings.decimate
        cv2.polylines(panel, [n * c for c in outline], True, (255, 255, 255), 1)
        for u, v in seen.dots:
            cv2.circle(panel, (round(float(u)), round(float(v))), 6, (60, 160, 255), 1)
        return panel

# SPDX-License-Identifier: Apache-2.0
"""Pinhole camera with lens distortion: pixels to rays and back.

Two models of distortion: `plumb_bob` (Brown and Conrady), as sensor_msgs/CameraInfo names it, and librealsense's
`inverse_brown_conrady`, which sensor_msgs does not know, and realsense2_camera calls `plumb_bob` (realsense-ros, issue
2458). With a = (u - cx)/fx, b = (v - cy)/fy measured, x, y true and B of `distortion`, the one is (a, b) = B(x, y), the
other (x, y) = B(a, b).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from seed_core.errors import SeedError
from seed_core.spatial import Array
from seed_estimation.images.distortion import brown, fitted_inverse, inverse_brown
from seed_estimation.images.tactile_images import Array32, Bools, Image, Mask

MODELS = ("plumb_bob", "inverse_brown_conrady")
MAX_SIDE = 4096  # [px]; larger sizes are a broken message
_ALIKE = 0.02  # [px] by which another model of the lens may differ


class CameraError(SeedError):
    """Numbers that describe no camera; the message names the one that is wrong."""


@dataclass(frozen=True, eq=False)
class PinholeCamera:
    """Intrinsic calibration of one camera; the optical frame has z forward, x right, y down.

    Attributes:
        width, height: of the image [px].
        K: (3, 3) camera matrix [px].
        D: (5,) k1 k2 p1 p2 k3 of `model`; zeros for a rectified stream.
        model: 'plumb_bob' or 'inverse_brown_conrady'.

    Raises:
        CameraError: a value is missing, not finite, or contradicts the image size.
    """

    width: int
    height: int
    K: Array
    D: Array = field(default_factory=lambda: np.zeros(5))
    model: str = "plumb_bob"

    def __post_init__(self) -> None:
        for name, value in (("width", self.width), ("height", self.height)):
            if not 8 <= value <= MAX_SIDE:
                raise CameraError(f"camera {name} = {value} px must be within 8 and {MAX_SIDE}")
        object.__setattr__(self, "K", _checked_matrix(self.K, self.width, self.height))
        object.__setattr__(self, "D", _checked_distortion(self.D))
        if self.model not in MODELS:
            raise CameraError(f"distortion_model '{self.model}' is not known; use one of: {', '.join(MODELS)}")

    @classmethod
    def from_info(
        cls, width: int, height: int, k: Sequence[float], d: Sequence[float], model: str = ""
    ) -> PinholeCamera:
        """From the values of a sensor_msgs/CameraInfo: k (9,) row-major; d may be empty (rectified).

        Raises:
            CameraError: a value is missing, not finite, or contradicts the image size.
        """
        values = np.asarray(k, dtype=float).ravel()
        if values.size != 9:
            raise CameraError(f"camera_info.k has {values.size} values; it needs 9 (row-major 3 x 3)")
        if not np.any(np.asarray(d, dtype=float)):
            model = "plumb_bob"  # no distortion: every model is the same
        return cls(int(width), int(height), values.reshape(3, 3), np.asarray(d, dtype=float), model or "plumb_bob")

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), as numpy has it."""
        return self.height, self.width

    def matches(self, other: PinholeCamera) -> bool:
        """Whether two calibrations are the same to rounding."""
        same = self.shape == other.shape and (self.model == other.model or not (self.D.any() or other.D.any()))
        return same and bool(np.allclose(self.K, other.K, atol=1e-3) and np.allclose(self.D, other.D, atol=1e-6))

    def decimated(self, n: int) -> PinholeCamera:
        """The camera of an image of which every n-th pixel and line is kept, from the first on."""
        if n == 1:
            return self
        K = self.K.copy()
        K[:2] /= n
        return PinholeCamera(-(-self.width // n), -(-self.height // n), K, self.D, self.model)

    @cached_property
    def rays(self) -> Array:
        """(H, W, 3) undistorted rays with z = 1: a point at depth d in pixel (v, u) is d * rays[v, u]."""
        u, v = np.meshgrid(np.arange(self.width, dtype=float), np.arange(self.height, dtype=float))
        rays = self.pixel_rays(np.stack((u, v), axis=-1))
        rays.setflags(write=False)
        return rays

    @cached_property
    def rays32(self) -> Array32:
        """The rays in single precision."""
        rays = self.rays.astype(np.float32)
        rays.setflags(write=False)
        return rays

    def pixel_rays(self, pixels: ArrayLike) -> Array:
        """(..., 3) rays with z = 1 through pixels (..., 2) given as (u, v)."""
        uv = np.asarray(pixels, dtype=float)
        a, b = (uv[..., 0] - self.K[0, 2]) / self.K[0, 0], (uv[..., 1] - self.K[1, 2]) / self.K[1, 1]
        x, y = brown(a, b, self.D) if self.model == "inverse_brown_conrady" else inverse_brown(a, b, self.D)
        return np.stack((x, y, np.ones_like(x)), axis=-1)

    def project(self, p: ArrayLike) -> Array:
        """Pixels (..., 2) as (u, v) of points (..., 3) in the optical frame [m]; NaN behind the camera."""
        points = np.asarray(p, dtype=float)
        z = np.where(points[..., 2] > 0.0, points[..., 2], np.nan)
        x, y = points[..., 0] / z, points[..., 1] / z
        a, b = brown(x, y, self.D) if self.model == "plumb_bob" else inverse_brown(x, y, self.D)
        return np.stack((self.K[0, 0] * a + self.K[0, 2], self.K[1, 1] * b + self.K[1, 2]), axis=-1)

    def project32(self, p: Array32) -> Array32:
        """Pixels (2, N) of points (3, N) in the optical frame [m], in single precision, to 0.02 px."""
        D = self._plumb_bob
        if D is None:
            return np.ascontiguousarray(self.project(p.T).T, dtype=np.float32)
        out = p[:2] / p[2]
        if any(D):
            k1, k2, p1, p2, k3 = D
            square = out * out
            r2 = square[0] + square[1]
            c = ((k3 * r2 + k2) * r2 + k1) * r2 + np.float32(1.0)
            if p1 or p2:
                xy = np.float32(2.0) * out[0] * out[1]
                shift = np.stack((p1 * xy + p2 * (r2 + 2 * square[0]), p1 * (r2 + 2 * square[1]) + p2 * xy))
                out = np.asarray(out * c + shift, np.float32)
            else:
                out *= c
        out *= self._focal_and_centre[:, :1]
        out += self._focal_and_centre[:, 1:]
        return np.asarray(out, np.float32)

    @cached_property
    def _focal_and_centre(self) -> Array32:
        """(2, 2) focal lengths and principal point, a column each [px]."""
        return np.stack((self.K.diagonal()[:2], self.K[:2, 2]), axis=1).astype(np.float32)

    @cached_property
    def _plumb_bob(self) -> tuple[np.float32, ...] | None:
        """k1 k2 p1 p2 k3 of the plumb_bob that gives the same pixels all over the image; None where none does."""
        if self.model == "plumb_bob":
            return tuple(self.D.astype(np.float32))
        u, v = np.meshgrid(np.linspace(0.0, self.width - 1.0, 33), np.linspace(0.0, self.height - 1.0, 33))
        a, b = (u.ravel() - self.K[0, 2]) / self.K[0, 0], (v.ravel() - self.K[1, 2]) / self.K[1, 1]
        D, worst = fitted_inverse(a, b, self.D)
        return tuple(D.astype(np.float32)) if worst * float(max(self.K[0, 0], self.K[1, 1])) < _ALIKE else None

    def back_project(self, depth: Image, mask: Mask | Bools) -> Array:
        """Points (N, 3) [m] in the optical frame of the pixels in mask (H, W) whose depth (H, W) [m] is finite."""
        v, u = np.nonzero(mask)
        z = depth[v, u]
        good = np.isfinite(z)
        return np.asarray(self.rays[v[good], u[good]] * z[good, None].astype(float))


def _checked_matrix(values: ArrayLike, width: int, height: int) -> Array:
    K = np.array(values, dtype=float)
    if K.shape != (3, 3) or not np.isfinite(K).all():
        raise CameraError(f"camera matrix must be 3 x 3 and finite, not {K.tolist()}")
    if not (K[0, 0] > 0.0 and K[1, 1] > 0.0):
        raise CameraError(f"focal lengths fx = {K[0, 0]:g}, fy = {K[1, 1]:g} px must be > 0: is the camera calibrated?")
    if not (0.0 <= K[0, 2] < width and 0.0 <= K[1, 2] < height):
        raise CameraError(
            f"principal point ({K[0, 2]:g}, {K[1, 2]:g}) px lies outside the image of {width} x {height}: "
            "the camera_info belongs to another resolution"
        )
    K.setflags(write=False)
    return K


def _checked_distortion(values: ArrayLike) -> Array:
    D = np.array(values, dtype=float).ravel()
    if not np.isfinite(D).all():
        raise CameraError(f"distortion coefficients {D.tolist()} must be finite")
    if D.size > 5 and D[5:].any():
        raise CameraError(f"{D.size} distortion coefficients (rational model) are not supported; give k1 k2 p1 p2 k3")
    D = np.concatenate([D[:5], np.zeros(max(0, 5 - D.size))])
    D.setflags(write=False)
    return D

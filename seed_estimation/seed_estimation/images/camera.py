# SPDX-License-Identifier: Apache-2.0
"""Pinhole camera with lens distortion: pixels to rays and back.

Two models of distortion (named as in sensor_msgs/CameraInfo). With a = (u - cx)/fx, b = (v - cy)/fy measured,
x, y true, c = 1 + k1 r2 + k2 r2^2 + k3 r2^3 and

    B(x, y) = (x c + 2 p1 x y + p2 (r2 + 2 x^2), y c + p1 (r2 + 2 y^2) + 2 p2 x y)

`plumb_bob` (Brown and Conrady) is (a, b) = B(x, y); `inverse_brown_conrady` (RealSense) is (x, y) = B(a, b).
D is k1 k2 p1 p2 k3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seed_core.errors import SeedError
from seed_core.spatial import Array

MODELS = ("plumb_bob", "inverse_brown_conrady")
MAX_SIDE = 4096  # [px]; larger sizes are a broken message
_STEPS = 20  # Newton steps; the strongest lens in use needs 6
_ALIKE = 0.02  # [px] another model of the lens may differ by
_EXACT = 1e-9  # [1], on unit-z rays: 2e-7 px


class CameraError(SeedError):
    """A calibration that is none."""


class Single(NamedTuple):
    """Focal lengths (2, 1), principal point (2, 1) [px], distortion (5), and which parts of that there are."""

    focal: NDArray[np.float32]
    centre: NDArray[np.float32]
    D: tuple[np.float32, ...]
    distorted: bool
    tangential: bool


@dataclass(frozen=True, eq=False)
class PinholeCamera:
    """Intrinsic calibration of one camera; the optical frame has z forward, x right, y down.

    Attributes:
        width, height: of the image [px].
        K: (3, 3) camera matrix [px].
        D: (5,) k1 k2 p1 p2 k3 of `model`; zeros for a rectified stream.
        model: 'plumb_bob' or 'inverse_brown_conrady'.
    """

    width: int
    height: int
    K: Array
    D: Array = field(default_factory=lambda: np.zeros(5))
    model: str = "plumb_bob"

    def __post_init__(self) -> None:
        _check_size(self.width, self.height)
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

    def rays(self) -> Array:
        """(H, W, 3) undistorted rays with z = 1: a point at depth d in pixel (v, u) is d * rays()[v, u]."""
        return self._rays

    @cached_property
    def _rays(self) -> Array:
        u, v = np.meshgrid(np.arange(self.width, dtype=float), np.arange(self.height, dtype=float))
        rays = self.pixel_rays(np.stack((u, v), axis=-1))
        rays.setflags(write=False)
        return rays

    @cached_property
    def rays32(self) -> NDArray[np.float32]:
        """rays() in single precision, for work at the frame rate."""
        rays = self._rays.astype(np.float32)
        rays.setflags(write=False)
        return rays

    @cached_property
    def single(self) -> Single | None:
        """The calibration in single precision, as plumb_bob; None where that model does not fit the lens."""
        D = self.D if self.model == "plumb_bob" else self._as_plumb_bob()
        if D is None:
            return None
        K = self.K.astype(np.float32)
        tangential = bool(D[2:4].any())
        return Single(K[(0, 1), (0, 1)][:, None], np.ascontiguousarray(K[:2, 2:]), tuple(D.astype(np.float32)),
                      bool(D.any()), tangential)  # fmt: skip

    def _as_plumb_bob(self) -> Array | None:
        """(5,) of the plumb_bob that gives the same pixels to _ALIKE all over the image, by least squares."""
        u, v = np.meshgrid(np.linspace(0.0, self.width - 1.0, 33), np.linspace(0.0, self.height - 1.0, 33))
        a, b = (u.ravel() - self.K[0, 2]) / self.K[0, 0], (v.ravel() - self.K[1, 2]) / self.K[1, 1]
        x, y = brown(a, b, self.D)
        unit = np.eye(5)
        columns = np.array([np.concatenate(brown(x, y, one)) - np.concatenate((x, y)) for one in unit]).T
        shift = np.concatenate((a - x, b - y))
        D = np.linalg.lstsq(columns, shift, rcond=None)[0]
        worst = float(np.abs(columns @ D - shift).max()) * float(max(self.K[0, 0], self.K[1, 1]))
        return np.asarray(D) if worst < _ALIKE else None

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

    def back_project(self, depth: NDArray[Any], mask: NDArray[Any]) -> Array:
        """Points (N, 3) [m] in the optical frame of the pixels in mask (H, W) whose depth (H, W) [m] is finite."""
        v, u = np.nonzero(mask)
        z = depth[v, u]
        good = np.isfinite(z)
        return np.asarray(self._rays[v[good], u[good]] * z[good, None].astype(float))


def brown(x: Array, y: Array, D: Array) -> tuple[Array, Array]:
    """B(x, y) of the module's head."""
    k1, k2, p1, p2, k3 = (float(d) for d in D)
    r2 = x * x + y * y
    c = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return x * c + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y * c + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y


def inverse_brown(a: Array, b: Array, D: Array) -> tuple[Array, Array]:
    """x, y with B(x, y) = (a, b), by Newton's method from (a, b); NaN where it does not settle (outside the lens)."""
    if not D.any():
        return np.array(a), np.array(b)
    k1, k2, p1, p2, k3 = (float(d) for d in D)
    x, y = np.array(a, dtype=float), np.array(b, dtype=float)
    ex, ey = np.zeros_like(x), np.zeros_like(y)
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            fx, fy = brown(x, y, D)
            ex, ey = fx - a, fy - b
            if np.nanmax(np.abs(ex) + np.abs(ey), initial=0.0) < 1e-14:
                break
            r2 = x * x + y * y
            c = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))
            xx = c + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
            xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
            yy = c + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
            det = xx * yy - xy * xy
            x, y = x - (yy * ex - xy * ey) / det, y - (xx * ey - xy * ex) / det
        fx, fy = brown(x, y, D)
        settled = np.abs(fx - a) + np.abs(fy - b) < _EXACT
    return np.where(settled, x, np.nan), np.where(settled, y, np.nan)


def _check_size(width: int, height: int) -> None:
    for name, value in (("width", width), ("height", height)):
        if not 8 <= value <= MAX_SIDE:
            raise CameraError(f"camera {name} = {value} px must be within 8 and {MAX_SIDE}")


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

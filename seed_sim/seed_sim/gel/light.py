# SPDX-License-Identifier: Apache-2.0
"""Colours of a gel's coat: three coloured lamps beside the window, gloss, dots, and a camera with a gamma.

Lamps are near and long: how bright and from where they shine differs from place to place. The coat's response falls off
softly where it turns from a lamp, and is glossy.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array
from seed_estimation import PinholeCamera
from seed_sim.gel.parameters import GelParameters
from seed_sim.gel.shapes import Field

_RING, _ABOVE = 0.0145, 0.0045  # [m] of the lamps from the axis, and in front of the free gel
_ANGLES = (90.0, 210.0, 330.0)  # [deg] of the red, green and blue lamp
_LONG = (-18.0, 0.0, 18.0)  # [deg] places on one lamp
_SOFT = 0.06  # of the cosine around which a lamp goes down behind the slope
_GREY = 0.16  # linear brightness of the free gel, on average
_AMBIENT = 0.05  # of that
_TEXEL = 4e-5  # [m] of the dots' texture
_READ, _SHOT = 0.8, 0.9  # [counts] deviation of the noise: constant, and at mid grey


class Lamps:
    """Linear colours of the coat, pixel by pixel."""

    def __init__(self, p: GelParameters, points: NDArray[np.float32], rng: np.random.Generator) -> None:
        """points (3, H, W) [m] of the free gel that the pixels see, in the optical frame."""
        self._gloss = np.float32(p.gloss)
        to_eye = -points / np.linalg.norm(points, axis=0)
        self._toward: list[NDArray[np.float32]] = []
        self._half: list[NDArray[np.float32]] = []
        for angle in _ANGLES:
            bearing = angle + rng.normal(0.0, 4.0)
            power = np.float32(np.exp(rng.normal(0.0, p.lamp_spread)))
            light, weight = np.zeros_like(points), np.zeros(points.shape[1:], np.float32)
            for part in _LONG:
                a = np.deg2rad(bearing + part)
                lamp = np.array((_RING * np.cos(a), _RING * np.sin(a), p.distance - _ABOVE), np.float32)
                way = lamp[:, None, None] - points
                square = (way * way).sum(0)
                near = power * np.float32(_RING**2 / len(_LONG)) / square
                light += way / np.sqrt(square) * near
                weight += near
            self._toward.append(light)
            half = light / np.linalg.norm(light, axis=0) + to_eye
            self._half.append((half / np.linalg.norm(half, axis=0) * np.cbrt(np.cbrt(weight))).astype(np.float32))
        mix = np.full((3, 3), p.crosstalk) + (1.0 - 2.0 * p.crosstalk) * np.eye(3)
        self._mix = np.asarray(mix * np.exp(rng.normal(0.0, 0.1, (3, 3))), np.float32)
        off = (points[0] ** 2 + points[1] ** 2) / np.float32(0.012**2)
        self._lens = np.asarray(1.0 - 0.25 * off, np.float32)
        zero = np.zeros(points.shape[1:], np.float32)
        self._gain = np.float32(1.0)
        self._gain = np.float32(_GREY / self.linear((zero, zero)).mean())

    def linear(self, slope: tuple[Field, Field]) -> NDArray[np.float32]:
        """(H, W, 3) of a coat of albedo 1 with slopes du/dx, du/dy (H, W)."""
        gx, gy = slope
        nz = -1.0 / np.sqrt(1.0 + gx * gx + gy * gy)
        nx, ny = gx * nz, gy * nz  # towards the camera
        lamps = []
        for toward, half in zip(self._toward, self._half, strict=True):
            c = nx * toward[0] + ny * toward[1] + nz * toward[2]
            lit = np.float32(0.5) * (c + np.sqrt(c * c + np.float32(_SOFT**2)))
            h = np.maximum(nx * half[0] + ny * half[1] + nz * half[2], 0.0)
            h = h * h
            h = h * h
            lamps.append(lit + self._gloss * h * h)
        seen = cv2.transform(cv2.merge(lamps), self._mix) * self._lens[..., None]
        return np.asarray(seen * self._gain + np.float32(_AMBIENT * _GREY), np.float32)


class Dots:
    """Dots on the coat, and its faint unevenness, as a texture of the material."""

    def __init__(self, p: GelParameters, rng: np.random.Generator) -> None:
        half = np.array((0.0125, 0.0100))
        w, h = np.ceil(2.0 * half / _TEXEL).astype(int)
        self._middle = np.float32(0.5 * (w - 1)), np.float32(0.5 * (h - 1))
        uneven = rng.standard_normal((h // 12, w // 12), dtype=np.float32)
        base = 1.0 + 0.012 * cv2.resize(cv2.GaussianBlur(uneven, (0, 0), 1.0), (int(w), int(h)))
        self.albedo: Field = np.asarray(base, np.float32)
        n = np.floor(half / p.dot_pitch).astype(int)
        for i in range(-n[0], n[0] + 1):
            for j in range(-n[1], n[1] + 1):
                at = (np.array((i, j)) + rng.normal(0.0, p.dot_jitter, 2)) * p.dot_pitch
                self._stamp(at, p.dot_radius * rng.uniform(0.9, 1.1), float(rng.uniform(0.80, 0.92)))

    def _stamp(self, at: Array, radius: float, contrast: float) -> None:
        u, v = at[0] / _TEXEL + self._middle[0], at[1] / _TEXEL + self._middle[1]
        reach = int(radius / _TEXEL) + 4
        c, r = round(u), round(v)
        if not (reach <= c < self.albedo.shape[1] - reach and reach <= r < self.albedo.shape[0] - reach):
            return
        y, x = np.mgrid[r - reach : r + reach + 1, c - reach : c + reach + 1]
        inside = np.clip(0.5 + 0.5 * (radius / _TEXEL - np.hypot(x - u, y - v)), 0.0, 1.0)
        self.albedo[r - reach : r + reach + 1, c - reach : c + reach + 1] *= (1.0 - contrast * inside).astype(
            np.float32
        )

    def at(self, mx: Field, my: Field) -> Field:
        """Albedo (H, W) of material (H, W) [m]."""
        scale = np.float32(1.0 / _TEXEL)
        u, v = mx * scale + self._middle[0], my * scale + self._middle[1]
        return np.asarray(cv2.remap(self.albedo, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT), np.float32)


class Exposure:
    """From linear colours to counts."""

    def __init__(self, p: GelParameters, rng: np.random.Generator) -> None:
        self._p, self._rng = p, rng
        gamma = float(rng.uniform(*p.gamma))
        self._curve = (255.0 * np.linspace(0.0, 1.0, 4096) ** (1.0 / gamma)).astype(np.float32)

    def counts(self, linear: NDArray[np.float32]) -> NDArray[np.uint8]:
        """(H, W, 3) of linear colours, 1 being full."""
        if self._p.blur > 0.0:
            linear = cv2.GaussianBlur(linear, (0, 0), self._p.blur)
        index = np.clip(linear * np.float32(4095.0), 0.0, 4095.0).astype(np.uint16)
        image = self._curve[index]
        if self._p.noise > 0.0:
            white = self._rng.standard_normal(image.shape, dtype=np.float32)
            image = image + white * np.float32(self._p.noise) * (_READ + np.sqrt(image) * np.float32(_SHOT / 11.3))
        return np.asarray(np.clip(np.rint(image), 0.0, 255.0), np.uint8)


def seen_points(camera: PinholeCamera, distance: float) -> NDArray[np.float32]:
    """(3, H, W) [m] points of the free gel that the pixels see."""
    return np.ascontiguousarray(np.moveaxis(camera.rays32 * np.float32(distance), -1, 0))

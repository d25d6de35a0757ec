# SPDX-License-Identifier: Apache-2.0
"""The infrared image: printed dots, light that falls off, a patch that brightens, a specular spot."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_sim.tactile.geometry import Image, Rays
from seed_sim.tactile.membrane import DeformedMembrane
from seed_sim.tactile.parameters import TactileParameters

CELL = 0.0002  # [m] of the texture; a dot's radius is two cells
_BROAD = 0.002  # [m]; imprint at which most of the brightening is reached
_PERIOD = 7.0  # [s] of the swing of the patch's brightness


class DotPattern:
    """Dots on a jittered grid, printed on the flat sheet: albedo over x and z of the material in C."""

    def __init__(self, p: TactileParameters, rng: np.random.Generator) -> None:
        w, h = int(2 * p.rim_x / CELL) + 1, int(2 * p.rim_z / CELL) + 1
        self.albedo = _mottle((h, w), rng)
        reach = math.ceil(3.5 * p.dot_radius / CELL)
        side = np.arange(-reach, reach + 1, dtype=np.float32)
        rows, columns = int(h * CELL / p.dot_pitch) + 1, int(w * CELL / p.dot_pitch) + 1
        for row in range(rows):
            for column in range(columns):
                place = (
                    (np.array((row, column + 0.5 * (row % 2))) + rng.normal(0.0, p.dot_jitter, 2)) * p.dot_pitch / CELL
                )
                contrast = rng.uniform(*p.dot_contrast)
                _stamp(self.albedo, place, side, p.dot_radius / CELL * rng.uniform(0.85, 1.15), float(contrast))

    def at(self, cells: NDArray[np.float32]) -> Image:
        """Albedo (H, W) of the texture's cells (2, H, W): column and row."""
        return np.asarray(cv2.remap(self.albedo, cells[0], cells[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))

    def cells(self, material: NDArray[np.float32]) -> NDArray[np.float32]:
        """Column and row (2, h, w) in the texture of material (2, h, w) [m]."""
        h, w = self.albedo.shape
        middle = np.array((0.5 * (w - 1), 0.5 * (h - 1)), np.float32)
        return np.asarray(material * np.float32(1.0 / CELL) + middle[:, None, None], np.float32)


def _mottle(shape: tuple[int, int], rng: np.random.Generator) -> Image:
    """Faint unevenness of the sheet (h, w) around 1."""
    noise = rng.standard_normal((shape[0] // 8 + 1, shape[1] // 8 + 1), dtype=np.float32)
    smooth = cv2.resize(cv2.GaussianBlur(noise, (0, 0), 1.0), (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
    return np.asarray(1.0 + 0.015 * smooth / smooth.std(), np.float32)


def _stamp(albedo: Image, place: NDArray[np.float64], side: Image, radius: float, contrast: float) -> None:
    row, column = round(float(place[0])), round(float(place[1]))
    reach = len(side) // 2
    if not (reach <= row < albedo.shape[0] - reach and reach <= column < albedo.shape[1] - reach):
        return
    y, x = side[:, None] - (place[0] - row), side[None, :] - (place[1] - column)
    blot = 1.0 - contrast * np.exp(-(x * x + y * y) / (2.0 * radius * radius))
    albedo[row - reach : row + reach + 1, column - reach : column + reach + 1] *= blot.astype(np.float32)


class Light:
    """Counts that a membrane of albedo 1 gives: the lamp's uneven beam, distance, slope, contact."""

    def __init__(
        self, rays: Rays, rest: DeformedMembrane, shape: tuple[int, int], p: TactileParameters, rng: np.random.Generator
    ) -> None:
        """rays, rest: on the coarse grid; shape (H, W) of the image."""
        self._p, self._rays = p, rays
        self._length = np.linalg.norm(rays.directions, axis=0).astype(np.float32)
        h, w = rest.depth.shape
        middle = rays.directions[:, h // 2, w // 2 : w // 2 + 2]
        self._pitch = np.float32(np.linalg.norm(middle[:, 1] - middle[:, 0]))  # from pixel to pixel at depth 1
        self._beam = _beam(h, w, rng) / self._falloff(rest.depth)
        bright = float(np.percentile(self._beam * self._falloff(rest.depth), 99.0))
        self._beam *= np.float32(1330.0 / bright)
        self._spot = _spot(shape, p) if p.specular > 0.0 else np.zeros(shape, np.float32)

    def counts(self, shape: DeformedMembrane, stamp: float) -> Image:
        """(h, w) coarse."""
        touched = 1.0 - np.exp(shape.imprint * np.float32(-1.0 / _BROAD))
        swing = 0.5 * self._p.brightness_change * (1.0 - math.cos(2.0 * math.pi * stamp / _PERIOD))
        gain = (1.0 + touched * np.float32(self._p.brightness)) * (1.0 + touched * np.float32(swing))
        return np.asarray(self._beam * self._falloff(shape.depth) * gain, np.float32)

    def with_spot(self, image: Image) -> Image:
        """image (H, W) with the specular spot, which stays where camera and lamp put it."""
        return np.maximum(image, self._spot)

    def _falloff(self, depth: Image) -> Image:
        """Inverse square of distance and, by half, Lambert's cosine: what the beam's measured share leaves (h, w)."""
        dx = cv2.Sobel(depth, -1, 1, 0, ksize=3, scale=1.0 / 8.0)
        dy = cv2.Sobel(depth, -1, 0, 1, ksize=3, scale=1.0 / 8.0)
        per = 1.0 / (self._pitch * depth)
        cosine = 1.0 / np.sqrt(1.0 + (dx * per) ** 2 + (dy * per) ** 2)
        distance = depth * self._length
        return np.asarray((0.5 + 0.5 * cosine) * np.float32(0.09**2) / (distance * distance), np.float32)


def _beam(h: int, w: int, rng: np.random.Generator) -> Image:
    """Brightness over the image as a recorded one has it: bright right of the middle, dark at the right edge."""
    y, x = np.meshgrid(np.linspace(0.0, 1.0, h), np.linspace(0.0, 1.0, w), indexing="ij")
    cx, cy = 0.66 + 0.03 * rng.standard_normal(), 0.5 + 0.05 * rng.standard_normal()
    hill = np.exp(-((x - cx) ** 2) / (2 * 0.2**2) - (y - cy) ** 2 / (2 * 0.4**2))
    edge = 0.08 + 0.92 / (1.0 + np.exp((x - 0.86) / 0.03))
    corner = (
        1.0
        - 0.9 * np.exp(-(((x * x) + (y * y)) / (2 * 0.06**2)))
        - 0.7 * np.exp(-((x * x + (1 - y) ** 2) / (2 * 0.05**2)))
    )
    return np.asarray((0.45 + 0.55 * hill) * edge * np.maximum(corner, 0.05), np.float32)


def _spot(shape: tuple[int, int], p: TactileParameters) -> Image:
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    scale = shape[1] / 224.0
    r2 = ((x - p.specular_at[0] * shape[1]) ** 2 + (y - p.specular_at[1] * shape[0]) ** 2) / scale**2
    return np.asarray(p.specular * np.exp(-np.maximum(r2 - 5.0, 0.0) / (2.0 * 1.2**2)), np.float32)

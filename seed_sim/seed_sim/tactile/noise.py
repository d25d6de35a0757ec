# SPDX-License-Identifier: Apache-2.0
"""Errors of the two cameras. Figures: measured on recordings of a pmd PicoFlexx and of a RealSense D405."""

import math
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_sim.tactile.geometry import Image
from seed_sim.tactile.parameters import TactileParameters


class CameraNoise(Protocol):
    """Adds the errors of one camera to one frame."""

    def add_to(self, depth: Image, albedo: Image, ir: Image) -> tuple[Image, Image]:
        """Measured depth (H, W) [m], NaN where none, and infrared [counts] of true ones and of the albedo."""


def smooth_field(shape: tuple[int, int], sigma: float, rng: np.random.Generator) -> Image:
    """Gaussian noise (h, w) of unit deviation, smooth over sigma [px]."""
    border = math.ceil(3 * sigma)
    size = (shape[0] + 2 * border, shape[1] + 2 * border)
    field = cv2.GaussianBlur(rng.standard_normal(size, dtype=np.float32), (0, 0), sigma)
    field = field[border : border + shape[0], border : border + shape[1]]
    return np.asarray(field / field.std(), np.float32)


def range_error(shape: tuple[int, int], rng: np.random.Generator) -> Image:
    """Smooth range error (h, w) [m] of a PicoFlexx: reads far by 5.7 mm (5-95 %: 1.6 to 17), worst at one rim."""
    y, x = np.meshgrid(np.linspace(-1.0, 1.0, shape[0]), np.linspace(-1.0, 1.0, shape[1]), indexing="ij")
    scale = 0.0010 * smooth_field(shape, 0.09 * shape[1], rng)
    right = 0.0165 / (1.0 + np.exp(-(x - 0.84) / 0.07))
    bowl = 0.0027 + 0.0040 * np.abs(y) ** 2.2 + 0.0050 * np.maximum(-x, 0.0) ** 1.6 + 0.0026 * np.maximum(y, 0.0) ** 3
    return np.asarray(np.maximum(bowl + right + scale, 0.0003), np.float32)


class WhiteNoise:
    """Standard normal images, each a random window of one long stretch: drawing anew would cost as much as the rest."""

    LENGTH = 1 << 20

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._stretch = rng.standard_normal(self.LENGTH, dtype=np.float32)

    def __call__(self, shape: tuple[int, int]) -> Image:
        count = shape[0] * shape[1]
        start = int(self._rng.integers(0, self.LENGTH - count))
        return self._stretch[start : start + count].reshape(shape)


class PicoFlexxNoise:
    """White noise, a fixed pattern, a smooth range error, dipoles at the dots, corners without depth."""

    WHITE = 0.0005  # [m] per pixel and frame
    FIXED = 0.00058  # [m]; neighbours correlated by 0.69
    FIXED_SIGMA = 0.82  # [px] of the blur that gives 0.69
    DIPOLE = 0.0006  # [m] per unit step of albedo
    IR_SHARE, IR_FLOOR = 0.01, 1.5  # of the counts; [counts]

    def __init__(self, shape: tuple[int, int], p: TactileParameters, rng: np.random.Generator) -> None:
        self._p, self._rng = p, rng
        self._white = WhiteNoise(rng)
        self.fixed = np.float32(p.pattern * self.FIXED) * smooth_field(shape, self.FIXED_SIGMA, rng)
        self.offset = np.float32(p.range_offset) * range_error(shape, rng)
        self.invalid = _corners(shape)
        self._static = self.fixed + self.offset
        self._static[self.invalid] = np.nan

    def add_to(self, depth: Image, albedo: Image, ir: Image) -> tuple[Image, Image]:
        p = self._p
        measured = depth + self._static
        if p.pattern > 0.0:
            measured[:, 1:-1] += np.float32(p.pattern * self.DIPOLE) * (albedo[:, 2:] - albedo[:, :-2])
        measured += np.float32(p.noise * self.WHITE) * self._white(depth.shape)
        self._drop_pixels(measured)
        deviation = np.float32(p.noise * self.IR_SHARE) * ir + np.float32(p.noise * self.IR_FLOOR)
        counts = ir + deviation * self._white(ir.shape)
        return measured, np.clip(np.rint(counts, out=counts), 0.0, 65535.0, out=counts)

    def _drop_pixels(self, measured: Image) -> None:
        count = self._rng.poisson(self._p.dropouts * 3e-4 * measured.size)
        measured.ravel()[self._rng.integers(0, measured.size, count)] = np.nan


def _corners(shape: tuple[int, int]) -> NDArray[np.bool_]:
    """The 3.4 % of pixels of a PicoFlexx's image that never give depth."""
    y, x = np.meshgrid(np.linspace(-1.0, 1.0, shape[0]), np.linspace(-1.0, 1.0, shape[1]), indexing="ij")
    distance = np.abs(x) ** 4 + np.abs(y) ** 4
    return np.asarray(distance > np.percentile(distance, 96.6), bool)


class D405Noise:
    """Correlated noise with heavy tails, blobs without depth, a rim that stereo cannot match, whole quanta.

    Its temporal filter is a parameter: on a recorded press a step of depth dies by 0.6 a frame, and grey has none.
    """

    MEDIAN = 0.000045  # [m]; deviation of most pixels; 95 %: 0.11 mm, 99 %: 0.18 mm
    TIME = 0.63  # correlation from frame to frame
    SPACE = ((0.32, 0.6, 1), (0.35, 3.5, 2), (0.33, 7.0, 4))  # share, blur [px], reduction: 0.82/0.56/0.33/0.09
    TAIL = 4e-4  # share of pixels beyond 0.5 mm
    BLOB = 0.008  # share of the interior missing per frame
    GREY_NOISE = 1.5  # [counts] of 255

    def __init__(
        self, shape: tuple[int, int], p: TactileParameters, rng: np.random.Generator, seen: NDArray[np.bool_]
    ) -> None:
        """seen (H, W): where the membrane is; outside, stereo finds nothing or nonsense."""
        self._p, self._rng, self._shape = p, rng, shape
        self.scale = np.float32(self.MEDIAN) * np.exp(0.55 * smooth_field(shape, 10.0, rng))
        self._state = self._fresh()
        self._before: Image | None = None
        ragged = cv2.distanceTransform(seen.astype(np.uint8), cv2.DIST_L2, 3) + 9.0 * smooth_field(shape, 8.0, rng)
        self.blind = ragged < 32.0

    def add_to(self, depth: Image, albedo: Image, ir: Image) -> tuple[Image, Image]:
        del albedo
        p, rng = self._p, self._rng
        self._state = self.TIME * self._state + math.sqrt(1.0 - self.TIME**2) * self._fresh()
        if p.memory > 0.0:
            before = depth if self._before is None else self._before
            depth = self._before = depth + np.float32(p.memory) * (before - depth)
        measured = depth + np.float32(p.noise) * self.scale * self._state
        tail = rng.random(depth.shape, dtype=np.float32) < p.noise * self.TAIL
        measured[tail] += rng.standard_t(2.5, int(tail.sum())).astype(np.float32) * np.float32(0.0012)
        if p.quantum > 0.0:
            measured = np.rint(measured / np.float32(p.quantum)) * np.float32(p.quantum)
        self._drop_regions(measured)
        grey = ir * np.float32(255.0 / 1500.0) + np.float32(p.noise * self.GREY_NOISE) * rng.standard_normal(
            ir.shape, dtype=np.float32
        )
        return np.asarray(measured, np.float32), np.clip(np.rint(grey), 0.0, 255.0)

    def _fresh(self) -> Image:
        """Noise (H, W) of unit deviation, correlated over 1, 4, 8, 16 px as measured (0.82, 0.59, 0.35, 0.09)."""
        h, w = self._shape
        out = np.zeros((h, w), np.float32)
        for share, blur, n in self.SPACE:
            part = cv2.resize(smooth_field((h // n + 1, w // n + 1), blur / n, self._rng), (w, h))
            out += np.float32(math.sqrt(share)) * part / part.std()
        return out

    def _drop_regions(self, measured: Image) -> None:
        """Missing blobs (most a few pixels, few of hundreds), the blind rim, and far values beside the membrane."""
        rng, missing = self._rng, np.zeros(self._shape, np.uint8)
        wanted, area = self._p.dropouts * self.BLOB * measured.size, 0.0
        while area < wanted:
            size = min(float(3.0 * np.exp(1.8 * rng.standard_normal())), 484.0)
            centre = (int(rng.integers(self._shape[1])), int(rng.integers(self._shape[0])))
            radius = max(math.sqrt(size / math.pi), 0.5)
            axes = (max(1, round(radius * 1.3)) if size > 4 else 0, max(1, round(radius / 1.3)) if size > 4 else 0)
            cv2.ellipse(missing, centre, axes, float(rng.uniform(0, 180)), 0, 360, 1, -1)
            area += max(size, 1.0)
        measured[(missing > 0) | self.blind] = np.nan
        far = self.blind & (rng.random(self._shape, dtype=np.float32) < 0.004)
        measured[far] = rng.uniform(0.2, 6.5, int(far.sum())).astype(np.float32)

# SPDX-License-Identifier: Apache-2.0
"""Depth from slopes: the surface whose slopes fit best (Poisson's equation, by cosine transforms)."""

import cv2
import numpy as np

from seed_estimation.gel.shading import Canvas
from seed_estimation.images.tactile_images import Image

LEVEL = 12.0  # [%] of the pixels that lie lowest are taken for free gel


class Integrator:
    """For one canvas; its edges are free, so that a tool may reach beyond the view."""

    def __init__(self, canvas: Canvas) -> None:
        h, w = canvas.shape
        self._pitch = [np.asarray(p, np.float32) for p in canvas.pitch]
        row = 2.0 * np.cos(np.pi * np.arange(h) / h) - 2.0
        column = 2.0 * np.cos(np.pi * np.arange(w) / w) - 2.0
        total = row[:, None] + column[None]
        total[0, 0] = 1.0
        self._inverse = np.asarray(1.0 / total, np.float32)
        self._inverse[0, 0] = 0.0

    def imprint(self, gx: Image, gy: Image) -> Image:
        """u (h, w) [m] above the lowest of the view, from du/dx and du/dy (h, w)."""
        a, b = gx * self._pitch[0], gy * self._pitch[1]
        f = np.zeros_like(a)
        across, down = 0.5 * (a[:, 1:] + a[:, :-1]), 0.5 * (b[1:] + b[:-1])
        f[:, :-1] += across
        f[:, 1:] -= across
        f[:-1] += down
        f[1:] -= down
        u = cv2.idct(cv2.dct(f) * self._inverse)
        some = u[::4, ::4].ravel()
        return np.asarray(
            u - np.partition(some, int(some.size * LEVEL / 200.0))[int(some.size * LEVEL / 200.0)], np.float32
        )

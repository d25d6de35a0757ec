# SPDX-License-Identifier: Apache-2.0
"""A thin gel under a tool: how deep it is pressed in everywhere, and how far its material has moved along.

The gel is bonded to a stiff window. Pressed by u, its surface obeys

    u - l^2 laplace(u) + b >= 0,    u >= g,    one of both with equality

where g is how far the tool passes the free gel, l (`skirt`) how far an imprint reaches beside the tool, and b the rise
of what is displaced (an obstacle problem; a thin elastic layer spreads its load like that). What lies on the tool and
sticks moves with it; around it the sideways motion d falls by d - l_d^2 laplace(d) = 0. Both are solved by relaxation
on grids from coarse to fine.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array, inverse_pose
from seed_sim.gel.parameters import VIEW, GelParameters
from seed_sim.gel.shapes import Field

CELL = 1.25e-4  # [m]
SIZE = (200, 160)  # (w, h) cells: 25 x 20 mm, 3 mm more than is in view on every side
_LEVELS = (8, 4, 2, 1)
_SWEEPS = (16, 12, 10, 8)
_BULGE_WIDTH = 0.0025  # [m] over which a rise spreads
_TOUCH = 2e-6  # [m]

assert SIZE[0] * CELL > VIEW


class Pressed(NamedTuple):
    """A gel's surface on the grid.

    Attributes:
        u: (h, w) [m] how deep it is pressed in, along z of the optical frame towards the camera.
        slope: two (h, w), du/dx and du/dy.
        material: two (h, w) [m], x and y of where what is here lay on the free gel.
    """

    u: Field
    slope: tuple[Field, Field]
    material: tuple[Field, Field]


def grid() -> tuple[Field, Field]:
    """x and y (h, w) [m] of the cells, in the optical frame."""
    w, h = SIZE
    x = (np.arange(w, dtype=np.float32) - np.float32(0.5 * (w - 1))) * np.float32(CELL)
    y = (np.arange(h, dtype=np.float32) - np.float32(0.5 * (h - 1))) * np.float32(CELL)
    xx, yy = np.meshgrid(x, y)
    return xx, yy


class GelSurface:
    """One gel; stateless."""

    def __init__(self, p: GelParameters) -> None:
        self.p = p
        self.x, self.y = grid()
        still = np.zeros_like(self.x)
        self.free = Pressed(still, (still, still), (self.x, self.y))

    def press(self, tool: Field, X_move: Array) -> Pressed:
        """Under a tool.

        Args:
            tool: (h, w) z of the tool's surface [m], in the optical frame.
            X_move: (4, 4) motion of what sticks since it touched, in the optical frame.
        """
        p = self.p
        reach = np.asarray(np.float32(p.distance) - tool, np.float32)
        u = self._imprint(reach)
        slope = self._slopes(u)
        stuck = ((u - reach < _TOUCH) & (reach > _TOUCH)).astype(np.uint8)
        if p.creep > 0.0:
            away = cv2.distanceTransform(cv2.copyMakeBorder(stuck, 1, 1, 1, 1, cv2.BORDER_REPLICATE), cv2.DIST_L2, 3)
            stuck = (away[1:-1, 1:-1] * CELL > p.creep).astype(np.uint8)
        X_back = inverse_pose(X_move)
        z = np.float32(p.distance) - u
        R, t = X_back[:3, :3].astype(np.float32), X_back[:3, 3].astype(np.float32)
        lay = [R[i, 0] * self.x + R[i, 1] * self.y + R[i, 2] * z + t[i] for i in range(2)]
        moved = [self._dragged(here - there, stuck) for here, there in zip((self.x, self.y), lay, strict=True)]
        wide = cv2.GaussianBlur(u, (0, 0), 0.5 * p.thickness / CELL)
        flow = np.float32(p.spread * p.thickness)
        out = [s * flow for s in self._slopes(wide)]  # away from what is pressed deepest: against the slope of u
        return Pressed(u, slope, (self.x - moved[0] + out[0], self.y - moved[1] + out[1]))

    def _imprint(self, reach: Field) -> Field:
        """u (h, w) from how far the tool passes the free gel (h, w)."""
        reaches, bulge = self.p.skirt * self.p.thickness / CELL, np.float32(self.p.bulge)
        u: Field | None = None
        rise = np.float32(0.0)
        for n, sweeps in zip(_LEVELS, _SWEEPS, strict=True):
            g = reach if n == 1 else _coarse(reach, n)
            u = np.maximum(g, np.float32(0.0)) if u is None else _finer(u, g)
            k = 1.0 / (4.0 + (n / reaches) ** 2)
            if bulge > 0.0 and n >= _LEVELS[1]:
                for _ in range(sweeps):
                    u = np.maximum(g, _sweep(u, k))
                rise = bulge * cv2.GaussianBlur(np.maximum(u, 0.0), (0, 0), _BULGE_WIDTH / (CELL * n))
                lift = rise
            else:
                lift = cv2.resize(rise, (g.shape[1], g.shape[0])) if bulge > 0.0 else rise
            for _ in range(sweeps):
                u = np.maximum(g, _sweep(u, k) - np.float32(k * (n / reaches) ** 2) * lift)
        assert u is not None
        return np.asarray(u, np.float32)

    def _dragged(self, d: Field, stuck: NDArray[np.uint8]) -> Field:
        """Sideways motion (h, w) [m] of all the gel from that of what sticks, of which d is right."""
        reaches = self.p.drag * self.p.thickness / CELL
        if not stuck.any():
            return np.zeros_like(d)
        out: Field | None = None
        for n, sweeps in zip(_LEVELS, _SWEEPS, strict=True):
            held = stuck if n == 1 else np.ascontiguousarray(stuck[n // 2 :: n, n // 2 :: n])
            value = d if n == 1 else np.ascontiguousarray(d[n // 2 :: n, n // 2 :: n])
            on = held > 0
            out = np.where(on, value, np.float32(0.0)) if out is None else np.where(on, value, _finer(out, value))
            k = 1.0 / (4.0 + (n / reaches) ** 2)
            for _ in range(sweeps):
                out = np.where(on, value, _sweep(out, k))
        return np.asarray(out, np.float32)

    @staticmethod
    def _slopes(u: Field) -> tuple[Field, Field]:
        scale = 1.0 / (8.0 * CELL)
        return cv2.Sobel(u, -1, 1, 0, ksize=3, scale=scale), cv2.Sobel(u, -1, 0, 1, ksize=3, scale=scale)


def _coarse(field: Field, n: int) -> Field:
    return np.ascontiguousarray(field[n // 2 :: n, n // 2 :: n])


def _finer(field: Field, like: Field) -> Field:
    return np.asarray(cv2.resize(field, (like.shape[1], like.shape[0]), interpolation=cv2.INTER_LINEAR), np.float32)


def _sweep(u: Field, k: float) -> Field:
    """k times the sum of the four neighbours."""
    kernel = np.array(((0.0, k, 0.0), (k, 0.0, k), (0.0, k, 0.0)), np.float32)
    return np.asarray(cv2.filter2D(u, -1, kernel, borderType=cv2.BORDER_REPLICATE), np.float32)

# SPDX-License-Identifier: Apache-2.0
"""A pressurised sheet against a tool, as an obstacle problem on a grid over x and z of C.

The sheet's height is w, along y of C towards its own camera. At rest it is a paraboloid over the rim. Its displacement
u costs tension and, by what carries it from below, u^2 / (2 length^2): the least energy with w >= tool, found by
projected relaxation that starts from the frame before. Air that is pushed aside lifts the rest: the mean of u stays 0.

Material sticks where the tool touches and has touched since the grasp. Everywhere else its sideways displacement is
that of a sheet carried in the same way, so that what comes into contact later slides.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array, inverse_pose

Field = NDArray[np.float32]
STEP = 0.001  # [m] of the grid
FIRST, SWEEPS = 600, 40  # of relaxation, at the grasp and in a frame
NEIGHBOURS = np.array(((0, 1, 0), (1, 0, 1), (0, 1, 0)), np.float32) / 4.0
TOUCH = 2e-5  # [m]


class Held(NamedTuple):
    """What is held: round about z_T, or a box of half thickness `radius` along y_T and of a width along x_T [m]."""

    radius: float = 0.012
    length: float = 0.2
    width: float | None = None


class Sheet:
    """One bubble.

    Attributes:
        w, u: (h, w) height of the sheet, and of it what is displacement [m].
        shift: (2, h, w) sideways displacement of the material seen at a place, along x and z [m].
    """

    def __init__(
        self, held: Held, side: float, rim: tuple[float, float], height: float, squeeze: float, length: float
    ) -> None:
        """side: +1 of the left bubble, -1; rim: semi-axes along x and z [m]; squeeze: of the apex past the tool [m]."""
        self._held, self._side = held, side
        w, h = (2 * int(r / STEP) + 3 for r in rim)
        self.origin = -STEP * 0.5 * np.array((w - 1, h - 1))  # of the grid's first node
        self.x, self.z = np.meshgrid(*(o + STEP * np.arange(n) for o, n in zip(self.origin, (w, h), strict=True)))
        bowl = 1.0 - (self.x / rim[0]) ** 2 - (self.z / rim[1]) ** 2
        self._inside = (bowl > 0.0).astype(np.float32)
        self.rest = (held.radius - squeeze + height * (1.0 - np.maximum(bowl, 0.0))).astype(np.float32)
        self._share = np.float32(1.0 / (1.0 + STEP**2 / (4.0 * length**2)))
        self.w, self.u = self.rest, np.zeros_like(self.rest)
        self.shift = np.zeros((2, h, w), np.float32)
        self._lift = 0.0
        self._grasped: NDArray[np.bool_] | None = None  # where the tool touched at the grasp

    def press(self, X_CT: Array) -> None:
        """The tool is at X_CT (4, 4); the first pose is that of the grasp."""
        floor = self._tool_height(X_CT)
        gap = (floor - self.rest).astype(np.float32)
        first = self._grasped is None
        for _ in range(FIRST if first else SWEEPS):
            u = (cv2.filter2D(self.u, -1, NEIGHBOURS) - np.float32(self._lift)) * self._share
            self.u = np.maximum(u, gap) * self._inside
            self._lift += 0.02 * float(self.u.sum() / self._inside.sum())
        self.w = self.rest + self.u
        touching = (self.u - gap < TOUCH) & (self._inside > 0) & (gap > -1.0)
        if self._grasped is None:
            self._grasped = touching
        self._carry(X_CT, touching, FIRST if first else SWEEPS)

    def _carry(self, X_CT: Array, touching: NDArray[np.bool_], sweeps: int) -> None:
        """Sideways displacement of the material: where it sticks, that of the tool's surface."""
        assert self._grasped is not None
        points = np.stack((self.x, self._side * self.w, self.z)).reshape(3, -1)
        X_TC = inverse_pose(X_CT)
        before = (X_TC[:3, :3] @ points + X_TC[:3, 3:]).reshape(3, *self.x.shape)  # T = C at the grasp
        stuck = np.stack((self.x - before[0], self.z - before[2])).astype(np.float32)
        columns = (before[0] - self.origin[0]) / STEP, (before[2] - self.origin[1]) / STEP
        known = cv2.remap(self._grasped.astype(np.float32), *(c.astype(np.float32) for c in columns), cv2.INTER_LINEAR)
        sticks = touching & (known > 0.5)
        for axis in range(2):
            d = self.shift[axis]
            for _ in range(sweeps):
                d = cv2.filter2D(d, -1, NEIGHBOURS) * self._share * self._inside
                d[sticks] = stuck[axis][sticks]
            self.shift[axis] = d

    def _tool_height(self, X_CT: Array) -> Array:
        """(h, w) of the tool's surface towards the camera; far below where there is none."""
        X_TC = inverse_pose(X_CT)
        o = np.einsum("ij,jhw->ihw", X_TC[:3, :3], np.stack((self.x, np.zeros_like(self.x), self.z)))
        o += X_TC[:3, 3][:, None, None]
        d = self._side * X_TC[:3, 1]  # along w
        r, half = self._held.radius, 0.5 * self._held.length
        if self._held.width is None:
            a, b = d[0] ** 2 + d[1] ** 2, o[0] * d[0] + o[1] * d[1]
            root = b * b - a * (o[0] ** 2 + o[1] ** 2 - r * r)
            top = (-b + np.sqrt(np.maximum(root, 0.0))) / a
            return np.where((root > 0.0) & (np.abs(o[2] + top * d[2]) < half), top, -10.0)
        sizes = (0.5 * self._held.width, r, half)
        safe = np.where(np.abs(d) < 1e-9, 1e-9, d)
        ends = [((-s - o[i]) / safe[i], (s - o[i]) / safe[i]) for i, s in enumerate(sizes)]
        enter = np.max([np.minimum(*e) for e in ends], axis=0)
        leave = np.min([np.maximum(*e) for e in ends], axis=0)
        return np.where(enter < leave, leave, -10.0)

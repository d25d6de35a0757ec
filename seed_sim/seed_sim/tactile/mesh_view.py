# SPDX-License-Identifier: Apache-2.0
"""What a camera sees of a membrane that is given by its nodes: depth and material at every pixel.

Triangles of some millimetres would show as facets. So a smooth surface goes through the nodes: a cubic spline over the
flat sheet, sampled on a grid. Drawing the triangles tells which one a ray meets first; Newton's method goes on from
there to where the ray meets the smooth surface.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from seed_core.spatial import Array
from seed_sim.tactile.geometry import Image, Rays
from seed_sim.tactile.membrane import DeformedMembrane

CELL = 0.0015  # [m] of the grid on the flat sheet
_STEPS = 2  # of Newton's method
_LONGEST = 1.5  # [cells] of a step; a ray that wants more only grazes the surface
_SHIFT = 4  # bits behind the point in corners of triangles


class MeshView:
    """One camera and one bubble, whose nodes move while its triangles stay.

    Attributes:
        rest: what the free bubble looks like.
    """

    def __init__(self, rays: Rays, X_CX: Array, nodes: Array, triangles: NDArray[np.integer], material: Array) -> None:
        """rays: on the coarse grid. X_CX (4, 4): the optical frame in C. nodes (n, 3) of the free bubble in C,
        triangles (m, 3), material (n, 2) x and z of the nodes on the flat sheet [m]."""
        self._rays, self._triangles = rays, np.ascontiguousarray(triangles, np.int32)
        self._R, self._p = X_CX[:3, :3], X_CX[:3, 3]
        self._clamped = _boundary(self._triangles, len(nodes))
        self._rim = float(nodes[self._clamped, 1].mean())
        reach = np.abs(material).max(axis=0)
        self._half = np.ceil(reach / CELL).astype(int) + 1  # cells from the middle along x and z
        x, z = (np.arange(-k, k + 1) * CELL for k in self._half)
        self._grid = (len(z), len(x))
        places = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2)
        weights = RBFInterpolator(material, np.eye(len(nodes)), kernel="cubic", degree=1)(places)
        self._free = nodes
        self._smooth_free = weights @ self._in_camera(nodes)
        self._weights = weights.astype(np.float32)
        self._corners = np.dstack([material[self._triangles], np.ones(self._triangles.shape)]).transpose(0, 2, 1)
        self._prepare_pixels()
        depth, seen = self._seen(nodes)
        self.rest = DeformedMembrane(depth, np.zeros_like(depth), seen)

    def _prepare_pixels(self) -> None:
        """Where each pixel of the coarse grid lies in the drawing of the triangles, which knows no distortion."""
        h, w = self._rays.directions.shape[1:]
        d = np.tensordot(self._R.T, self._rays.directions.astype(float), 1)
        self._ahead = np.stack([d[0].ravel(), d[1].ravel(), np.ones(h * w)], axis=1).astype(np.float32)
        low, high = np.array((d[0].min(), d[1].min())), np.array((d[0].max(), d[1].max()))
        self._low, self._scale = low, np.array((w, h)) / (high - low)
        self._drawn = (h + 1, w + 1)
        column, row = (np.rint((v - a) * s).astype(int) for v, a, s in zip(d[:2], low, self._scale, strict=True))
        self._pixel = (row * self._drawn[1] + column).ravel()
        rim_depth = (self._rim - self._p[1]) / self._rays.directions[1]
        points = self._rays.at(rim_depth.astype(np.float32))
        self._beside = rim_depth.astype(np.float32), points[::2]

    def shape(self, nodes: Array) -> DeformedMembrane:
        """The membrane with its nodes (n, 3) in C; the camera moves along y with the rim."""
        depth, material = self._seen(nodes)
        return DeformedMembrane(depth, np.maximum(self.rest.depth - depth, np.float32(0.0)), material)

    def _in_camera(self, nodes: Array) -> Array:
        """Nodes (n, 3) in the optical frame, the rim where it was when free."""
        shift = np.array((0.0, self._rim - float(nodes[self._clamped, 1].mean()), 0.0))
        return np.asarray((nodes + (shift - self._p)) @ self._R)

    def _seen(self, nodes: Array) -> tuple[Image, NDArray[np.float32]]:
        """Depth (h, w) and material (2, h, w) [m]."""
        corners = self._in_camera(nodes)
        hit, triangle = self._first_hit(corners)
        seen = np.einsum("nij,nj->ni", self._planes(corners)[triangle], self._ahead[hit])
        inverse = 1.0 / seen[:, 2]
        on = (seen[:, :2] * inverse[:, None]).T
        found = self._smoothed(self._fields(nodes), hit, inverse, on)
        depth, material = self._beside[0].copy(), self._beside[1].copy()
        depth.ravel()[hit], material.reshape(2, -1)[:, hit] = found
        return depth, material

    def _first_hit(self, corners: Array) -> tuple[NDArray[np.intp], NDArray[np.int32]]:
        """Pixels whose ray meets the membrane, and the triangle that it meets first: painted from far to near."""
        flat = (corners[:, :2] / corners[:, 2:] - self._low) * self._scale
        polygons = np.rint(flat * (1 << _SHIFT)).astype(np.int32)[self._triangles]
        drawn = np.full(self._drawn, -1, np.int32)
        far = corners[:, 2][self._triangles].sum(axis=1)
        for i in np.argsort(-far).tolist():
            cv2.fillConvexPoly(drawn, polygons[i], i, cv2.LINE_8, _SHIFT)
        triangle = drawn.ravel()[self._pixel]
        hit = np.flatnonzero(triangle >= 0)
        return hit, triangle[hit]

    def _planes(self, corners: Array) -> Array:
        """(m, 3, 3) that take a ray of unit depth to material x, z and 1, all over the depth of the triangle."""
        a, b, c = (corners[self._triangles[:, i]] for i in range(3))
        inverse = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1)
        inverse /= np.einsum("mi,mi->m", a, inverse[:, 0])[:, None, None]
        return np.asarray(self._corners @ inverse, np.float32)

    def _fields(self, nodes: Array) -> NDArray[np.float32]:
        """Of each cell (k, 6, 3): place (x, y at unit depth, and depth), its slopes along x and z, its curvatures."""
        moved = (self._in_camera(nodes) - self._in_camera(self._free)).astype(np.float32)
        place = (self._smooth_free + self._weights @ moved).reshape(*self._grid, 3)
        place[..., :2] /= place[..., 2:]
        f = np.zeros((*self._grid, 6, 3), np.float32)
        f[..., 0, :] = place
        half, inner = np.float32(0.5), f[1:-1, 1:-1]
        right, left, up, down, here = (
            place[1:-1, 2:],
            place[1:-1, :-2],
            place[2:, 1:-1],
            place[:-2, 1:-1],
            place[1:-1, 1:-1],
        )
        inner[..., 1, :], inner[..., 2, :] = half * (right - left), half * (up - down)
        inner[..., 3, :], inner[..., 4, :] = right - 2.0 * here + left, up - 2.0 * here + down
        corners = place[2:, 2:] - place[2:, :-2] - place[:-2, 2:] + place[:-2, :-2]
        inner[..., 5, :] = half * half * corners
        return f.reshape(-1, 6, 3)

    def _smoothed(
        self, fields: NDArray[np.float32], hit: NDArray[np.intp], depth: Image, material: NDArray[np.float32]
    ) -> tuple[Image, NDArray[np.float32]]:
        """Depth (k,) and material (2, k) where rays `hit` meet the smooth surface, from those on the triangles."""
        x, y, middle = self._ahead[hit, 0], self._ahead[hit, 1], self._half.astype(np.float32)[:, None]
        cell, most = material * np.float32(1.0 / CELL) + middle, (2 * self._half - 1)[:, None]
        on = np.ones(len(hit), bool)
        for _ in range(_STEPS):
            nearest = np.clip(np.rint(cell), 1, most)
            off = cell - nearest
            of_cells = fields[(nearest[1] * self._grid[1] + nearest[0]).astype(np.intp)]
            p, px, pz, pxx, pzz, pxz = np.ascontiguousarray(of_cells.reshape(-1, 18).T).reshape(6, 3, -1)
            dx, dz = px + pxx * off[0] + pxz * off[1], pz + pxz * off[0] + pzz * off[1]
            at = p + np.float32(0.5) * ((px + dx) * off[0] + (pz + dz) * off[1])
            u, v, det = x - at[0], y - at[1], dx[0] * dz[1] - dx[1] * dz[0]
            det[np.abs(det) < 1e-9] = np.float32(1e-9)
            step = np.stack([(u * dz[1] - v * dz[0]) / det, (v * dx[0] - u * dx[1]) / det])
            on &= np.abs(step).max(axis=0) < _LONGEST
            cell = np.where(on, cell + step, cell)
        found = np.where(on, at[2] + step[0] * dx[2] + step[1] * dz[2], depth)
        return found, np.where(on, (cell - middle) * np.float32(CELL), material)


def _cross(a: Array, b: Array) -> Array:
    x, y, z = (a[:, i] for i in range(3))
    u, v, w = (b[:, i] for i in range(3))
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)


def _boundary(triangles: NDArray[np.int32], count: int) -> NDArray[np.bool_]:
    """(n,) nodes on edges that belong to one triangle only."""
    edges = np.sort(triangles[:, ((0, 1), (1, 2), (2, 0))].reshape(-1, 2), axis=1)
    unique, times = np.unique(edges, axis=0, return_counts=True)
    out = np.zeros(count, bool)
    out[unique[times == 1].ravel()] = True
    return out

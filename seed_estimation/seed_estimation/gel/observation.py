# SPDX-License-Identifier: Apache-2.0
"""What one gel saw, and how it compares with a pose of the tool."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array, inverse_pose
from seed_estimation.contact.patch import ContactPatch
from seed_estimation.gel.settings import GelSettings
from seed_estimation.gel.shading import Canvas
from seed_estimation.images.tactile_images import Array32, Image, Mask
from seed_estimation.sensors.contract import Rows, direction_rows, point_rows

FLAT = 1.2  # [px of the canvas] blur of slopes before their change from place to place is taken
DEPTHS = 6.0  # depths of a patch that count as independent: they are integrated from the same slopes


class Seen(NamedTuple):
    """One image.

    Attributes:
        gx, gy, u: (h, w) slopes and imprint [m].
        mask: (h, w) contact. hidden: (h, w) where dots hide the coat.
        dots: (N, 2) [px].
    """

    gx: Image
    gy: Image
    u: Image
    mask: Mask
    hidden: Mask
    dots: Array
    patch: ContactPatch


class GelGrasp:
    """What a gel saw of the tool at the moment of grasp; points in C [m].

    Attributes:
        points, normals: (M, 3) samples of the tool's surface; bend: (M, 2, 2) change of slope with the place [1/m].
        dots: (N, 3) on the surface. core_dots: (N,) those that lie well on the tool; edge_dots: on its edge.
    """

    def __init__(self, seen: Seen, canvas: Canvas, X_XC: Array, p: GelSettings) -> None:
        self._canvas, self._p = canvas, p
        self.X_XC, X_CX = X_XC, inverse_pose(X_XC)
        pitch = float(np.median(canvas.pitch[0]))
        side = 2 * round(p.margin / pitch) + 1
        ellipse = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
        core = cv2.erode(seen.mask, ellipse, borderType=cv2.BORDER_REPLICATE)
        v, u = np.nonzero((core > 0) & (seen.hidden == 0))
        some = np.unique(np.linspace(0, max(v.size - 1, 0), min(p.samples, v.size)).astype(int))
        v, u = v[some], u[some]
        z = p.distance - seen.u[v, u]
        rays = canvas.place[:, v, u] / np.float32(p.distance)
        self.points = _into(X_CX, np.stack((rays[0] * z, rays[1] * z, z), 1))
        gx, gy = seen.gx[v, u].astype(float), seen.gy[v, u].astype(float)
        n = np.stack((gx, gy, np.ones_like(gx)), 1)
        self.normals = (n / np.linalg.norm(n, axis=1)[:, None]) @ X_CX[:3, :3].T
        smooth = [cv2.GaussianBlur(g, (0, 0), FLAT) for g in (seen.gx, seen.gy)]
        scale = 1.0 / (8.0 * pitch)
        self.bend = np.stack(
            [[cv2.Sobel(g, -1, 1 - i, i, ksize=3, scale=scale)[v, u] for i in (0, 1)] for g in smooth]
        ).transpose(2, 0, 1).astype(float)  # fmt: skip
        self.area = float((canvas.pitch[0] * canvas.pitch[1])[core > 0].sum())
        self.depth_tells = _edges(seen)
        at = canvas.camera.pixel_rays(seen.dots)[:, :2]
        depth = p.distance - _sampled(seen.u, canvas, at)
        self.dots = _into(X_CX, np.concatenate([at * depth[:, None], depth[:, None]], 1))
        self.core_dots = _sampled(core.astype(np.float32), canvas, at) > 0.5
        self.edge_dots = (_sampled(seen.mask.astype(np.float32), canvas, at) > 0.5) & ~self.core_dots

    def expected_dots(self, X_CT: Array) -> Array:
        """(N, 2) [px] where the dots on the tool are seen with it at X_CT; others where they were at the grasp."""
        on_tool = (self.core_dots | self.edge_dots)[:, None]
        where = np.where(on_tool, _into(X_CT, self.dots), self.dots)
        return self._canvas.camera.project(_into(self.X_XC, where))


class GelObservation:
    """An `Observation` of a gel."""

    def __init__(
        self, seen: Seen, grasp: GelGrasp | None, dots: NDArray[np.intp], p: GelSettings, canvas: Canvas
    ) -> None:
        """dots: for each dot of the grasp, its index among those seen, or -1."""
        self._seen, self._grasp, self._p, self._canvas = seen, grasp, p, canvas
        if grasp is not None:
            known = dots >= 0
            self._found = known
            self._core = np.nonzero(known & grasp.core_dots)[0]
            self._rays = np.zeros((len(dots), 2))
            self._rays[known] = canvas.camera.pixel_rays(seen.dots[dots[known]])[:, :2]

    @property
    def patch(self) -> ContactPatch:
        return self._seen.patch

    def rows(self, X_CT: Array) -> Sequence[Rows]:
        """Dots, slopes and depth."""
        g = self._grasp
        assert g is not None
        return self._dot_rows(g, X_CT), *self._surface_rows(g, X_CT)

    def _dot_rows(self, g: GelGrasp, X_CT: Array) -> Rows:
        """Two rows for each dot that lies well on the tool: across its ray."""
        p = _into(X_CT, g.dots[self._core])
        q = _into(g.X_XC, p)
        scale = self._p.distance / self._p.dot_std
        xy = q[:, :2] / q[:, 2:]
        r = (xy - self._rays[self._core]) * scale
        J = np.zeros((2, len(p), 3))
        J[0, :, 0] = J[1, :, 1] = scale / q[:, 2]
        J[0, :, 2], J[1, :, 2] = -xy[:, 0] * scale / q[:, 2], -xy[:, 1] * scale / q[:, 2]
        rows = [point_rows(j @ g.X_XC[:3, :3], p) for j in J]
        return Rows(r.T.ravel(), np.concatenate(rows), 2.0 * len(p))

    def _surface_rows(self, g: GelGrasp, X_CT: Array) -> tuple[Rows, Rows]:
        """Slope and depth at the samples that are in view, where no dot hides them."""
        p, n = _into(X_CT, g.points), g.normals @ X_CT[:3, :3].T
        q, m = _into(g.X_XC, p), n @ g.X_XC[:3, :3].T
        u, v = self._canvas.pixels(*(q[:, :2] / q[:, 2:]).T.astype(np.float32))
        h, w = self._canvas.shape
        column, row = np.rint(np.nan_to_num(u, nan=-1.0)).astype(int), np.rint(np.nan_to_num(v, nan=-1.0)).astype(int)
        good = (column >= 1) & (column < w - 1) & (row >= 1) & (row < h - 1) & (m[:, 2] > 0.3)
        good[good] &= self._seen.hidden[row[good], column[good]] == 0
        p, n, q, m, bend = p[good], n[good], q[good], m[good], g.bend[good]
        u, v = u[good], v[good]
        independent = float(np.mean(good)) if good.size else 0.0
        R = g.X_XC[:3, :3]
        r, J = [], []
        for i, seen in enumerate((self._seen.gx, self._seen.gy)):
            r.append((m[:, i] / m[:, 2] - _at(seen, u, v)) / self._p.slope_std)
            by_n, by_p = np.zeros((len(p), 3)), np.zeros((len(p), 3))
            by_n[:, i] = 1.0 / m[:, 2]
            by_n[:, 2] = -m[:, i] / m[:, 2] ** 2
            by_p[:, :2] = -bend[:, i]
            J.append((direction_rows(by_n @ R, n) + point_rows(by_p @ R, p)) / self._p.slope_std)
        patches = 2.0 * (g.area / self._p.slope_area if g.area > self._p.slope_area else 1.0)
        slopes = Rows(np.concatenate(r), np.concatenate(J), independent * patches)
        # depth along the ray's place: a surface that falls sideways looks deeper when it is moved sideways
        across = np.concatenate([m[:, :2] / m[:, 2:], np.ones((len(p), 1))], 1)
        depth = (q[:, 2] - self._p.distance + _at(self._seen.u, u, v)) / self._p.depth_std
        tells = DEPTHS * independent if g.depth_tells and _edges(self._seen) else 0.0
        return slopes, Rows(depth, point_rows(across @ R, p) / self._p.depth_std, tells)

    def explained(self, X_CT: Array) -> float:
        """Share of the dots on the tool that move with it."""
        g = self._grasp
        assert g is not None
        total = int(np.count_nonzero(g.core_dots))
        q = _into(g.X_XC, _into(X_CT, g.dots[self._core]))
        off = np.linalg.norm(q[:, :2] / q[:, 2:] - self._rays[self._core], axis=1) * self._p.distance
        return float(np.count_nonzero(off < self._p.off)) / max(total, 1)

    def slip(self, X_CT: Array) -> float:
        """Share of the tool's motion that dots on the patch's edge do not follow; 0 where it has hardly moved."""
        g = self._grasp
        assert g is not None
        edge = np.nonzero(self._found & g.edge_dots)[0]
        start = _into(g.X_XC, g.dots[edge])
        carried = _into(g.X_XC, _into(X_CT, g.dots[edge]))
        way = (carried[:, :2] / carried[:, 2:] - start[:, :2] / start[:, 2:]) * self._p.distance
        gone = (self._rays[edge] - start[:, :2] / start[:, 2:]) * self._p.distance
        most, told = float((way * way).sum()), float((way * gone).sum())
        if most < len(edge) * (10.0 * self._p.dot_std) ** 2 or len(edge) == 0:
            return 0.0
        return min(max(1.0 - told / most, 0.0), 1.0)


def _into(X: Array, points: Array) -> Array:
    """Points (N, 3) moved by X (4, 4)."""
    return np.asarray(points @ X[:3, :3].T + X[:3, 3])


def _edges(seen: Seen) -> bool:
    """Whether free gel is in view beside the contact, from which depth counts."""
    low = seen.u < 0.25 * float(seen.u.max())
    return bool(np.count_nonzero(low) > 0.05 * low.size)


def _at(field: Image, u: Array32, v: Array32) -> Array:
    """A field of the canvas at places (N,) [px]."""
    if u.size == 0:
        return np.zeros(0)
    values = cv2.remap(field, u[None], v[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values[0], float)


def _sampled(field: Image, canvas: Canvas, rays: Array) -> Array:
    """A field of the canvas in directions (N, 2) of the optical frame."""
    return _at(field, *canvas.pixels(*rays.T.astype(np.float32)))

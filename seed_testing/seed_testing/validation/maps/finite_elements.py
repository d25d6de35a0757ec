# SPDX-License-Identifier: Apache-2.0
"""The wrench by finite elements, inverted on where the printed dots are seen: a rival of the membrane map.

The bubble at rest is the reference: inflated, and touching nothing. Its stress there is the one that balances the gas,
of those that do the nearest to an even tension. Triangles of constant strain between some dots tell how the sheet is
stretched from there on, and its second Piola-Kirchhoff stress but for one number (St. Venant-Kirchhoff, rubber's nu):

    S = S_rest + E t / (1 - nu^2) ((1 - nu) E_ + nu tr(E_) I)          E_ = (F^T F - I) / 2

What these forces and the gas leave at a dot is what the tool puts on it. Their sum over the patch is the load; so is
that over whatever lies within a cut around the patch, since the free sheet is in equilibrium. The load is linear in
E t, which is fitted to the loads of an identification.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CloughTocher2DInterpolator
from scipy.spatial import ConvexHull, Delaunay, cKDTree

from seed_core.spatial import Array
from seed_sim.membrane import GraspState, MembraneGrasp

POISSON = 0.5
SPACING, TURNED = 0.0055, 0.3  # [m], [rad] of the dots, which are none of the simulation's nodes
NOISE = 5e-5, 1e-4  # [m] of a dot's place across and along the camera's axis, in one image
NOISE_PRESSURE = 5.4  # [Pa]
SUMS = ("in the patch", "over all cuts")
_KINDS = np.array((((1.0, 0.0), (0.0, 0.0)), ((0.0, 0.0), (0.0, 1.0)), ((0.0, 1.0), (1.0, 0.0))))  # of stress


class Sheet:
    """The dots of one bubble, their triangles, and how forces follow from where they are."""

    def __init__(self, material: Array, rest: Array, pressure: float) -> None:
        """From the bubble at rest.

        Args:
            material: (n, 2) [m] known points of the flat sheet as it was printed, its rim among them.
            rest: (n, 3) [m] where they are while nothing is touched. pressure: [Pa] above the ambient one then.
        """
        rim = material[ConvexHull(material).vertices]
        self.flat = _dots(rim)
        self._from_known = CloughTocher2DInterpolator(material, np.eye(len(material)))(self.flat)
        self.flat = self.flat[seen := np.isfinite(self._from_known).all(axis=1)]
        self._from_known = self._from_known[seen]
        self._to_rim = _distance_to_polygon(self.flat, rim)
        triangles = Delaunay(self.flat).simplices
        twice = np.abs(np.linalg.det(self.flat[triangles[:, 1:]] - self.flat[triangles[:, :1]]))
        self._triangles = triangles[twice > 0.1 * SPACING**2]  # none along the rim
        corners = (self._from_known @ rest)[self._triangles]
        one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normal = np.cross(one, other)
        self._area = 0.5 * np.linalg.norm(normal, axis=1)
        e1 = one / np.linalg.norm(one, axis=1, keepdims=True)
        e2 = np.cross(normal, e1) / (2.0 * self._area[:, None])
        own = np.stack((e1, e2), axis=2)  # (m, 3, 2) of the triangle's plane at rest
        inverse = np.linalg.inv(np.stack((one, other), axis=1) @ own)
        self._gradient = np.concatenate((-inverse.sum(axis=2, keepdims=True), inverse), axis=2)  # (m, 2, 3)
        # the gas pushes away from the rim's plane
        bulge = np.sign(rest[:, 1].mean() - rest[self._from_known[self._to_rim < SPACING].argmax(axis=1), 1].mean())
        self._outward = np.sign(normal[:, 1].sum()) * bulge
        self._rest = self._stress_at_rest(corners, pressure)

    def _stress_at_rest(self, corners: Array, pressure: float) -> Array:
        """(m, 2, 2) [N/m] that balances the gas wherever the sheet is free, next to an even tension."""
        F, free = self._deformation(corners), self._to_rim > 0.2 * SPACING
        m, n = len(corners), len(self.flat)
        by_dot = np.zeros((m, 3, n, 3))
        for k, S in enumerate(_KINDS):
            at_corners = self._at_corners(F, np.broadcast_to(S, (m, 2, 2)))
            for c in range(3):
                by_dot[np.arange(m), k, self._triangles[:, c]] += at_corners[:, c]
        A = by_dot[:, :, free].reshape(m, 3, -1)
        gas = -pressure * self._push(corners)[free].ravel()
        even = A[:, 0] + A[:, 1]
        tension = float(even.sum(axis=0) @ gas / (even.sum(axis=0) @ even.sum(axis=0)))
        more = np.linalg.lstsq(A.reshape(3 * m, -1).T, gas - tension * even.sum(axis=0), rcond=None)[0].reshape(m, 3)
        return np.asarray(tension * np.eye(2) + np.einsum("mk,kab->mab", more, _KINDS))

    def seen(self, nodes: Array, noise: float, rng: np.random.Generator) -> Array:
        """(N, 3) [m] of the dots, where the known points are at nodes (n, 3); noise times the usual errors."""
        deviation = noise * np.array((NOISE[0], NOISE[1], NOISE[0]))
        return np.asarray(self._from_known @ nodes + deviation * rng.normal(size=(len(self.flat), 3)))

    def _deformation(self, corners: Array) -> Array:
        return np.asarray(np.einsum("mck,mac->mka", corners, self._gradient))  # (m, 3, 2)

    def _at_corners(self, F: Array, S: Array) -> Array:
        """(m, 3, 3) [N] of a stress (m, 2, 2) [N/m] on the corners of the triangles."""
        return np.asarray(-self._area[:, None, None] * np.einsum("mka,mab,mbc->mck", F, S, self._gradient))

    def _push(self, corners: Array) -> Array:
        """(N, 3) [m^2] by which the gas pushes each dot, out of the finger."""
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 6.0
        return self._gathered((area * self._outward)[:, None].repeat(3, axis=1))

    def _gathered(self, at_corners: Array) -> Array:
        out = np.zeros((len(self.flat), 3))
        np.add.at(out, self._triangles, at_corners)
        return out

    def loads(self, x: Array, touching: Array, pressure: float) -> Array:
        """(2, 2, 6) load on the tool about C's origin, in C, by sum (SUMS), known and by E t [m].

        Args:
            x: (N, 3) [m] of the dots.
            touching: (k, 2) [m] known points of the flat sheet that are seen to touch the tool.
            pressure: [Pa] above the ambient one.
        """
        corners = x[self._triangles]
        F = self._deformation(corners)
        strain = 0.5 * (np.einsum("mka,mkb->mab", F, F) - np.eye(2))
        trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
        elastic = ((1.0 - POISSON) * strain + POISSON * trace * np.eye(2)) / (1.0 - POISSON**2)
        known = self._gathered(self._at_corners(F, self._rest)) + pressure * self._push(corners)
        force = np.stack((known, self._gathered(self._at_corners(F, elastic))))
        load = np.concatenate((np.cross(x, force), force), axis=2)  # (2, N, 6)
        away = np.maximum(cKDTree(touching).query(self.flat)[0] - SPACING, 0.0)
        weights = np.stack((away == 0.0, self._to_rim / np.maximum(self._to_rim + away, 1e-9)))
        return np.asarray(np.einsum("sn,pnw->spw", weights, load))


class Watcher:
    """Looks at the sheets of both bubbles, with noise times the usual errors."""

    def __init__(self, at_rest: MembraneGrasp, noise: float, rng: np.random.Generator) -> None:
        """at_rest: it touches nothing yet."""
        flat = at_rest.mesh.flat
        self._sheets = {f: Sheet(flat, b.x, b.pressure) for f, b in at_rest.bubbles.items()}
        self._noise, self._rng = noise, rng

    def seen(self, state: GraspState, images: float = 1.0) -> Array:
        """(2, 2, 6) loads of both, by sum, known and by E t; with errors of the mean over so many images."""
        out, noise = np.zeros((2, 2, 6)), self._noise / images**0.5
        for f, sheet in self._sheets.items():
            b = state.bubbles[f]
            pressure = b.pressure + noise * NOISE_PRESSURE * float(self._rng.normal())
            out += sheet.loads(sheet.seen(b.nodes, noise, self._rng), b.material[b.touching], pressure)
        return out


@dataclass(frozen=True)
class FiniteElements:
    """E t [N/m] of the sheets (2,), by sum."""

    stiffness: Array

    @classmethod
    def fitted(cls, changes: Array, wrench: Array) -> "FiniteElements":
        """From changes (n, 2, 2, 6) of what is seen since the grasp, and of the load on the tool (n, 6)."""
        weight = 1.0 / np.sqrt(np.mean(wrench**2, axis=0))
        left, by_stiffness = (wrench[:, None] - changes[:, :, 0]) * weight, changes[:, :, 1] * weight
        return cls((left * by_stiffness).sum(axis=(0, 2)) / (by_stiffness**2).sum(axis=(0, 2)))

    def wrench(self, changes: Array) -> Array:
        """(2, n, 6) load on the tool by sum, from changes (n, 2, 2, 6)."""
        return np.asarray((changes[:, :, 0] + self.stiffness[:, None] * changes[:, :, 1]).transpose(1, 0, 2))


def _dots(rim: Array) -> Array:
    """(N, 2) [m] a hexagonal pattern within the rim (r, 2), and dots along it."""
    low, high = rim.min(axis=0), rim.max(axis=0)
    middle, reach = 0.5 * (low + high), float(np.linalg.norm(high - low))
    i, j = np.mgrid[-60:61, -60:61]
    grid = SPACING * np.column_stack(((i + 0.5 * j).ravel(), (0.75**0.5 * j).ravel()))
    c, s = np.cos(TURNED), np.sin(TURNED)
    grid = grid[np.linalg.norm(grid, axis=1) < reach] @ np.array(((c, s), (-s, c))) + middle
    inside = (Delaunay(rim).find_simplex(grid) >= 0) & (_distance_to_polygon(grid, rim) > 0.5 * SPACING)
    ends = np.roll(rim, -1, axis=0)
    along = [
        a + (b - a) * t[:, None]
        for a, b in zip(rim, ends, strict=True)
        for t in [np.arange(0.0, 1.0, 1.0 / max(round(float(np.linalg.norm(b - a)) / SPACING), 1))]
    ]
    on_rim = np.concatenate(along)
    return np.concatenate((grid[inside], middle + 0.999 * (on_rim - middle)))


def _distance_to_polygon(points: Array, polygon: Array) -> Array:
    """(n,) [m] of points (n, 2) from the nearest edge of a closed polygon (r, 2)."""
    a, edge = polygon, np.roll(polygon, -1, axis=0) - polygon
    from_a = points[:, None] - a
    share = np.clip(np.einsum("nrk,rk->nr", from_a, edge) / np.maximum((edge**2).sum(axis=1), 1e-18), 0.0, 1.0)
    return np.asarray(np.linalg.norm(from_a - share[..., None] * edge, axis=2).min(axis=1))

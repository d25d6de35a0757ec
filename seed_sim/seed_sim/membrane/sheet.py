# SPDX-License-Identifier: Apache-2.0
"""Forces and stiffness of a plane-stress sheet of constant-strain triangles that bears tension only.

St. Venant-Kirchhoff: S = Et / (1 - nu^2) ((1 - nu) E + nu tr(E) I) for Green's strain E. Where the smaller principal
stress would be compression, the sheet wrinkles: the energy is that of uniaxial tension (Pipkin's relaxed energy), and
nothing where both are. A small share of the full stiffness stays, so that slack triangles keep their place.
"""

from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array
from seed_sim.membrane.mesh import Index

_SLACK = 1e-3  # share of the full stiffness that wrinkled and slack triangles keep


class SheetLoad(NamedTuple):
    """energy [J], forces of the nodes (n, 3) [N] on what holds them, stiffness of each triangle (9, 9, m) [N/m]."""

    energy: float
    force: Array
    stiffness: Array | None


class Corners(NamedTuple):
    """Triangles by component, each (3, m): the first node, the edges to the others, the area vector."""

    point: Array
    one: Array
    other: Array
    normal: Array


class Sheet:
    """Elastic triangles with a stress-free shape.

    Attributes:
        area: (m,) [m^2] of the stress-free triangles. node_area: (n,) [m^2] a third of those around each node.
        crept: (3, m) strain that stress has relaxed from, as `strain`.
    """

    def __init__(self, reference: Array, triangles: Index, Et: float, poisson: float) -> None:
        """reference (n, 3) [m], triangles (m, 3), Et [N/m]."""
        self.triangles, self.count = triangles, len(reference)
        self._corner = np.ascontiguousarray(triangles.T)
        # places of (node of triangle, component, triangle) in a flat (n * 3,) vector
        self.places = np.ascontiguousarray((self._corner[:, None, :] * 3 + np.arange(3)[:, None]).ravel())
        c = self.corners(reference)
        length = np.sqrt((c.one**2).sum(0))
        over = (c.one * c.other).sum(0) / length
        self.area = np.sqrt((c.normal**2).sum(0))
        high = 2.0 * self.area / length
        # gradients of the three shape functions in the triangle's own axes, (3, 2, m)
        self._G = np.zeros((3, 2, len(triangles)))
        self._G[1, 0], self._G[1, 1] = 1.0 / length, -over / (length * high)
        self._G[2, 1] = 1.0 / high
        self._G[0] = -self._G[1] - self._G[2]
        self.node_area = np.bincount(triangles.ravel(), np.repeat(self.area / 3.0, 3), self.count)
        self._Et, self._nu = Et, poisson
        c11 = Et / (1.0 - poisson**2)
        self._D = c11 * np.array([[1.0, poisson, 0.0], [poisson, 1.0, 0.0], [0.0, 0.0, 0.5 * (1.0 - poisson)]])
        self.crept = np.zeros((3, len(triangles)))

    def corners(self, x: Array) -> Corners:
        """Triangles of nodes x (n, 3)."""
        point = x.T[:, self._corner]
        one, other = point[:, 1] - point[:, 0], point[:, 2] - point[:, 0]
        normal = np.empty_like(one)
        normal[0] = one[1] * other[2] - one[2] * other[1]
        normal[1] = one[2] * other[0] - one[0] * other[2]
        normal[2] = one[0] * other[1] - one[1] * other[0]
        return Corners(np.ascontiguousarray(point[:, 0]), one, other, 0.5 * normal)

    def _deformation(self, c: Corners) -> tuple[Array, Array]:
        """Columns (3, m) of the deformation gradients."""
        return c.one * self._G[1, 0], c.one * self._G[1, 1] + c.other * self._G[2, 1]

    def strain(self, x: Array) -> Array:
        """Green's strain (3, m) as (E11, E22, 2 E12) of nodes x (n, 3)."""
        return _green(*self._deformation(self.corners(x)))

    def load(self, x: Array, stiffness: bool = True, corners: Corners | None = None) -> SheetLoad:
        """Energy, forces and stiffness at nodes x (n, 3) [m]."""
        f1, f2 = self._deformation(self.corners(x) if corners is None else corners)
        density, S, D = self._stress(_green(f1, f2) - self.crept, stiffness)
        G, m = self._G, S.shape[1]
        S *= self.area
        # virtual strains (3 strains, 3 nodes, 3 components, m)
        V = np.empty((3, 3, 3, m))
        g1, g2 = G[:, 0, None], G[:, 1, None]
        np.multiply(f1, g1, out=V[0])
        np.multiply(f2, g2, out=V[1])
        np.multiply(f1, g2, out=V[2])
        V[2] += f2 * g1
        B = V.reshape(3, 9, m)
        nodal = S[0] * B[0] + S[1] * B[1] + S[2] * B[2]
        force = np.asarray(np.bincount(self.places, nodal.ravel(), 3 * self.count).reshape(-1, 3), float)
        energy = float(density @ self.area)
        if D is None:
            return SheetLoad(energy, force, None)
        D *= self.area
        K = np.zeros((9, 9, m))
        product = np.empty((9, 9, m))
        for i in range(3):
            DB = D[i, 0] * B[0] + D[i, 1] * B[1] + D[i, 2] * B[2]
            np.multiply(B[i][:, None], DB[None], out=product)
            K += product
        blocks = K.reshape(3, 3, 3, 3, m)
        geometric = G[:, None, 0] * (S[0] * G[None, :, 0] + S[2] * G[None, :, 1])
        geometric += G[:, None, 1] * (S[2] * G[None, :, 0] + S[1] * G[None, :, 1])
        for i in range(3):
            blocks[:, i, :, i] += geometric
        return SheetLoad(energy, force, K)

    def _stress(self, E: Array, stiffness: bool) -> tuple[Array, Array, Array | None]:
        """Energy per area (m,), second Piola-Kirchhoff stress times thickness (3, m) and its slope (3, 3, m)."""
        S = self._D @ E
        density = 0.5 * (E * S).sum(0)
        D = np.repeat(self._D[:, :, None], E.shape[1], axis=2) if stiffness else None
        mean, half, shear = 0.5 * (E[0] + E[1]), 0.5 * (E[0] - E[1]), 0.5 * E[2]
        r = np.sqrt(half * half + shear * shear)
        loose = np.flatnonzero((1.0 + self._nu) * mean < (1.0 - self._nu) * r)  # smaller stress below zero
        if not len(loose):
            return density, S, D
        r = np.maximum(r[loose], 1e-12)
        e1 = np.maximum(mean[loose] + r, 0.0)
        c2, s2 = half[loose] / r, shear[loose] / r
        N = np.stack([0.5 * (1.0 + c2), 0.5 * (1.0 - c2), 0.5 * s2])
        keep, full = _SLACK, 1.0 - _SLACK
        S[:, loose] = keep * S[:, loose] + (full * self._Et * e1) * N
        density[loose] = keep * density[loose] + full * 0.5 * self._Et * e1**2
        if D is not None:
            M = np.stack([-0.5 * s2, 0.5 * s2, 0.5 * c2])
            taut = (e1 > 0.0).astype(float)
            D[:, :, loose] = keep * self._D[:, :, None] + (full * self._Et) * (
                taut * N[:, None] * N[None] + (e1 / r) * M[:, None] * M[None]
            )
        return density, S, D


def _green(a: Array, b: Array) -> Array:
    """Green's strain (3, m) as (E11, E22, 2 E12) of the deformation gradients' columns a, b (3, m)."""
    E = np.empty_like(a)
    E[0] = 0.5 * ((a * a).sum(0) - 1.0)
    E[1] = 0.5 * ((b * b).sum(0) - 1.0)
    E[2] = (a * b).sum(0)
    return E

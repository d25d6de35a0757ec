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
    """energy [J], internal forces (n, 3) [N], stiffness of each triangle (m, 9, 9) [N/m]."""

    energy: float
    force: Array
    stiffness: Array | None


class Sheet:
    """Elastic triangles with a stress-free shape.

    Attributes:
        area: (m,) [m^2] of the stress-free triangles. node_area: (n,) [m^2] a third of those around each node.
    """

    def __init__(self, reference: Array, triangles: Index, Et: float, poisson: float) -> None:
        """reference (n, 3) [m], triangles (m, 3), Et [N/m]."""
        self.triangles, self.count = triangles, len(reference)
        corner = reference[triangles]
        e, f = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        length = np.linalg.norm(e, axis=1)
        along = e / length[:, None]
        over = np.einsum("mi,mi->m", f, along)
        high = np.linalg.norm(f - over[:, None] * along, axis=1)
        self.area = 0.5 * length * high
        # gradients of the three shape functions in the triangle's own axes, (m, 3, 2)
        self._G = np.empty((len(triangles), 3, 2))
        self._G[:, 1, 0], self._G[:, 1, 1] = 1.0 / length, -over / (length * high)
        self._G[:, 2, 0], self._G[:, 2, 1] = 0.0, 1.0 / high
        self._G[:, 0] = -self._G[:, 1] - self._G[:, 2]
        self.node_area = np.bincount(triangles.ravel(), np.repeat(self.area / 3.0, 3), self.count)
        self._Et = Et
        c = Et / (1.0 - poisson**2)
        self._nu = poisson
        self._D = c * np.array([[1.0, poisson, 0.0], [poisson, 1.0, 0.0], [0.0, 0.0, 0.5 * (1.0 - poisson)]])
        self._flat = (triangles[:, :, None] * 3 + np.arange(3)).ravel()
        self.crept = np.zeros((len(triangles), 3))  # strain that stress has relaxed from, as `strain`

    def _deformation(self, x: Array) -> Array:
        """Deformation gradients (m, 3, 2)."""
        F: Array = np.matmul(x[self.triangles].transpose(0, 2, 1), self._G)
        return F

    def strain(self, x: Array) -> Array:
        """Green's strain (m, 3) as (E11, E22, 2 E12) of nodes x (n, 3)."""
        F = self._deformation(x)
        return _green(F)

    def load(self, x: Array, stiffness: bool = True) -> SheetLoad:
        """Energy, forces and stiffness at nodes x (n, 3) [m]."""
        F = self._deformation(x)
        strain = _green(F) - self.crept
        density, S, D = self._stress(strain, stiffness)
        G = self._G
        # virtual strains (m, 3 strains, 3 nodes, 3 components)
        V = np.empty((len(S), 3, 3, 3))
        f1, f2 = F[:, None, :, 0], F[:, None, :, 1]
        g1, g2 = G[:, :, None, 0], G[:, :, None, 1]
        V[:, 0] = f1 * g1
        V[:, 1] = f2 * g2
        V[:, 2] = f1 * g2 + f2 * g1
        B = V.reshape(-1, 3, 9)
        SA = S * self.area[:, None]
        nodal = np.matmul(SA[:, None, :], B)
        force = np.asarray(np.bincount(self._flat, nodal.ravel(), 3 * self.count).reshape(-1, 3), float)
        energy = float(density @ self.area)
        if D is None:
            return SheetLoad(energy, force, None)
        K = np.matmul(B.transpose(0, 2, 1), np.matmul(D * self.area[:, None, None], B))
        tension = np.empty((len(S), 2, 2))
        tension[:, 0, 0], tension[:, 1, 1] = SA[:, 0], SA[:, 1]
        tension[:, 0, 1] = tension[:, 1, 0] = SA[:, 2]
        geometric = np.matmul(G, np.matmul(tension, G.transpose(0, 2, 1)))
        blocks = K.reshape(-1, 3, 3, 3, 3)
        for i in range(3):
            blocks[:, :, i, :, i] += geometric
        return SheetLoad(energy, force, K)

    def _stress(self, E: Array, stiffness: bool) -> tuple[Array, Array, Array | None]:
        """Energy per area (m,), second Piola-Kirchhoff stress times thickness (m, 3) and its slope (m, 3, 3)."""
        S = E @ self._D
        density = 0.5 * np.einsum("mi,mi->m", E, S)
        D = np.repeat(self._D[None], len(E), axis=0) if stiffness else None
        mean, half, shear = 0.5 * (E[:, 0] + E[:, 1]), 0.5 * (E[:, 0] - E[:, 1]), 0.5 * E[:, 2]
        r = np.sqrt(half * half + shear * shear)
        large, small = mean + r, mean - r
        loose = small + self._nu * large < 0.0
        if not loose.any():
            return density, S, D
        r = np.maximum(r[loose], 1e-12)
        e1 = np.maximum(large[loose], 0.0)
        c2, s2 = half[loose] / r, shear[loose] / r
        N = np.column_stack([0.5 * (1.0 + c2), 0.5 * (1.0 - c2), 0.5 * s2])
        keep, full = _SLACK, 1.0 - _SLACK
        S[loose] = keep * S[loose] + (full * self._Et * e1)[:, None] * N
        density[loose] = keep * density[loose] + full * 0.5 * self._Et * e1**2
        if D is not None:
            M = np.column_stack([-0.5 * s2, 0.5 * s2, 0.5 * c2])
            taut = (e1 > 0.0).astype(float)
            D[loose] = keep * self._D + (full * self._Et) * (
                taut[:, None, None] * N[:, :, None] * N[:, None, :]
                + (e1 / r)[:, None, None] * M[:, :, None] * M[:, None, :]
            )
        return density, S, D


def _green(F: Array) -> Array:
    """Green's strain (m, 3) as (E11, E22, 2 E12) of deformation gradients (m, 3, 2)."""
    a, b = F[:, :, 0], F[:, :, 1]
    return np.column_stack(
        [
            0.5 * (np.einsum("mi,mi->m", a, a) - 1.0),
            0.5 * (np.einsum("mi,mi->m", b, b) - 1.0),
            np.einsum("mi,mi->m", a, b),
        ]
    )

# SPDX-License-Identifier: Apache-2.0
"""The enclosed gas: its volume over the rim's plane, which passes through the origin, with slopes."""

import numpy as np

from seed_core.spatial import Array
from seed_sim.membrane.sheet import Corners, Sheet


def volume(c: Corners) -> float:
    """[m^3] between triangles and the plane; positive where their area vectors point outwards."""
    return float((c.point * c.normal).sum()) / 3.0


def area_vectors(c: Corners, sheet: Sheet) -> Array:
    """(n, 3) [m^2]: a third of the triangles' area vectors around each node.

    The force of a unit of pressure and, for nodes off the rim, the gradient of the volume.
    """
    third = np.broadcast_to(c.normal / 3.0, (3, *c.normal.shape))
    return np.asarray(np.bincount(sheet.places, third.ravel(), 3 * sheet.count).reshape(-1, 3), float)


def add_curvature(c: Corners, factor: float, K: Array) -> None:
    """Add factor times the volume's second derivative to the triangles' matrices K (9, 9, m)."""
    blocks = K.reshape(3, 3, 3, 3, -1)
    corner = [(factor / 6.0) * v for v in (c.point, c.point + c.one, c.point + c.other)]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        # 6 dV/dx_i = x_j x x_k, whose slope is -[x_k] dx_j + [x_j] dx_k
        a, b = blocks[i, :, j], blocks[i, :, k]
        u, v = corner[k], corner[j]
        for p, q, r in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            a[p, q] += u[r]
            a[q, p] -= u[r]
            b[p, q] -= v[r]
            b[q, p] += v[r]

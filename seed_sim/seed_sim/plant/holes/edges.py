# SPDX-License-Identifier: Apache-2.0
"""How deep a point lies in a body that a face, a side and the chamfer between them bound.

It is convex there, so the depth is the least of the three. Its square is a potential: no work is done around a circle.
"""

import numpy as np

from seed_core.spatial import Array

_HALF = float(np.sqrt(0.5))


def depth_in(beyond: Array, below: Array, chamfer: float) -> Array:
    """(n,) [m] of points that lie `beyond` the side and `below` the face (n,) [m]; all positive inside."""
    return np.minimum(np.minimum(below, beyond), _HALF * (beyond + below - chamfer))


def normal_of(beyond: Array, below: Array, chamfer: float, side: Array, face: Array) -> Array:
    """Outward unit normals (n, 3) where these points are deepest, of side's and face's normals (n, 3), (3,)."""
    slope = _HALF * (beyond + below - chamfer)
    s = np.where((beyond <= below) & (beyond <= slope), 1.0, np.where(slope < below, _HALF, 0.0))
    f = np.where((below < beyond) & (below <= slope), 1.0, np.where(slope < beyond, _HALF, 0.0))
    return np.asarray(s[:, None] * side + f[:, None] * face)

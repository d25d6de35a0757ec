# SPDX-License-Identifier: Apache-2.0
"""Triangles on the flat sheet within the elliptic rim, and the dome that it is moulded to."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from seed_core.spatial import Array
from seed_sim.membrane.parameters import MembraneParameters

Index = NDArray[Any]
_SMOOTHING = 12  # passes that even out the triangles between lattice and rim
_CLEAR = 0.55  # [spacings] that lattice points keep from the rim


class SheetMesh(NamedTuple):
    """A sheet that lies flat at first and is moulded to a dome.

    Attributes:
        flat: (n, 2) [m] x and z of the nodes on the flat, printed sheet.
        triangles: (m, 3) indices, counter-clockwise in (x, z).
        rim: (n,) bool, clamped nodes.
    """

    flat: Array
    triangles: Index
    rim: NDArray[np.bool_]


def ellipse_mesh(a: float, b: float, spacing: float) -> SheetMesh:
    """Triangles of about `spacing` [m] in the ellipse with semi-axes a along x and b along z [m]."""
    rim = _rim_points(a, b, spacing)
    rows = int(b / (spacing * math.sqrt(0.75))) + 1
    columns = int(a / spacing) + 1
    k, i = np.mgrid[-rows : rows + 1, -columns : columns + 1]
    x, z = (i + 0.5 * (k % 2)).ravel() * spacing, k.ravel() * spacing * math.sqrt(0.75)
    gap = _CLEAR * spacing
    inside = (x / (a - gap)) ** 2 + (z / (b - gap)) ** 2 < 1.0
    points = np.concatenate([rim, np.column_stack([x, z])[inside]])
    clamped = np.arange(len(points)) < len(rim)
    for _ in range(_SMOOTHING):
        triangles = Delaunay(points).simplices
        total, count = np.zeros_like(points), np.zeros(len(points))
        for one, other in ((0, 1), (1, 2), (2, 0)):
            for p, q in ((one, other), (other, one)):
                np.add.at(total, triangles[:, p], points[triangles[:, q]])
                np.add.at(count, triangles[:, p], 1.0)
        points = np.where(clamped[:, None], points, 0.5 * (points + total / count[:, None]))
    triangles = Delaunay(points).simplices
    e, f = points[triangles[:, 1]] - points[triangles[:, 0]], points[triangles[:, 2]] - points[triangles[:, 0]]
    area = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
    triangles = np.where(area[:, None] > 0.0, triangles, triangles[:, ::-1])
    return SheetMesh(points, triangles[np.abs(area) > 1e-3 * spacing**2], clamped)


def _rim_points(a: float, b: float, spacing: float) -> Array:
    """Points on the ellipse at equal distances along it."""
    angle = np.linspace(0.0, 2.0 * math.pi, 2001)
    x, z = a * np.cos(angle), b * np.sin(angle)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(z)))])
    count = max(8, round(float(along[-1]) / spacing))
    at = np.interp(np.arange(count) * float(along[-1]) / count, along, angle)
    return np.column_stack([a * np.cos(at), b * np.sin(at)])


def moulded_dome(mesh: SheetMesh, p: MembraneParameters, side: float) -> Array:
    """Nodes (n, 3) [m] of the stress-free dome over the rim's plane y = 0; it points to -side y."""
    r2 = (mesh.flat[:, 0] / p.rim_x) ** 2 + (mesh.flat[:, 1] / p.rim_z) ** 2
    height = p.moulded * np.maximum(1.0 - r2, 0.0) ** p.exponent
    height[mesh.rim] = 0.0
    return np.column_stack([mesh.flat[:, 0], -side * height, mesh.flat[:, 1]])

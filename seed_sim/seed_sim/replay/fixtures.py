# SPDX-License-Identifier: Apache-2.0
"""The table of a scenario and what stands on it, to look at: its shape, the hole of a peg, a screw. In the frame S."""

import numpy as np

from seed_core.hand import Tool
from seed_core.meshes import Mesh, box, hills, slab
from seed_core.spatial import Array
from seed_sim.plant.table import Surface
from seed_sim.plant.tools import HOLE_CLEARANCE, HOLE_DEPTH, POINT_RADIUS, SLOT_CLEARANCE, SLOT_DEPTH, WALL, shape_of

TABLE = (0.6, 0.5)  # [m] that is drawn of the table
TABLE_AT = (0.12, 0.0)  # [m] its middle from where the work begins
_THICK = 0.02  # [m]
_CELL = 0.004  # [m] of the mesh of a table that is not flat
_DEEPEST = 0.12  # [m] that is drawn of a cylinder or a sphere
_STEEP = 1e-4  # [m] that a wall is drawn wide


def table_mesh(surface: Surface | None = None, cell: float = _CELL) -> Mesh:
    """The table in its frame S; a flat one if left out. cell: [m] of the mesh of one that is not flat."""
    if surface is None or not surface.shapes:
        return slab(TABLE, _THICK, TABLE_AT)
    across, along = (np.arange(-0.5 * s, 0.5 * s + cell, cell) for s in TABLE)
    x, y = across + TABLE_AT[0], along + TABLE_AT[1]
    for shape in surface.shapes:
        at = getattr(shape, "at", 0.0)
        x = np.union1d(x[np.abs(x - at) > _STEEP], (at - _STEEP, at + _STEEP))
    z = surface.height(*np.meshgrid(x, y, indexing="ij"))
    return hills(x, y, _filled(z), _THICK)


def _filled(z: Array) -> Array:
    """Heights without gaps: as deep as is drawn where there is no surface."""
    return np.maximum(np.where(np.isnan(z), -_DEEPEST, z), -_DEEPEST)


MOUTHS = {"round_peg": (0.00815, 0.00815), "plug": (0.0102, 0.0052)}  # [m] half the widths of the hole in a plate
RAISED = 6e-4  # [m] by which its edge is drawn above the plate


def fixtures(kind: str, tool: Tool) -> list[Mesh]:
    """Walls around the hole, or both halves of the screw's head; nothing for other tools."""
    if kind == "peg":
        half = float(np.abs(shape_of(kind, tool).points[:, 0]).max()) + POINT_RADIUS + HOLE_CLEARANCE
        return _frame(half, half, HOLE_DEPTH)
    if kind in MOUTHS:
        return _frame(*MOUTHS[kind], RAISED)
    if kind == "torque_driver":
        out = POINT_RADIUS + SLOT_CLEARANCE + 0.5 * WALL
        return [box((0.03, WALL, SLOT_DEPTH), (0.0, side * out, 0.5 * SLOT_DEPTH)) for side in (1.0, -1.0)]
    return []


def _frame(a: float, b: float, height: float) -> list[Mesh]:
    """Four walls around a hole of half the widths a and b [m]."""
    x, y, long = a + 0.5 * WALL, b + 0.5 * WALL, 2.0 * (b + WALL)
    sides = ((x, 0.0, WALL, long), (-x, 0.0, WALL, long), (0.0, y, 2.0 * a, WALL), (0.0, -y, 2.0 * a, WALL))
    return [box((w, d, height), (cx, cy, 0.5 * height)) for cx, cy, w, d in sides]

# SPDX-License-Identifier: Apache-2.0
"""What stands on the table of a scenario, to look at: the hole of a peg, the screw of a driver. In the frame S."""

import numpy as np

from seed_core.hand import Tool
from seed_core.meshes import Mesh, box
from seed_sim.plant.tools import HOLE_CLEARANCE, HOLE_DEPTH, POINT_RADIUS, SLOT_CLEARANCE, SLOT_DEPTH, WALL, shape_of


def fixtures(kind: str, tool: Tool) -> list[Mesh]:
    """Walls around the hole, or both halves of the screw's head; nothing for other tools."""
    if kind == "peg":
        half = float(np.abs(shape_of(kind, tool).points[:, 0]).max()) + POINT_RADIUS + HOLE_CLEARANCE
        out, long = half + 0.5 * WALL, 2.0 * (half + WALL)
        sides = ((out, 0.0, WALL, long), (-out, 0.0, WALL, long), (0.0, out, long, WALL), (0.0, -out, long, WALL))
        return [box((a, b, HOLE_DEPTH), (x, y, 0.5 * HOLE_DEPTH)) for x, y, a, b in sides]
    if kind == "torque_driver":
        out = POINT_RADIUS + SLOT_CLEARANCE + 0.5 * WALL
        return [box((0.03, WALL, SLOT_DEPTH), (0.0, side * out, 0.5 * SLOT_DEPTH)) for side in (1.0, -1.0)]
    return []

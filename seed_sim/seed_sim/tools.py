# SPDX-License-Identifier: Apache-2.0
"""Shapes of the simulated tools: contact points, inertia and what is drawn, all in the tool's frame T."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seed_core.hand import Tool
from seed_core.spatial import Array

BLADE = 0.2  # [m] length of the squeegee's blade, along y_C
POINTS = 5  # contact points of the blade


@dataclass(frozen=True)
class ToolShape:
    """Contact points (n, 3) [m] in T, gyration radii (3,) [m] about the centre of mass, and boxes to draw."""

    points: Array
    gyration: Array
    boxes: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...]  # (size, centre) [m]


def shape_of(kind: str, tool: Tool) -> ToolShape:
    """Shape of a tool of the given kind whose tip frame is tool.T_tip."""
    tip = np.array(tool.T_tip.position)
    length = float(np.linalg.norm(tip))
    handle = ((0.02, 0.02, length + 0.04), (0.0, 0.0, 0.5 * length - 0.02))
    if kind == "squeegee":
        along = np.linspace(-0.5, 0.5, POINTS) * BLADE
        points = tip + np.stack([np.zeros(POINTS), along, np.zeros(POINTS)], axis=1)
        return ToolShape(
            points,
            np.array((0.062, 0.035, 0.058)),
            (handle, ((0.008, BLADE, 0.03), (float(tip[0]), float(tip[1]), float(tip[2]) - 0.015))),
        )
    if kind == "pen":
        return ToolShape(tip[None], np.array((0.04, 0.04, 0.004)), (((0.009, 0.009, length + 0.03), handle[1]),))
    if kind == "torque_driver":  # a bit in a screw: four points on a circle and its end
        angles = np.arange(4) * np.pi / 2
        ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(4)], axis=1)
        return ToolShape(tip + 0.004 * ring, np.array((0.04, 0.04, 0.012)), (handle,))
    angles = np.arange(8) * np.pi / 4  # peg: the edge of its end
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(8)], axis=1)
    return ToolShape(tip + 0.01 * ring, np.array((0.04, 0.04, 0.01)), (handle,))

# SPDX-License-Identifier: Apache-2.0
"""Shapes and inertia of the simulated tools, all in the tool's frame T."""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from seed_core.hand import Tool
from seed_core.spatial import Array, skew

# Every tool of the plant. How each is drawn: `seed_core.meshes.tool_parts`; what stands on the table for it:
# `plant.cell.Cell` and, to look at, `replay.fixtures`.
TOOLS = ("squeegee", "pen", "torque_driver", "peg", "ball", "round_peg", "plug")
BLADE = 0.2  # [m] width of the squeegee's blade, along y_C
BLADE_SHARE = 0.8  # of the squeegee's mass that lies along the blade
POINTS = 5  # contact points of the blade
POINT_RADIUS = 1e-3  # [m] of a contact sphere; its lowest point is the contact point
BALL_RADIUS = 8e-3  # [m] of the ball's tip
BIT_REACH = 0.008  # [m] half the width of the driver's flat blade, along x
SLOT_CLEARANCE, SLOT_DEPTH = 1e-4, 5e-3  # [m] beside the driver's blade; of the screw's slot
SCREW_STIFFNESS, SCREW_DAMPING = 3.0, 0.05  # [N m/rad], [N m s/rad] that the screw turns against
PEG_HALF, PEG_GUIDE = 0.009, 0.012  # [m] half the peg's width between contact points; their distance along it
HOLE_CLEARANCE, HOLE_DEPTH = 3e-4, 0.015  # [m] on each side of the peg; of the hole
WALL = 0.02  # [m] thickness of a hole's or slot's wall


@dataclass(frozen=True)
class ContactShape:
    """Contact points (n, 3) [m] in T, and gyration radii (3,) [m] about the centre of mass.

    Each is the lowest point of a sphere of that radius [m].
    """

    points: Array
    gyration: Array
    radius: float = POINT_RADIUS

    @property
    def touching(self) -> int:
        """How many of the points meet a flat table."""
        return int(np.isclose(self.points[:, 2], self.points[:, 2].max()).sum())


def shape_of(kind: str, tool: Tool, blade: float = BLADE) -> ContactShape:
    """Shape of a tool of TOOLS whose tip frame is tool.T_tip; blade: [m] width of a squeegee's."""
    x, y, z = tool.T_tip.position
    along_blade = [(0.0, s * blade, 0.0) for s in np.linspace(-0.5, 0.5, POINTS)]
    wider = BLADE_SHARE * (blade**2 - BLADE**2) / 12.0
    sides = (-PEG_HALF, PEG_HALF)
    peg_ends = [(a, b, -c) for c in (0.0, PEG_GUIDE) for a in sides for b in sides]
    points, gyration = {
        "squeegee": (along_blade, (sqrt(0.062**2 + wider), 0.035, sqrt(0.058**2 + wider))),
        "pen": ([(0.0, 0.0, 0.0)], (0.04, 0.04, 0.004)),
        "torque_driver": ([(BIT_REACH, 0.0, 0.0), (-BIT_REACH, 0.0, 0.0)], (0.04, 0.04, 0.012)),
        "peg": (peg_ends, (0.04, 0.04, 0.01)),
        "ball": ([(0.0, 0.0, 0.0)], (0.04, 0.04, 0.01)),
        "round_peg": ([(0.0, 0.0, 0.0)], (0.04, 0.04, 0.01)),  # what meets its hole is `seed_sim.plant.holes`
        "plug": ([(0.0, 0.0, 0.0)], (0.04, 0.04, 0.01)),
    }[kind]
    radius = BALL_RADIUS if kind == "ball" else POINT_RADIUS
    return ContactShape(np.array((x, y, z)) + np.array(points), np.array(gyration), radius)


@dataclass(frozen=True)
class ToolInertia:
    """Mass and inertia of the tool, and of what moves: the tool with its share of the gripper's pads.

    Attributes:
        mass, com: of the tool, which weighs [kg], (3,) [m] in T.
        moving_mass, moving_com: with the pads [kg], (3,) [m].
        about_T: (3, 3) rotational inertia about T's origin with the pads [kg m^2].
    """

    mass: float
    com: Array
    moving_mass: float
    moving_com: Array
    about_T: Array


def inertia_of(shape: ContactShape, mass: float, com: Array, pad_mass: float, pad_radius: float) -> ToolInertia:
    """Inertia of a tool of that shape [kg, m], pads of pad_mass at T's origin with gyration radius pad_radius."""
    c = skew(com)
    about_T = np.diag(shape.gyration**2) * mass - mass * (c @ c) + np.eye(3) * pad_mass * pad_radius**2
    moving = mass + pad_mass
    return ToolInertia(mass, np.asarray(com), moving, mass * np.asarray(com) / moving, about_T)

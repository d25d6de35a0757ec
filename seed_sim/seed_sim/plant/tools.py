# SPDX-License-Identifier: Apache-2.0
"""Shapes and inertia of the simulated tools, all in the tool's frame T."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seed_core.bushing import Stiffness
from seed_core.hand import Tool
from seed_core.spatial import Array, skew

BLADE = 0.2  # [m] length of the squeegee's blade, along y_C
POINTS = 5  # contact points of the blade
POINT_RADIUS = 1e-3  # [m] of a contact sphere; its lowest point is the contact point
BIT_REACH = 0.008  # [m] half the width of the driver's flat blade, along x
SLOT_CLEARANCE, SLOT_DEPTH = 1e-4, 5e-3  # [m] beside the driver's blade; of the screw's slot
SCREW_STIFFNESS, SCREW_DAMPING = 3.0, 0.05  # [N m/rad], [N m s/rad] that the screw turns against
PEG_HALF, PEG_GUIDE = 0.009, 0.012  # [m] half the peg's width between contact points; their distance along it
HOLE_CLEARANCE, HOLE_DEPTH = 3e-4, 0.015  # [m] on each side of the peg; of the hole


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
    if kind == "torque_driver":  # the flat blade of a screwdriver, in a slot
        points = tip + np.array([(BIT_REACH, 0.0, 0.0), (-BIT_REACH, 0.0, 0.0)])
        return ToolShape(points, np.array((0.04, 0.04, 0.012)), (handle,))
    ends = [(x, y, -z) for z in (0.0, PEG_GUIDE) for x in (-PEG_HALF, PEG_HALF) for y in (-PEG_HALF, PEG_HALF)]
    return ToolShape(tip + np.array(ends), np.array((0.04, 0.04, 0.01)), (handle,))


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


def inertia_of(shape: ToolShape, mass: float, com: Array, pad_mass: float, pad_radius: float) -> ToolInertia:
    """Inertia of a tool of that shape [kg, m], pads of pad_mass at T's origin with gyration radius pad_radius."""
    c = skew(com)
    about_T = np.diag(shape.gyration**2) * mass - mass * (c @ c) + np.eye(3) * pad_mass * pad_radius**2
    moving = mass + pad_mass
    return ToolInertia(mass, np.asarray(com), moving, mass * np.asarray(com) / moving, about_T)


def damping_of(inertia: ToolInertia, stiffness: Stiffness, ratio: float) -> tuple[Array, Array]:
    """Constants (3,) [N m s/rad] and (3,) [N s/m] with the given damping ratio on each axis by itself."""
    rotation = 2.0 * ratio * np.sqrt(np.array(stiffness.rotation) * np.diag(inertia.about_T))
    return rotation, 2.0 * ratio * np.sqrt(np.array(stiffness.translation) * inertia.moving_mass)


def fastest_rate(inertia: ToolInertia, stiffness: Stiffness, ratio: float) -> float:
    """Fastest rate of the held tool [rad/s, 1/s]: an explicit step dt follows it only while rate dt < 1.

    From the eigenvalues of the damped linear system, rotation and translation coupled by the centre of mass.
    """
    M, m = np.zeros((6, 6)), inertia.moving_mass
    c = m * skew(inertia.moving_com)
    M[:3, :3], M[:3, 3:], M[3:, :3], M[3:, 3:] = inertia.about_T, c, -c, m * np.eye(3)
    K = np.diag(np.concatenate([stiffness.rotation, stiffness.translation]))
    D = np.diag(np.concatenate(damping_of(inertia, stiffness, ratio)))
    A = np.block([[np.zeros((6, 6)), np.eye(6)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    return float(np.abs(np.linalg.eigvals(A)).max())

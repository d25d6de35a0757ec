# SPDX-License-Identifier: Apache-2.0
"""The gripper with its two bubbles' cases, and what it holds, as parts to draw."""

import numpy as np

from seed_core.hand import Hand, Tool
from seed_core.meshes.bubbles import RADIUS, RIM, RIM_X, RIM_Z, SIDES
from seed_core.meshes.shapes import SECTORS, Mesh, Part, box, capsule, cylinder, joined, loft, sphere, turned
from seed_core.spatial import Array, make_pose

BLADE = 0.2  # [m] width of a squeegee's blade, along y of its tip
BALL = 0.008  # [m] radius of a rounded tip
STEEL, DARK, BLUE = (168, 176, 188), (96, 104, 118), (31, 111, 235)
RUBBER, PAPER = (52, 56, 64), (238, 240, 244)
BUBBLE, WOOD = (246, 205, 120), (196, 164, 122)
_WALL = 0.004  # [m] around the rim
_BEHIND = 0.014  # [m] of a case behind its camera


def hand_parts(hand: Hand | None = None, rim: float = RIM) -> list[Part]:
    """Coupling, palm, and for each finger its arm and the case that its bubble sits on.

    Args:
        hand: where flange and cameras are; the default hand if left out.
        rim: [m] from C to the plane of each rim.
    """
    h = hand or Hand()
    up = max(float(np.linalg.norm(h.E_C.position)), 0.06)  # from C back to the flange
    parts = [
        Part("coupling", "C", cylinder(0.034, (0.0, 0.0, -up), (0.0, 0.0, 0.022 - up)), STEEL),
        Part("palm", "C", _rounded((0.076, 0.19, 0.044), (0.0, 0.0, 0.044 - up)), DARK),
    ]
    for finger, frame in (("left", h.C_L), ("right", h.C_R)):
        side = SIDES[finger]
        back = max(abs(frame.position[1]), rim + 0.02) + _BEHIND
        arm = _rounded((0.034, 0.016, up - 0.02), (0.0, side * (back - 0.006), 0.5 * (0.044 - up - 0.02) + 0.012))
        parts += [
            Part(f"{finger} finger", "C", arm, STEEL),
            Part(f"{finger} case", "C", _case(side, rim, back), DARK),
        ]
    return parts


def _case(side: float, rim: float, back: float) -> Mesh:
    """From the plane of the rim to behind the camera, narrowing."""
    angle = 2.0 * np.pi * np.arange(SECTORS) / SECTORS * -side
    c, s = np.cos(angle), np.sin(angle)
    stations = [(rim, 1.0), (rim + 0.012, 1.0), (rim + 0.02, 0.88), (back - 0.006, 0.62), (back, 0.56)]
    x, z = (RIM_X + _WALL) * c, (RIM_Z + _WALL) * s
    return loft([np.column_stack([k * x, np.full(SECTORS, side * y), k * z]) for y, k in stations])


def _rounded(size: tuple[float, float, float], centre: tuple[float, float, float], edge: float = 0.006) -> Mesh:
    """A box whose edges along z are rounded."""
    a, b = 0.5 * size[0] - edge, 0.5 * size[1] - edge
    angle = np.linspace(0.0, 0.5 * np.pi, 6)
    corners = ((a, b, 0.0), (-a, b, 0.5), (-a, -b, 1.0), (a, -b, 1.5))
    ring = np.concatenate(
        [
            np.column_stack([x + edge * np.cos(angle + t * np.pi), y + edge * np.sin(angle + t * np.pi)])
            for x, y, t in corners
        ]
    )
    n = len(ring)
    stations = [(-0.5, 0.985), (-0.47, 1.0), (0.47, 1.0), (0.5, 0.985)]
    mesh = loft([np.column_stack([k * ring, np.full(n, z * size[2])]) for z, k in stations])
    return Mesh(mesh.vertices + np.array(centre), mesh.faces)


def tool_parts(
    tool: Tool | None = None, kind: str = "", radius: float = RADIUS, blade_width: float = BLADE
) -> list[Part]:
    """The tool in T, by its kind; for an unknown one a rod to its tip.

    Args:
        tool: where its tip is; the default tool if left out.
        kind: 'squeegee', 'pen' or 'marker', 'torque_driver', 'peg', 'ball', 'round_peg', 'plug'; its name if left out.
        radius: [m] of the handle between the bubbles.
        blade_width: [m] of a squeegee's blade.
    """
    held = tool or Tool()
    name, X = kind or held.name, held.X_Ttip
    tip = X[:3, 3]
    length = max(float(np.linalg.norm(tip)), 0.03)
    along = tip / length if np.linalg.norm(tip) > 1e-6 else np.array((0.0, 0.0, 1.0))
    top, mid = -0.075 * along, (length - 0.03) * along
    handle = Part("handle", "T", capsule(radius, top + radius * along, min(0.055, length - 0.04) * along), BLUE)
    shaft = Part("shaft", "T", cylinder(0.5 * radius, 0.03 * along, mid), STEEL)
    match name:
        case "squeegee":
            bar = _rounded((0.016, blade_width + 0.006, 0.018), (0.0, 0.0, -0.027)).moved(X)
            blade = box((0.004, blade_width, 0.024), (0.0, 0.0, -0.012)).moved(X)
            shaft = Part("shaft", "T", cylinder(0.6 * radius, 0.03 * along, tip - 0.025 * X[:3, 2]), STEEL)
            return [handle, shaft, Part("bar", "T", bar, STEEL), Part("blade", "T", blade, RUBBER)]
        case "pen" | "marker":
            body = turned([(1e-4, 0.0), (0.0012, -0.0012), (0.002, -0.008), (0.0065, -0.024), (0.0065, -length)][::-1])
            return [handle, Part("pen", "T", body.moved(make_pose(X[:3, :3], tip)), RUBBER)]
        case "torque_driver":
            bit = box((0.016, 0.0016, 0.02), (0.0, 0.0, -0.01)).moved(X)
            return [handle, shaft, Part("bit", "T", _to_tip(bit, mid, tip, 0.004), STEEL)]
        case "round_peg":
            body = turned([(0.0075, 0.0), (0.008, -5e-4), (0.008, 0.03 - length)][::-1])
            return [handle, shaft, Part("peg", "T", body.moved(make_pose(X[:3, :3], tip)), STEEL)]
        case "plug":
            body = box((0.02, 0.01, length - 0.03), _middle(length)).moved(X)
            return [handle, shaft, Part("plug", "T", body, RUBBER)]
        case "peg":
            return [handle, Part("peg", "T", box((0.02, 0.02, length - 0.03), _middle(length)).moved(X), STEEL)]
        case "ball":
            centre = tip - BALL * X[:3, 2]
            return [
                handle,
                Part("shaft", "T", cylinder(0.4 * BALL, 0.03 * along, centre), STEEL),
                Part("tip", "T", sphere(BALL, centre), RUBBER),
            ]
    ball = Part("tip", "T", capsule(0.002, tip - 0.006 * along, tip - 0.002 * along), RUBBER)
    return [handle, Part("shaft", "T", cylinder(0.004, 0.03 * along, tip - 0.006 * along), STEEL), ball]


def _middle(length: float) -> tuple[float, float, float]:
    return (0.0, 0.0, -0.5 * (length - 0.03))


def _to_tip(head: Mesh, start: Array, tip: Array, radius: float) -> Mesh:
    return joined([head, cylinder(radius, start, start + 0.4 * (tip - start))])

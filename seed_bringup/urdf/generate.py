# SPDX-License-Identifier: Apache-2.0
"""Writes ur5e.urdf and ur10e.urdf, arms with our gripper and tool, from the DH table and the default hand.

Run it after a change of seed_ur.models or seed_core.hand:  ./seed shell python seed_bringup/urdf/generate.py
Frames of links lie where those of the same names lie in ur_description: on the axis of joint i (z), already moved by d
along it (UniversalRobots/Universal_Robots_ROS2_Description, urdf/ur_macro.xacro and config/*/default_kinematics.yaml).
Masses and centres of mass are UR's; inertias are those of uniform cylinders along the link; shapes are sketches.
Every function gives a piece of URDF as text.
"""

from collections.abc import Iterable
from math import cos, hypot, pi, sin
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from seed_core.hand import Hand, Tool
from seed_core.spatial import Array
from seed_ur.models import ALPHA, JOINT_NAMES, LINK_NAMES, MODELS, URModel

THICKNESS = {
    "ur5e": (0.06, 0.055, 0.045, 0.04, 0.04, 0.037),
    "ur10e": (0.085, 0.075, 0.06, 0.05, 0.05, 0.045),
}  # radii [m]
COLOURS = {
    "arm": "0.75 0.78 0.80 1",
    "hand": "0.25 0.27 0.30 1",
    "soft": "0.30 0.45 0.75 0.5",
    "tool": "0.85 0.45 0.15 1",
}
FINGER_LENGTH = 0.09  # [m] of the sketched fingers along z_C


def numbers(*values: float) -> str:
    """Nine decimals, no negative zero."""
    return " ".join(f"{round(float(v), 9) + 0.0:.10g}" for v in values)


def origin(xyz: Iterable[float] = (0, 0, 0), rpy: Iterable[float] = (0, 0, 0)) -> str:
    """Where something is [m], [rad]."""
    return f'<origin xyz="{numbers(*xyz)}" rpy="{numbers(*rpy)}"/>'


def link(name: str, *parts: str) -> str:
    """A link with its inertia and shapes."""
    return f'<link name="{name}">{"".join(parts)}</link>'


def shape(geometry: str, at: str, colour: str, solid: bool = True) -> str:
    """What is seen, and, of what is solid, what is bumped into."""
    body = f"{at}<geometry>{geometry}</geometry>"
    material = f'<material name="{colour}"><color rgba="{COLOURS[colour]}"/></material>'
    return f"<visual>{body}{material}</visual>" + (f"<collision>{body}</collision>" if solid else "")


def box(size: tuple[float, float, float], centre: tuple[float, float, float], colour: str) -> str:
    """A box [m]."""
    return shape(f'<box size="{numbers(*size)}"/>', origin(centre), colour)


def cylinder(start: Array, end: Array, radius: float, colour: str) -> str:
    """A cylinder from `start` to `end` [m]."""
    way = end - start
    length = float(np.linalg.norm(way))
    yaw, pitch = float(np.arctan2(way[1], way[0])), float(np.arctan2(hypot(way[0], way[1]), way[2]))
    geometry = f'<cylinder radius="{numbers(radius)}" length="{numbers(length)}"/>'
    return shape(geometry, origin((start + end) / 2, (0.0, pitch, yaw)), colour)


def inertial(mass: float, com: Iterable[float], axis: Array, radius: float, length: float) -> str:
    """Mass [kg], centre [m] and the inertia [kg m^2] of a uniform cylinder along `axis`."""
    across, along = mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2
    I = across * np.eye(3) + (along - across) * np.outer(axis, axis)  # noqa: E741
    moments = " ".join(f'i{"xyz"[i]}{"xyz"[j]}="{numbers(I[i, j])}"' for i in range(3) for j in range(i, 3))
    return f'<inertial>{origin(com)}<mass value="{numbers(mass)}"/><inertia {moments}/></inertial>'


def joint(name: str, kind: str, parent: str, child: str, at: str, *more: str) -> str:
    """A joint."""
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{at}{"".join(more)}</joint>'


def arm_link(arm: URModel, i: int) -> str:
    """Link i with its mass and a sketch of its tube, shifted along z to where its centre of mass says it is."""
    c, s = cos(ALPHA[i]), sin(ALPHA[i])
    B = np.array(((1, 0, 0, arm.a[i]), (0, c, -s, 0), (0, s, c, 0), (0, 0, 0, 1.0)))  # to DH's frame i
    com = (B @ [*arm.com[i], 1.0])[:3]
    radius = THICKNESS[arm.name][i]
    if abs(arm.a[i]) > 0:
        start = np.array((0.0, 0.0, com[2]))
        end = start + np.array((arm.a[i], 0.0, 0.0))
    else:
        start, end = np.array((0.0, 0.0, -arm.d[i])), np.zeros(3)
    length = float(np.linalg.norm(end - start))
    mass = inertial(arm.mass[i], com, (end - start) / length, radius, length)
    return link(LINK_NAMES[i], mass, cylinder(start, end, radius, "arm"))


def arm_joint(arm: URModel, i: int) -> str:
    """Joint i about its z, with its limits."""
    a, alpha, d = (arm.a[i - 1], ALPHA[i - 1], arm.d[i]) if i else (0.0, 0.0, arm.d[0])
    at = origin((a, -sin(alpha) * d, cos(alpha) * d), (alpha, 0.0, 0.0))
    limits = {"lower": -arm.range, "upper": arm.range, "velocity": arm.speed[i], "effort": arm.torque[i]}
    limit = " ".join(f'{name}="{numbers(value)}"' for name, value in limits.items())
    parent = "base" if i == 0 else LINK_NAMES[i - 1]
    return joint(JOINT_NAMES[i], "revolute", parent, LINK_NAMES[i], at, '<axis xyz="0 0 1"/>', f"<limit {limit}/>")


def hand_and_tool(hand: Hand, tool: Tool) -> list[str]:
    """Gripper with two bubbles about C, and the tool, whose pose in C is measured: TF gives it (a floating joint)."""
    C, tip = hand.E_C.position, np.array(tool.T_tip.position)
    fingers = []
    for side in (1, -1):
        fingers.append(box((0.07, 0.03, FINGER_LENGTH), (0, side * 0.08, -0.01), "hand"))
        fingers.append(shape('<sphere radius="0.03"/>', origin((0, side * 0.035, 0)), "soft", solid=False))
    blade = [box((0.006, 0.2, 0.02), (0, 0, float(tip[2]) - 0.01), "tool")] if tool.name == "squeegee" else []
    mass = inertial(tool.mass, tool.center_of_mass, tip / np.linalg.norm(tip), 0.012, float(tip[2]))
    return [
        link(
            "gripper",
            inertial(1.2, (0, 0, C[2] / 3), np.array((0, 0, 1.0)), 0.04, C[2]),
            box((0.08, 0.20, C[2] / 2), (0, 0, C[2] / 4), "hand"),
        ),
        joint("gripper_mount", "fixed", "tool0", "gripper", origin()),
        link("compliance", *fingers),
        joint("compliance_mount", "fixed", "tool0", "compliance", origin(C, np.deg2rad(hand.E_C.rpy_deg))),
        link("tool", mass, cylinder(np.zeros(3), tip, 0.012, "tool"), *blade),
        joint("grasp", "floating", "compliance", "tool", origin()),
        link("tip"),
        joint("tip_mount", "fixed", "tool", "tip", origin(tip, np.deg2rad(tool.T_tip.rpy_deg))),
    ]


def robot(arm: URModel, hand: Hand, tool: Tool) -> str:
    """The URDF: base_link, base (half a turn about z), six joints, tool0, gripper, tool."""
    foot = cylinder(np.zeros(3), np.array((0, 0, arm.d[0] / 2)), THICKNESS[arm.name][0] * 1.2, "arm")
    parts = [
        link("base_link", foot),
        link("base"),
        joint("base_turn", "fixed", "base_link", "base", origin(rpy=(0, 0, pi))),
        *(part for i in range(6) for part in (arm_link(arm, i), arm_joint(arm, i))),
        link("tool0"),
        joint("flange", "fixed", LINK_NAMES[5], "tool0", origin()),
        *hand_and_tool(hand, tool),
    ]
    root = ET.fromstring(f'<robot name="seed_{arm.name}">{"".join(parts)}</robot>')
    root.insert(0, ET.Comment(" made by generate.py; do not edit "))
    ET.indent(root)
    head = '<?xml version="1.0"?>\n<!-- SPDX-License-Identifier: Apache-2.0 -->\n'
    return head + ET.tostring(root, encoding="unicode") + "\n"


def texts() -> dict[str, str]:
    """File name and content of every URDF."""
    return {f"{name}.urdf": robot(arm, Hand(), Tool()) for name, arm in MODELS.items()}


if __name__ == "__main__":
    for file, text in texts().items():
        (Path(__file__).parent / file).write_text(text, encoding="utf-8")

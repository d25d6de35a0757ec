# SPDX-License-Identifier: Apache-2.0
"""Writes ur5e.urdf and ur10e.urdf, arms with our gripper and tool, from the DH table and the default hand.

Run it after a change of seed_ur.models or seed_core.hand:  ./seed shell python seed_bringup/urdf/generate.py
Link i's frame stands on the axis of joint i (z); its offset B_i = Tz(d) Tx(a) Rx(alpha) leads to the next joint.
Masses and centres of mass are UR's; inertias are those of uniform cylinders along the link; shapes are sketches.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import cos, hypot, pi, sin
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from seed_core.hand import Hand, Tool
from seed_ur.models import ALPHA, JOINT_NAMES, LINK_NAMES, MODELS, URModel

Array = NDArray[np.float64]
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


def numbers(values: Iterable[float]) -> str:
    """Nine decimals, no negative zero."""
    return " ".join(f"{round(float(v), 9) + 0.0:.10g}" for v in values)


def origin(xyz: Iterable[float] = (0, 0, 0), rpy: Iterable[float] = (0, 0, 0)) -> ET.Element:
    """An <origin>."""
    return ET.Element("origin", xyz=numbers(xyz), rpy=numbers(rpy))


def shape(kind: str, size: dict[str, str], at: ET.Element, colour: str) -> list[ET.Element]:
    """Visual and collision of one solid."""
    out = []
    for tag in ("visual", "collision"):
        element = ET.Element(tag)
        element.append(origin_copy(at))
        ET.SubElement(ET.SubElement(element, "geometry"), kind, size)
        if tag == "visual":
            material = ET.SubElement(element, "material", name=colour)
            ET.SubElement(material, "color", rgba=COLOURS[colour])
        out.append(element)
    return out


def origin_copy(at: ET.Element) -> ET.Element:
    """A copy, since an element has one parent."""
    return ET.Element("origin", dict(at.attrib))


def cylinder(start: Array, end: Array, radius: float, colour: str) -> list[ET.Element]:
    """A cylinder from `start` to `end` [m]."""
    way = end - start
    length = float(np.linalg.norm(way))
    yaw, pitch = float(np.arctan2(way[1], way[0])), float(np.arctan2(hypot(way[0], way[1]), way[2]))
    at = origin((start + end) / 2, (0.0, pitch, yaw))
    return shape("cylinder", {"radius": numbers([radius]), "length": numbers([length])}, at, colour)


def inertial(mass: float, com: Array, axis: Array, radius: float, length: float) -> ET.Element:
    """Mass, centre and the inertia of a uniform cylinder along `axis`."""
    out = ET.Element("inertial")
    out.append(origin(com))
    ET.SubElement(out, "mass", value=numbers([mass]))
    across, along = mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2
    I = across * np.eye(3) + (along - across) * np.outer(axis, axis)  # noqa: E741
    names = {"ixx": I[0, 0], "ixy": I[0, 1], "ixz": I[0, 2], "iyy": I[1, 1], "iyz": I[1, 2], "izz": I[2, 2]}
    ET.SubElement(out, "inertia", {k: numbers([v]) for k, v in names.items()})
    return out


def offset(arm: URModel, i: int) -> Array:
    """B_i (4, 4): from the axis of joint i to that of joint i + 1."""
    c, s = cos(ALPHA[i]), sin(ALPHA[i])
    return np.array(((1, 0, 0, arm.a[i]), (0, c, -s, 0), (0, s, c, arm.d[i]), (0, 0, 0, 1.0)))


def arm_link(arm: URModel, i: int) -> ET.Element:
    """Link i with its mass and a sketch of its tube, shifted along z to where its centre of mass says it is."""
    link = ET.Element("link", name=LINK_NAMES[i])
    B = offset(arm, i)
    com = (B @ [*arm.com[i], 1.0])[:3]
    radius = THICKNESS[arm.name][i]
    side = np.array((0.0, 0.0, com[2] if abs(arm.a[i]) > 0 else 0.0))
    start, end = side, np.array((arm.a[i], 0.0, 0.0)) + (side if abs(arm.a[i]) > 0 else np.array((0, 0, arm.d[i])))
    way = end - start
    length = float(np.linalg.norm(way))
    link.append(inertial(arm.mass[i], com, way / length, radius, length))
    link.extend(cylinder(start, end, radius, "arm"))
    return link


def joint(name: str, kind: str, parent: str, child: str, at: ET.Element) -> ET.Element:
    """A joint about z."""
    out = ET.Element("joint", name=name, type=kind)
    ET.SubElement(out, "parent", link=parent)
    ET.SubElement(out, "child", link=child)
    out.append(at)
    if kind == "revolute":
        ET.SubElement(out, "axis", xyz="0 0 1")
    return out


def arm_joint(arm: URModel, i: int) -> ET.Element:
    """Joint i with its limits."""
    at = origin() if i == 0 else origin((arm.a[i - 1], 0.0, arm.d[i - 1]), (ALPHA[i - 1], 0.0, 0.0))
    out = joint(JOINT_NAMES[i], "revolute", "base" if i == 0 else LINK_NAMES[i - 1], LINK_NAMES[i], at)
    limits = {"lower": -arm.range, "upper": arm.range, "velocity": arm.speed[i], "effort": arm.torque[i]}
    ET.SubElement(out, "limit", {k: numbers([v]) for k, v in limits.items()})
    return out


def box(size: tuple[float, float, float], centre: tuple[float, float, float], colour: str) -> list[ET.Element]:
    """A box."""
    return shape("box", {"size": numbers(size)}, origin(centre), colour)


def hand_and_tool(hand: Hand, tool: Tool) -> list[ET.Element]:
    """Gripper with two bubbles about C, and the tool, whose pose in C is measured: TF gives it (a floating joint)."""
    C = hand.E_C.position
    body = ET.Element("link", name="gripper")
    body.append(inertial(1.2, np.array((0, 0, C[2] / 3)), np.array((0, 0, 1.0)), 0.04, C[2]))
    body.extend(box((0.08, 0.20, C[2] / 2), (0, 0, C[2] / 4), "hand"))
    compliance = ET.Element("link", name="compliance")
    for side in (1, -1):
        compliance.extend(box((0.07, 0.03, FINGER_LENGTH), (0, side * 0.08, -0.01), "hand"))
        ball = shape("sphere", {"radius": "0.03"}, origin((0, side * 0.035, 0)), "soft")
        compliance.extend(e for e in ball if e.tag == "visual")
    held = ET.Element("link", name="tool")
    tip = np.array(tool.T_tip.position)
    held.append(inertial(tool.mass, np.array(tool.center_of_mass), tip / np.linalg.norm(tip), 0.012, float(tip[2])))
    held.extend(cylinder(np.zeros(3), tip, 0.012, "tool"))
    if tool.name == "squeegee":
        held.extend(box((0.006, 0.2, 0.02), (0, 0, float(tip[2]) - 0.01), "tool"))
    degrees = [d * pi / 180 for d in hand.E_C.rpy_deg]
    return [
        body,
        joint("gripper_mount", "fixed", "tool0", "gripper", origin()),
        compliance,
        joint("compliance_mount", "fixed", "tool0", "compliance", origin(C, degrees)),
        held,
        joint("grasp", "floating", "compliance", "tool", origin()),
        ET.Element("link", name="tip"),
        joint("tip_mount", "fixed", "tool", "tip", origin(tip, [d * pi / 180 for d in tool.T_tip.rpy_deg])),
    ]


def robot(arm: URModel, hand: Hand, tool: Tool) -> str:
    """The URDF text: base_link, base (half a turn about z), six joints, tool0, gripper, tool."""
    root = ET.Element("robot", name=f"seed_{arm.name}")
    root.append(ET.Comment(" made by generate.py; do not edit "))
    foot = ET.SubElement(root, "link", name="base_link")
    foot.extend(cylinder(np.zeros(3), np.array((0, 0, arm.d[0] / 2)), THICKNESS[arm.name][0] * 1.2, "arm"))
    ET.SubElement(root, "link", name="base")
    root.append(joint("base_turn", "fixed", "base_link", "base", origin(rpy=(0, 0, pi))))
    for i in range(6):
        root.append(arm_link(arm, i))
        root.append(arm_joint(arm, i))
    ET.SubElement(root, "link", name="tool0")
    root.append(joint("flange", "fixed", LINK_NAMES[5], "tool0", origin((0, 0, arm.d[5]))))
    root.extend(hand_and_tool(hand, tool))
    ET.indent(root)
    head = '<?xml version="1.0"?>\n<!-- SPDX-License-Identifier: Apache-2.0 -->\n'
    return head + ET.tostring(root, encoding="unicode") + "\n"


def texts() -> dict[str, str]:
    """File name and content of every URDF."""
    return {f"{name}.urdf": robot(arm, Hand(), Tool()) for name, arm in MODELS.items()}


if __name__ == "__main__":
    for file, text in texts().items():
        (Path(__file__).parent / file).write_text(text, encoding="utf-8")

# SPDX-License-Identifier: Apache-2.0
"""`link_frames`: the frames of the arm's links on /tf and its URDF on robot_description, from joint_states.

What robot_state_publisher does, for machines that do not have it, without the frames that arm, estimator and controller
publish themselves: `tool0` stays a child of `base`, and what hangs on it stays where they put it.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from ament_index_python.packages import get_package_share_directory
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from seed_core.config import field
from seed_core.errors import SeedError
from seed_core.spatial import Array, make_pose, pose_from_rpy, so3_exp
from seed_ros import LATCHED, QUEUE, FixedRateLoop, SeedNode, TransformBroadcaster, diagnostics
from seed_ros.conversions import seconds, transform_stamped
from seed_ur.models import MODELS

LONGEST = 1.0  # [s] without joint_states
OTHERS = ("tool0", "compliance", "tool", "tip")  # frames that arm, estimator and controller publish
MOST = 1000.0  # [rad] no joint turns further; not a number is no angle either


@dataclass(frozen=True)
class LinkSettings:
    """Parameters of the node."""

    model: str = field("ur5e", choices=tuple(MODELS), doc="arm")
    urdf: str = field("", doc="file in place of the suite's own for that arm")
    rate: float = field(20.0, unit="Hz", low=1.0, high=200.0, doc="of the links' frames")


class Joint(NamedTuple):
    """A joint of a URDF: child in parent is X exp(axis q)."""

    name: str
    moves: bool
    parent: str
    child: str
    X: Array
    axis: Array

    def pose(self, q: float) -> Array:
        """(4, 4) of the child in the parent at joint angle q [rad]."""
        return self.X @ make_pose(so3_exp(self.axis * q), np.zeros(3))


def joints_of(file: Path) -> list[Joint]:
    """Joints whose child no one else publishes. Raises SeedError: no URDF, or joints neither fixed nor turning."""
    try:
        found = ET.parse(file).getroot().findall("joint")
        return [_joint(j) for j in found if _link(j, "child") not in OTHERS]
    except (OSError, ET.ParseError, ValueError, AttributeError) as error:
        raise SeedError(f"{file} cannot be read as a URDF: {error}") from error


def _link(joint: ET.Element, which: str) -> str:
    return str(joint.find(which).get("link"))  # type: ignore[union-attr]


def _joint(joint: ET.Element) -> Joint:
    kind, origin, axis = joint.get("type"), joint.find("origin"), joint.find("axis")
    if kind not in ("fixed", "revolute", "continuous"):
        raise ValueError(f"joint {joint.get('name')} is of type {kind}; fixed, revolute and continuous are known")
    at = {} if origin is None else origin.attrib
    X = pose_from_rpy(_three(at.get("rpy", "0 0 0")), _three(at.get("xyz", "0 0 0")))
    along = _three("1 0 0" if axis is None else axis.get("xyz", "1 0 0"))
    return Joint(str(joint.get("name")), kind != "fixed", _link(joint, "parent"), _link(joint, "child"), X, along)


def _three(text: str) -> Array:
    x, y, z = (float(v) for v in text.split())
    return np.array((x, y, z))


class LinkFramesNode(SeedNode):
    """See docs/interfaces.md."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("link_frames", **arguments)
        settings = self.declare(LinkSettings())
        self.refuse_unknown()

        package = Path(get_package_share_directory("seed_bringup"))
        file = Path(settings.urdf or package / "urdf" / f"{settings.model}.urdf")
        self.joints = joints_of(file)

        description = self.create_publisher(String, "robot_description", LATCHED)
        description.publish(String(data=file.read_text(encoding="utf-8")))
        self._transforms = TransformBroadcaster(self)
        now, fixed = self.now(), [j for j in self.joints if not j.moves]
        self._transforms.send_static(*(transform_stamped(j.X, now, j.parent, j.child) for j in fixed))
        self._moving = {j.name: j for j in self.joints if j.moves}
        self._angles: dict[str, tuple[float, float]] = {}  # [rad] and stamp [s], by joint, since the last tick
        self._heard = -LONGEST  # [s] by the machine's clock
        self._others: Sequence[str] = ()  # joints of the newest message that had none of the arm's
        self.loop = FixedRateLoop(self, settings.rate, self._tick)
        # A gripper may tell its joints on the same topic: with a queue of one its messages displaced the arm's.
        self.loop.poll(JointState, "joint_states", self._on_joints, QUEUE)
        self.diagnose(settings.model, self._report)

    def _on_joints(self, message: JointState) -> None:
        t = seconds(message.header.stamp)
        named = zip(message.name, message.position, strict=False)
        here = {name: (q, t) for name, q in named if name in self._moving and abs(q) < MOST}
        self._angles |= here
        self._others = self._others if here else message.name

    def _tick(self) -> None:
        if not self._angles:
            return
        self._heard, self._others = time.monotonic(), ()
        self.beats.add(self.now() - max(t for _, t in self._angles.values()))
        joints = ((self._moving[name], q, t) for name, (q, t) in self._angles.items())
        self._transforms.send(*(transform_stamped(j.pose(q), t, j.parent, j.child) for j, q, t in joints))
        self._angles = {}

    def _report(self) -> diagnostics.Report:
        if time.monotonic() - self._heard <= LONGEST:
            return diagnostics.OK, "drawing the links", {}
        what = "no joint_states"
        if self._others:
            what = f"joint_states has no angle of {', '.join(self._moving)}; it has {', '.join(self._others)}"
        return diagnostics.STALE, f"{what}: the links are not drawn where they are", {}


main = LinkFramesNode.main

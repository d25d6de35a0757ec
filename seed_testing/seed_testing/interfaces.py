# SPDX-License-Identifier: Apache-2.0
"""The interfaces of the nodes as they are: for docs/interfaces.md and for the test that compares the two."""

import re
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rclpy.action import get_action_client_names_and_types_by_node, get_action_server_names_and_types_by_node
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node

from seed_bringup.page.ros.node import PageNode
from seed_bringup.ros.link_frames import LinkFramesNode
from seed_control.ros.node import ControllerNode
from seed_core.hand import DEFAULT_STIFFNESS, Hand
from seed_core.stiffness_file import IdentifiedGrip, StiffnessFile, save_stiffness
from seed_driver.gripper import GripperActionConfig
from seed_driver.ros.gripper_action import GripperActionNode
from seed_driver.ros.node import DriverNode
from seed_driver.ros.target_guard import GuardNode
from seed_estimation.ros.cameras import CamerasNode
from seed_estimation.ros.node import EstimatorNode
from seed_ros import FixedRateLoop, SeedNode
from seed_ros.testing import Bench
from seed_sim.ros.identification_cell import CellNode
from seed_sim.ros.node import SimNode
from seed_sim.ros.tactile_cameras import TactileCamerasNode
from seed_sysid.ros.node import SysidNode

HAS_CONTROL_MSGS = find_spec("control_msgs") is not None  # it is not among the wheels


class GripperParameters(SeedNode):
    """The parameters of `gripper_action`, where that node cannot run."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("gripper_action", **arguments)
        self.declare(GripperActionConfig())
        self.refuse_unknown()
        self.loop = FixedRateLoop(self, 1.0, lambda: None)


def identified(folder: Path) -> str:
    """A file of an identification, in this folder."""
    k, file = DEFAULT_STIFFNESS, folder / "stiffness.yaml"
    save_stiffness(
        file,
        StiffnessFile(Hand().name, "tool", "2026-01-31", (IdentifiedGrip(1020.0, 0.05, k.rotation, k.translation),)),
    )
    return str(file)


# Each node, and the parameters with which it offers everything it can; a function makes a file in a folder.
NODES: dict[str, tuple[Any, dict[str, Any]]] = {
    "estimator": (EstimatorNode, {}),
    "cameras": (CamerasNode, {}),
    "controller": (ControllerNode, {"grip__file": identified}),
    "driver": (DriverNode, {"robot_ip": "127.0.0.254"}),  # nobody is there; what it offers does not depend on that
    "guard": (GuardNode, {}),
    "gripper_action": (GripperActionNode if HAS_CONTROL_MSGS else GripperParameters, {}),
    "sim": (SimNode, {"relative_pose": True}),
    "bubbles": (TactileCamerasNode, {}),
    "sysid": (SysidNode, {}),
    "identification_cell": (CellNode, {}),
    "link_frames": (LinkFramesNode, {}),
    "page": (PageNode, {"port": 0}),
}
# What each of them does, in a line.
DOES = {
    "estimator": "turns the images of the bubbles into the pose of the tool in the grasp",
    "cameras": "reads two RealSense D405",
    "controller": "turns a task or set-points into targets for the arm; plays tasks; holds",
    "driver": "makes a UR arm follow the targets",
    "guard": "limits and checks targets in front of an arm that obeys everything",
    "gripper_action": "makes a gripper's action server the gripper of a cell",
    "sim": "simulates arm, grasp, tool and table",
    "bubbles": "renders the cameras' images for the simulation",
    "sysid": "identifies the stiffness of a grasp",
    "identification_cell": "simulates a cell with a fixed force/torque sensor, for the identification",
    "link_frames": "publishes the arm's links for viewers",
    "page": "serves the operator page",
}
FIRST = "## In short\n"
HEADING = "## Parameters\n"
IN_SHORT = """\
Each part of a cell is a ROS 2 node. A node listens to topics, publishes topics, and offers services and actions.
Parameters set it up. This page lists them all; a test compares it with the running nodes. To look at a live cell:
`./seed watch controller/state`. To call a service: `./seed call controller/enable on`.

| node | does | topics, services, actions | parameters |
|---|---|---|---|
"""
COMMON = ("/parameter_events", "/rosout", "/clock")  # every ROS node has these
COMMON_TYPES = ("rcl_interfaces", "type_description", "lifecycle_msgs")
Entry = tuple[str, str, str]  # what, name, type


@contextmanager
def alive(name: str, **given: Any) -> Iterator[Node]:
    """A node of NODES with these parameters, configured and active if it has a lifecycle and may be."""
    with closing(Bench()) as bench, TemporaryDirectory() as folder:
        made = {key: value(Path(folder)) if callable(value) else value for key, value in given.items()}
        node = bench.add(NODES[name][0], **made)
        if given and isinstance(node, LifecycleNode):
            node.trigger_configure()
            node.trigger_activate()
        yield node


def entries_of(node: Node) -> set[Entry]:
    """Topics, services and actions of a node, and services and actions that it calls, named relative to it."""
    ends = [("out", p.topic_name, p.msg_type) for p in node.publishers]
    ends += [("in", s.topic_name, s.msg_type) for s in node.subscriptions]
    ends += [("service", s.srv_name, s.srv_type) for s in node.services]
    ends += [("calls", c.service_name.lstrip("/"), c.srv_type) for c in node.clients]
    found = {(what, _name(node, name), _type(kind)) for what, name, kind in ends}
    found = {e for e in found if e[1] not in COMMON and not e[2].startswith(COMMON_TYPES)}
    where = node, node.get_name(), node.get_namespace()
    for what, actions in (
        ("action", get_action_server_names_and_types_by_node(*where)),
        ("calls", get_action_client_names_and_types_by_node(*where)),
    ):
        found |= {(what, _name(node, action), kinds[0]) for action, kinds in actions}
    return found


def _name(node: Node, name: str) -> str:
    own = f"/{node.get_name()}/"
    if name.startswith(own):
        return f"~/{name.removeprefix(own)}"
    return name if name in ("/tf", "/tf_static", "/diagnostics", *COMMON) else name.removeprefix("/")


def _type(kind: Any) -> str:
    package, what, _ = kind.__module__.split(".", 2)
    return f"{package}/{what}/{kind.__name__}"


def parameters_of(node: Node) -> list[str]:
    """One table row per parameter."""
    rows = []
    for name, parameter in sorted(node.get_parameters_by_prefix("").items()):
        if name in ("use_sim_time", "start_type_description_service"):
            continue
        described = node.describe_parameter(name)
        value = list(parameter.value) if hasattr(parameter.value, "typecode") else parameter.value
        words = " ".join(w for w in (described.description, described.additional_constraints) if w)
        rows.append(f"| `{name}` | {value if value != '' else '(empty)'} | {words.replace('|', '/')} |")
    return rows


def parameter_section() -> str:
    """The tables of all nodes."""
    parts = []
    for name in NODES:
        with alive(name) as node:
            head = [f"### {name}", "| parameter | default | meaning |", "|---|---|---|"]
            parts.append("\n".join(head + parameters_of(node)))
    return "\n\n".join(parts) + "\n"


def first_section(document: str) -> str:
    """What the page is, and a row per node with links to its sections in this document."""
    packages = dict(re.findall(r"^## (\w+) \((seed_\w+)\)$", document, re.MULTILINE))
    rows = [
        f"| `{name}` | {DOES[name]} | [{packages[name]}](#{name}-{packages[name]}) | [parameters](#{name}) |"
        for name in NODES
    ]
    return IN_SHORT + "\n".join(rows) + "\n"


def with_first_section(document: str) -> str:
    """The document with that section in place of the one that it has."""
    head, _, rest = document.partition(FIRST)
    return f"{head}{FIRST}{first_section(document)}\n## {rest.split(chr(10) + '## ', 1)[1]}"


def main() -> int:
    """Write the table of nodes and the parameters into the file given."""
    file = Path(sys.argv[1])
    head, _, rest = with_first_section(file.read_text(encoding="utf-8")).partition(HEADING)
    words = rest.split("\n### ", 1)[0].rstrip("\n")
    file.write_text(f"{head}{HEADING}{words}\n\n{parameter_section()}", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

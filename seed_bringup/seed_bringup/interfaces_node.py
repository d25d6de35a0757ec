# SPDX-License-Identifier: Apache-2.0
"""The interfaces of the nodes as they are: for docs/interfaces.md and for the test that compares the two."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from rclpy.node import Node

from seed_control.node import ControllerNode
from seed_estimation.node import EstimatorNode
from seed_ros.testing import Bench
from seed_sim.bubbles_node import BubblesNode
from seed_sim.node import SimNode

NODES: dict[str, tuple[Any, dict[str, Any]]] = {
    "estimator": (EstimatorNode, {}),
    "controller": (ControllerNode, {}),
    "sim": (SimNode, {"relative_pose": True}),
    "bubbles": (BubblesNode, {}),
}
HEADING = "## Parameters\n"
COMMON = ("/parameter_events", "/rosout", "/clock")  # every ROS node has these
Entry = tuple[str, str, str]  # what, name, type


def entries_of(node: Node) -> set[Entry]:
    """Topics, services and actions of a node, named relative to it."""
    found = {("out", _name(node, p.topic_name), _type(p.msg_type)) for p in node.publishers}
    found |= {("in", _name(node, s.topic_name), _type(s.msg_type)) for s in node.subscriptions}
    found |= {("service", _name(node, s.srv_name), _type(s.srv_type)) for s in node.services}
    found = {e for e in found if e[1] not in COMMON and not e[2].startswith(("rcl_interfaces", "type_description"))}
    follow = getattr(node, "follow", None)
    return found | ({("action", "~/follow_setpoints", "seed_msgs/action/FollowSetpoints")} if follow else set())


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
    bench = Bench()
    try:
        parts = []
        for name, (kind, given) in NODES.items():
            rows = parameters_of(bench.add(kind) if name == "sim" else bench.add(kind, **given))
            parts.append("\n".join([f"### {name}", "| parameter | default | meaning |", "|---|---|---|", *rows]))
        return "\n\n".join(parts) + "\n"
    finally:
        bench.close()


def main() -> int:
    """Write the parameters into the file given."""
    file = Path(sys.argv[1])
    head, _, rest = file.read_text(encoding="utf-8").partition(HEADING)
    words = rest.split("\n### ", 1)[0].rstrip("\n")
    file.write_text(f"{head}{HEADING}{words}\n\n{parameter_section()}", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

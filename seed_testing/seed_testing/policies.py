# SPDX-License-Identifier: Apache-2.0
"""The policy of SROS 2 for a cell, from the documented interfaces: no node may do more than its table says.

python -m seed_testing.policies docs/interfaces.md seed_bringup/config/access/cell.policy.xml
"""

import re
import sys
from pathlib import Path
from xml.etree import ElementTree

ROW = re.compile(r"^\| (in|out|service|calls|action) \| `([^`]+)` \| (\S+) \| .+ \|$", re.MULTILINE)
SECTION = re.compile(r"^## (\w+) \(seed_\w+\)\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
ARMS = ("driver", "guard", "sim")  # whose reason to hold a controller listens to, by a remapping of the launch files
PARAMETERS = ("describe_parameters", "get_parameter_types", "get_parameters", "list_parameters")
SETTING = ("set_parameters", "set_parameters_atomically")
LIFECYCLE = ("change_state", "get_state", "get_available_states", "get_available_transitions", "get_transition_graph")
SETPOINTS = ("operator", "setpoint", "wrench_setpoint", "relative_pose_setpoint")  # of the controller
Rights = dict[tuple[str, str, str], set[str]]  # (tag, right, tag of one): names


def rights_of_nodes(document: str) -> dict[str, Rights]:
    """Of each node of the document."""
    found = {}
    for node, text in SECTION.findall(document):
        rights: Rights = {}

        def add(tag: str, right: str, name: str, into: Rights = rights) -> None:
            into.setdefault((tag, right, tag[:-1]), set()).add(name)

        for what, name, kind in ROW.findall(text):
            tag, right = (
                ("actions", "call")
                if what == "calls" and "/action/" in kind
                else {
                    "in": ("topics", "subscribe"),
                    "out": ("topics", "publish"),
                    "service": ("services", "reply"),
                    "calls": ("services", "request"),
                    "action": ("actions", "execute"),
                }[what]
            )
            for absolute in _absolute(node, name):
                add(tag, right, absolute)
        for name in ("/rosout", "/parameter_events"):
            add("topics", "publish", name)
        for name in ("/clock", "/parameter_events"):
            add("topics", "subscribe", name)
        if node == "controller":
            for name in ("command", "force_command"):  # one of them, with its parameter `grip_answer.command`
                add("topics", "publish", f"/gripper/{name}")
        if node == "sim":
            add("topics", "publish", "/clock")  # with its parameter `clock`, for which it also listens to
            add("topics", "subscribe", "/relative_pose")
        for name in (*PARAMETERS, *SETTING, "get_type_description", *(LIFECYCLE if node == "driver" else ())):
            add("services", "reply", f"/{node}/{name}")
        if node == "driver":
            add("topics", "publish", "/driver/transition_event")
        found[node] = rights
    return found


def _absolute(node: str, name: str) -> list[str]:
    if name == "arm_hold_reason":
        return [f"/{arm}/hold_reason" for arm in ARMS]
    if name == "arm_wrench":
        return ["/arm_wrench", "/wrench"]  # the UR's own, with arm_wrench:=wrench of the launch files
    return [f"/{node}/{name[2:]}" if name.startswith("~/") else f"/{name.lstrip('/')}"]


def policy(document: str) -> str:
    """The whole file: the nodes, an operator who calls and plays, as the page does, and a viewer who only listens."""
    nodes = rights_of_nodes(document)
    told, called, played = (
        {n for rights in nodes.values() for n in rights.get(key, ())}
        for key in (
            ("topics", "publish", "topic"),
            ("services", "reply", "service"),
            ("actions", "execute", "action"),
        )
    )
    own: Rights = {
        ("topics", "publish", "topic"): {"/rosout", "/parameter_events"},
        ("topics", "subscribe", "topic"): told,
    }
    nodes["viewer"] = own
    settings = {n for n in called if n.rpartition("/")[2] in (*SETTING, "change_state")}
    nodes["operator"] = own | {
        ("topics", "publish", "topic"): own["topics", "publish", "topic"] | {f"/controller/{n}" for n in SETPOINTS},
        ("services", "request", "service"): called - settings,
        ("actions", "call", "action"): played,
    }
    page = nodes["page"]  # an operator who sends no set-points
    page["topics", "publish", "topic"] |= {"/controller/operator"}
    page["topics", "subscribe", "topic"] |= told
    page["services", "request", "service"] = called - settings
    page["actions", "call", "action"] = played
    root = ElementTree.Element("policy", {"version": "0.2.0"})
    enclaves = ElementTree.SubElement(root, "enclaves")
    for node, rights in nodes.items():
        enclave = ElementTree.SubElement(enclaves, "enclave", {"path": f"/{node}"})
        profiles = ElementTree.SubElement(enclave, "profiles")
        profile = ElementTree.SubElement(profiles, "profile", {"ns": "/", "node": node})
        for (tag, right, one), names in sorted(rights.items()):
            group = ElementTree.SubElement(profile, tag, {right: "ALLOW"})
            for name in sorted(names):
                ElementTree.SubElement(group, one).text = name
    ElementTree.indent(root)
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<!-- SPDX-License-Identifier: Apache-2.0 -->\n'
    made = "<!-- Made of docs/interfaces.md by python -m seed_testing.policies; a test compares the two. -->\n"
    return f"{head}{made}{ElementTree.tostring(root, encoding='unicode')}\n"


def main() -> int:
    """Write the policy of the first file into the second."""
    Path(sys.argv[2]).write_text(policy(Path(sys.argv[1]).read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

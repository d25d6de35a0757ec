# SPDX-License-Identifier: Apache-2.0
"""docs/interfaces.md says what the running nodes offer: nothing more, nothing less."""

import re
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("pydrake", reason="needs Drake")

from seed_testing.interfaces import HAS_CONTROL_MSGS, NODES, alive, entries_of, parameters_of, with_first_section

pytestmark = pytest.mark.ros
DOCUMENT = Path(__file__).parents[2] / "docs" / "interfaces.md"
ROW = re.compile(r"^\| (in|out|service|calls|action) \| `([^`]+)` \| (\S+) \| .+ \|$", re.MULTILINE)

RUNS = [name for name in NODES if name != "gripper_action" or HAS_CONTROL_MSGS]


def section(name: str, level: str) -> str:
    text = DOCUMENT.read_text(encoding="utf-8")
    found = re.search(rf"^{level} {name}\b.*?\n(.*?)(?=^##|\Z)", text, re.MULTILINE | re.DOTALL)
    assert found, f"{DOCUMENT.name} has no section {level} {name}"
    return found.group(1)


@pytest.mark.parametrize("name", RUNS)
def test_topics_services_and_actions_are_those_of_the_document(name: str) -> None:
    with alive(name, **NODES[name][1]) as node:
        there = entries_of(node)
    assert there == set(ROW.findall(section(name, "##")))


@pytest.mark.parametrize("name", RUNS)
def test_every_node_reports_on_its_health_by_one_convention(name: str) -> None:
    with alive(name, **NODES[name][1]) as node:
        health = node.outputs.diagnostics if name == "driver" else node._diagnostics
        status = health.status()
    values = {v.key: v.value for v in status.values}
    assert list(values)[:4] == ["rate_hz", "latency_ms", "lost", "reason"]
    assert status.message
    assert values["reason"] == ("" if status.level == status.OK else status.message)
    assert int(values["lost"]) >= 0


@pytest.mark.parametrize("name", NODES)
def test_the_loop_takes_every_message_as_it_comes(name: str) -> None:
    """An executor looks ten times a second: by then a message of a stream waits behind others, 0.4 s old."""
    with alive(name, **NODES[name][1]) as node:
        polled = {s.topic_name for s in node.loop.streams}
        heard = {s.topic_name for s in node.subscriptions} - {"/parameter_events"}
    assert heard - polled == set()


@pytest.mark.parametrize("name", NODES)
def test_parameters_are_those_of_the_document(name: str) -> None:
    with alive(name) as node:
        rows = parameters_of(node)
    written = re.findall(r"^\| `([^`]+)` \|", section(name, "###"), re.MULTILINE)
    there = [row.split("`")[1] for row in rows]
    assert written == there, "run: python -m seed_testing.interfaces docs/interfaces.md"


def test_the_table_at_the_top_is_that_of_the_nodes() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    assert with_first_section(text) == text, "run: python -m seed_testing.interfaces docs/interfaces.md"

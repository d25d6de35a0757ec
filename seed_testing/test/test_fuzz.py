# SPDX-License-Identifier: Apache-2.0
"""Nonsense in every topic, service, action, parameter and file: refused, and nothing else: the bench in short."""

from pathlib import Path
from random import Random
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("pydrake", reason="needs Drake")

from geometry_msgs.msg import PoseStamped

from seed_driver.ros.target_guard import GuardNode
from seed_testing.fuzz.files import fuzz_files, outcome
from seed_testing.fuzz.nonsense import message, reals, spoil
from seed_testing.fuzz.readers import READERS
from seed_testing.fuzz.run import Findings, fuzz
from seed_testing.fuzz.scenes import SCENES, GuardScene
from seed_testing.fuzz.wire import through_the_wire
from seed_testing.interfaces import NODES

pytestmark = pytest.mark.ros
INPUTS = {"controller": 500, "estimator": 100, "driver": 0}  # the driver's needs a stand-in controller: by the bench
SEED = 7


def told(found: Findings) -> str:
    return "\n".join(f"{f.words}\n{f.steps}\n{f.trace}" for f in found.failures.values())


def test_every_node_is_fuzzed() -> None:
    """But gripper_action, whose messages are single numbers: it needs control_msgs, which is not among the wheels."""
    assert set(SCENES) == set(NODES) - {"gripper_action"}


@pytest.mark.parametrize("name", [name for name in SCENES if INPUTS.get(name, 1)])
def test_a_node_bears_nonsense(name: str) -> None:
    found = fuzz(name, INPUTS.get(name, 180), SEED)
    assert not found.failures, told(found)
    assert not found.grows, f"{name} keeps {found.blocks} blocks, {found.megabytes:.1f} MB"


@pytest.mark.parametrize("name", ["controller", "sim"])
def test_a_node_bears_nonsense_through_the_middleware(name: str) -> None:
    found = through_the_wire(name, 60, SEED)
    assert not found.failures, told(found)


def test_files_are_read_or_refused_in_words() -> None:
    for name, found in fuzz_files(320, SEED).items():
        assert not found.failures, f"{name}: {told(found)}"


def test_the_good_files_are_good(tmp_path: Path) -> None:
    for reader in READERS():
        file = tmp_path / f"good{reader.suffix}"
        for example in reader.examples:
            file.write_bytes(example)
            assert reader.read(file) is not None
            assert outcome(reader, file) == ("", "")


def test_a_fault_is_found_and_shrunk_to_the_inputs_that_it_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A guard that fails at the second target that is not in its frame."""
    seen: list[bool] = []
    before = GuardNode._on_target

    def fails(node: Any, target: PoseStamped, information: Any) -> None:
        seen.append(target.header.frame_id != "base")
        if sum(seen) == 2:
            raise RuntimeError("twice elsewhere")
        before(node, target, information)

    monkeypatch.setattr(GuardNode, "_on_target", fails)

    def make(_: str) -> GuardScene:
        seen.clear()
        return GuardScene(GuardNode)

    failure = next(iter(fuzz("guard", 200, 1, make).failures.values()))
    assert "twice elsewhere" in failure.trace
    assert [step.name for step in failure.steps] == ["target_frame", "target_frame"]


def test_a_spoilt_message_stays_well_typed() -> None:
    rng = Random(3)
    for _ in range(200):
        made = message(rng, PoseStamped)
        spoil(rng, made)
        assert len(list(reals(made))) == 7

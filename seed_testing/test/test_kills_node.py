# SPDX-License-Identifier: Apache-2.0
"""A live cell whose controller is killed while it wipes: the arm is held, it is said why, nothing resumes by itself."""

from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("pydrake", reason="needs Drake")

from seed_testing.live.ros.fault_cell import FaultCell
from seed_testing.live.verdict import faults_of

pytestmark = [pytest.mark.ros, pytest.mark.realtime, pytest.mark.alone]


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[FaultCell]:
    cell = FaultCell("sim", "truth", tmp_path / "nodes.log").open()
    try:
        yield cell
    finally:
        cell.close()


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["kill", "stop 0.5 s"])
def test_a_controller_that_fails_while_wiping_leaves_an_arm_that_stands(cell: FaultCell, fault: str) -> None:
    row = cell.run("controller", fault, "wipe")
    assert not faults_of(row), row
    assert row["held_after_s"] is not None
    assert "target_frame" in row["state"]  # the arm says that nothing came

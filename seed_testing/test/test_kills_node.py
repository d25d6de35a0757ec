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
def cell(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[FaultCell]:
    cell = FaultCell(getattr(request, "param", "sim"), "truth", tmp_path / "nodes.log").open()
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


@pytest.mark.slow
@pytest.mark.parametrize("cell", ["ur"], indirect=True)
def test_a_stand_in_that_is_killed_while_wiping_is_joined_again(cell: FaultCell) -> None:
    row = cell.run("ur_controller", "kill", "wipe")
    assert not faults_of(row), row
    assert row["recovered"] is None  # the tool is on the table
    cell.session.until(lambda: cell.said["sim"][2].get("robot_clock_back") == "1", 30.0, "the plant has not joined it")
    cell.session.until(lambda: cell.said["driver"][2].get("linked") == "True", 30.0, "the driver has no link")

# SPDX-License-Identifier: Apache-2.0
"""A client of the cell against a controller of its action alone."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not there (./seed test has it)")

from rclpy.action import ActionServer
from seed_msgs.action import FollowSetpoints

from seed_bringup.ros.session import Session
from seed_control.tasks import load_task, read_task, shipped_tasks
from seed_ros.testing import Bench

pytestmark = pytest.mark.ros

ACTION = "controller/follow_setpoints"


@pytest.fixture
def session(bench: Bench) -> Iterator[Session]:
    """Turns the bench while it waits."""
    session = Session(bench.turn, follow=False)
    yield session
    session.close()


def test_a_task_is_sent_so_that_it_can_be_read_on_another_computer(
    bench: Bench, session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def play(goal: Any) -> Any:
        asked.append(goal.request.task)
        goal.succeed()
        return FollowSetpoints.Result(success=True)

    server = ActionServer(bench.client, FollowSetpoints, ACTION, play)
    squeegee = shipped_tasks()["squeegee"].read_text(encoding="utf-8")
    here, there = tmp_path / "here", tmp_path / "there"
    for folder in (here, there):
        folder.mkdir()
    (here / "mine.yaml").write_text(squeegee.replace("name: squeegee", "name: mine"))
    (here / "pen").write_text(squeegee)
    monkeypatch.chdir(here)
    for task in ("mine.yaml", "pen"):
        assert session.play(task, None, lambda _: None, 20.0).result.success
    server.destroy()
    mine = load_task("mine.yaml")
    assert mine.name == "mine"
    monkeypatch.chdir(there)
    (here / "mine.yaml").unlink()
    assert [read_task(text) for text in asked] == [mine, load_task("pen")]

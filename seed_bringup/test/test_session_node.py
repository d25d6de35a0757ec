# SPDX-License-Identifier: Apache-2.0
"""A client of the cell against a controller of its action alone."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not there (./seed test has it)")

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from seed_msgs.action import FollowSetpoints

from seed_bringup.ros.session import Session, SessionError, SilenceError
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


class Playing:
    """A controller that plays one task until it is told to end, and tells nothing of its own accord."""

    def __init__(self, bench: Bench) -> None:
        self._bench, self._end, self.begun = bench, Future(), False
        self.goal: Any = None
        self._server = ActionServer(bench.client, FollowSetpoints, ACTION, self._play)

    async def _play(self, goal: Any) -> Any:
        self.begun, self.goal = True, goal
        await self._end
        goal.succeed()
        return FollowSetpoints.Result(success=True)

    def end(self) -> None:
        if not self._end.done():
            self._end.set_result(None)

    def die(self) -> None:
        self._server.destroy()


def test_play_ends_soon_after_the_cell(bench: Bench, session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seed_bringup.ros.played_goal.GONE", 0.5)
    controller, dead = Playing(bench), list[float]()

    def die() -> None:
        if controller.begun and not dead:
            controller.die()
            dead.append(time.monotonic())

    bench.every.append(die)
    with pytest.raises(SessionError, match="the controller has been gone for"):
        session.play("squeegee", None, lambda _: None, 20.0)
    assert time.monotonic() - dead[0] < 5.0
    began = time.monotonic()
    session.cancel()
    assert time.monotonic() - began < 0.5  # there is nothing to wait for


def test_a_cancel_ends_with_the_controller(bench: Bench, session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seed_bringup.ros.played_goal.GONE", 0.5)
    controller = Playing(bench)

    def die_and_interrupt() -> None:
        bench.turn()
        if session._goal is not None:
            session.watch = bench.turn
            controller.die()
            raise KeyboardInterrupt

    session.watch = die_and_interrupt
    began = time.monotonic()
    with pytest.raises(SessionError, match="the controller has been gone for"):
        session.play("squeegee", None, lambda _: None, 20.0)
    assert time.monotonic() - began < 10.0


def test_a_goal_that_is_interrupted_on_its_way_is_cancelled(bench: Bench, session: Session) -> None:
    """It is accepted all the same, and nobody would see to its task."""
    end, asked, cancelled = Future(), list[Any](), list[Any]()

    def accept(request: Any) -> GoalResponse:
        asked.append(request)
        return GoalResponse.ACCEPT

    def cancel(goal: Any) -> CancelResponse:
        cancelled.append(goal)
        end.set_result(None)
        return CancelResponse.ACCEPT

    async def play(goal: Any) -> Any:
        await end
        goal.canceled()
        return FollowSetpoints.Result(message="cancelled")

    def interrupt() -> None:
        bench.turn()
        if asked:
            session.watch = bench.turn
            raise KeyboardInterrupt

    server = ActionServer(bench.client, FollowSetpoints, ACTION, play, goal_callback=accept, cancel_callback=cancel)
    session.watch = interrupt
    with pytest.raises(KeyboardInterrupt):
        session.play("squeegee", None, lambda _: None, 20.0)
    assert cancelled
    assert session.played.result.message == "cancelled"
    server.destroy()


def test_play_ends_where_another_controller_has_taken_the_place_of_one_that_was_killed(
    bench: Bench, session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("seed_bringup.ros.played_goal.GONE", 1e9)  # there is no gap
    monkeypatch.setattr("seed_bringup.ros.played_goal.QUIET", 0.5)
    first, second = Playing(bench), list[ActionServer]()
    node, executor = Node("controller", context=bench.context), SingleThreadedExecutor(context=bench.context)
    executor.add_node(node)

    def replace() -> None:
        executor.spin_once(timeout_sec=0.0)
        if not first.begun:
            return
        if not second:
            second.append(ActionServer(node, FollowSetpoints, ACTION, lambda _: FollowSetpoints.Result()))
        elif session.node.count_services(f"/{ACTION}/_action/get_result") == 2:
            first.die()

    bench.every.append(replace)
    with pytest.raises(SessionError, match="the controller was started anew, and does not know the task"):
        session.play("squeegee", None, lambda _: None, 20.0)
    second[0].destroy()
    node.destroy_node()


def test_a_controller_that_is_silent_plays_on(bench: Bench, session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seed_bringup.ros.played_goal.QUIET", 0.1)
    controller, began = Playing(bench), list[float]()

    def end_late() -> None:
        if controller.begun and not began:
            began.append(time.monotonic())
        if began and time.monotonic() - began[0] > 2.0:
            controller.end()

    bench.every.append(end_late)
    assert session.play("squeegee", None, lambda _: None, 20.0).result.success


def telling(bench: Bench, progress: Callable[[float], float]) -> None:
    """A task that takes 2.5 s, and tells a progress by its time [s]."""
    controller, began = Playing(bench), list[float]()

    def tell() -> None:
        if controller.begun:
            began.append(time.monotonic())
            t = began[-1] - began[0]
            controller.goal.publish_feedback(FollowSetpoints.Feedback(phase="wipe", progress=progress(t)))
            if t > 2.5:
                controller.end()
                bench.every.remove(tell)

    bench.every.append(tell)


def test_a_task_is_waited_for_as_long_as_it_makes_progress(bench: Bench, session: Session) -> None:
    telling(bench, lambda t: t / 2.5)
    assert session.play("squeegee", None, lambda _: None, 1.0).result.success


def test_a_task_that_stands_still_is_given_up(bench: Bench, session: Session) -> None:
    telling(bench, lambda _: 0.4)
    with pytest.raises(SilenceError, match="the task 'squeegee' made no progress for 1 s"):
        session.play("squeegee", None, lambda _: None, 1.0)

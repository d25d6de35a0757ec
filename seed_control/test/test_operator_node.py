# SPDX-License-Identifier: Apache-2.0
"""What stands around a task: an arm that holds, an operator that goes, another tool in the hand, too much asked."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.action import ActionClient
from rclpy.node import Node
from seed_msgs.action import FollowSetpoints
from seed_msgs.msg import RelativePose
from sensor_msgs.msg import TimeReference
from std_msgs.msg import String
from std_srvs.srv import SetBool
from test_control_node import FREE, Cell
from unique_identifier_msgs.msg import UUID

from seed_control.ros import readiness
from seed_core.config import ConfigError
from seed_ros.conversions import stamp_from_seconds
from seed_ros.qos import COMMAND, LATCHED
from seed_ros.testing import Bench

pytestmark = pytest.mark.ros
LIFTED = 0.04  # [m], of the task's lift of 0.05


@pytest.fixture
def make() -> Iterator[Callable[..., Cell]]:
    bench = Bench()
    try:
        yield lambda **parameters: Cell(bench, **parameters)
    finally:
        bench.close()


def enable(cell: Cell) -> Any:
    return cell.bench.call(SetBool, "controller/enable", SetBool.Request(data=True))


def test_an_arm_that_holds_refuses_enable_and_play_at_once_and_stops_a_controller_that_moves(
    make: Callable[..., Cell],
) -> None:
    cell = make()
    arm = cell.bench.client.create_publisher(String, "arm_hold_reason", LATCHED)
    cell.enabled()
    handle = cell.play(FREE)
    assert cell.bench.until(lambda: cell.state.mode == "position")
    arm.publish(String(data="protective stop"))
    assert cell.bench.until(lambda: cell.state.mode == "holding", 5.0)
    assert "the arm holds: protective stop" in cell.state.reason
    assert "the arm holds: protective stop" in cell.bench.result(handle).result.message
    refused = enable(cell)
    assert not refused.success
    assert "cannot enable: the arm holds: protective stop" in refused.message
    began = time.monotonic()
    assert "the arm holds: protective stop" in cell.bench.result(cell.play(FREE)).result.message
    assert time.monotonic() - began < 2.0
    arm.publish(String(data=""))
    cell.bench.spin(0.2)
    assert cell.state.mode == "holding"  # nothing starts by itself
    assert enable(cell).success


def test_an_arm_that_is_resumed_hears_no_target_before_enable(make: Callable[..., Cell]) -> None:
    """It would count the silence from there on, and hold again before a person has typed the second command."""
    cell = make()
    arm = cell.bench.client.create_publisher(String, "arm_hold_reason", LATCHED)
    cell.enabled()
    assert cell.bench.until(lambda: cell.targets > 3, 5.0)
    arm.publish(String(data="no target_frame for 0.1 s"))
    assert cell.bench.until(lambda: "the arm holds" in cell.state.reason, 5.0)
    arm.publish(String(data=""))  # resumed
    cell.bench.spin(0.2)
    cell.targets = 0
    cell.bench.spin(0.5)
    assert cell.targets == 0
    assert enable(cell).success
    assert cell.bench.until(lambda: cell.targets > 3, 5.0)


def test_a_holding_arm_that_was_moved_is_not_sent_back_when_it_follows_again(make: Callable[..., Cell]) -> None:
    cell = make()
    arm = cell.bench.client.create_publisher(String, "arm_hold_reason", LATCHED)
    cell.enabled()
    cell.setpoint.publish(cell.hold_here())
    assert cell.bench.until(lambda: cell.state.mode == "position")
    cell.follows = False
    arm.publish(String(data="it was put elsewhere"))
    there = cell.X_WE.copy()
    there[2, 3] += 0.03
    cell.X_WE = there
    assert cell.bench.until(lambda: "it was put elsewhere" in cell.state.reason, 5.0)
    arm.publish(String(data=""))  # it was asked to follow again; the controller was not
    cell.bench.spin(0.2)
    cell.follows, cell.targets = True, 0
    cell.bench.spin(0.3)
    assert cell.targets == 0
    assert enable(cell).success
    assert cell.bench.until(lambda: cell.targets > 3, 5.0)
    np.testing.assert_allclose(cell.X_WE, there, atol=1e-6)


def test_an_arm_that_was_gone_and_is_back_elsewhere_is_sent_nowhere(make: Callable[..., Cell]) -> None:
    """Started anew, it follows targets at once; nearer than what counts as a jump, it would go to the former place."""
    cell = make()
    cell.enabled()
    cell.setpoint.publish(cell.hold_here())
    assert cell.bench.until(lambda: cell.state.mode == "position")
    cell.follows = False
    cell.silent.add("current_pose")
    assert cell.bench.until(lambda: cell.state.mode == "holding")
    assert cell.bench.until(lambda: cell.node.counters["moved_by_others"] == 1, 5.0)
    there = cell.X_WE.copy()
    there[2, 3] += 0.015
    cell.X_WE, cell.follows, cell.targets = there, True, 0
    cell.silent.clear()
    cell.bench.spin(0.4)
    assert cell.targets == 0
    assert enable(cell).success
    assert cell.bench.until(lambda: cell.targets > 3, 5.0)


def test_enabling_while_enabled_takes_the_arm_from_where_it_is(make: Callable[..., Cell]) -> None:
    cell = make()
    cell.enabled()
    cell.setpoint.publish(cell.hold_here())
    assert cell.bench.until(lambda: cell.state.mode == "position")
    assert enable(cell).success
    cell.bench.spin(0.1)
    assert cell.state.mode == "position"  # an arm that follows: nothing changes
    cell.targets = 0
    there = cell.X_WE.copy()
    there[0, 3] += 0.05
    cell.node._target.publish = lambda _: None  # type: ignore[method-assign]  # the arm is moved by hand meanwhile
    cell.X_WE = there
    cell.bench.spin(0.2)
    assert enable(cell).success
    cell.bench.spin(0.1)
    assert cell.state.mode == "idle"
    np.testing.assert_allclose(cell.node.core.step(cell.node.now()).X_WE, there, atol=1e-3)


@pytest.mark.parametrize("way", ["lift", "hold"])
def test_a_task_ends_half_a_second_after_its_operator_fell_silent(make: Callable[..., Cell], way: str) -> None:
    cell = make(operator_lost=way)
    cell.enabled()
    handle = cell.play(FREE)
    here = cell.bench.client.create_publisher(UUID, "controller/operator", COMMAND)
    beat = cell.bench.client.create_timer(0.1, lambda: here.publish(handle.goal_id))
    assert cell.bench.until(lambda: cell.state.tip.position.x > 0.455)
    cell.bench.spin(1.0)
    assert cell.node.follow.busy
    height = cell.state.tip.position.z
    beat.cancel()
    began = time.monotonic()
    ends: Callable[[], bool] = {
        "hold": lambda: cell.state.mode == "holding",
        "lift": lambda: cell.state.tip.position.z > height + 0.001,
    }[way]
    assert cell.bench.until(ends, 5.0)
    assert time.monotonic() - began < 1.0  # 0.4 s, on a busy test machine
    assert "the operator is gone: not heard for" in cell.bench.result(handle).result.message
    assert (cell.state.tip.position.z - height > LIFTED) is (way == "lift")


def test_a_task_ends_when_nobody_listens_to_it_any_more(make: Callable[..., Cell]) -> None:
    """Of a client that knows nothing of ~/operator, such as ros2 action send_goal."""
    cell = make()
    cell.enabled()
    heard = "/controller/follow_setpoints/_action/feedback"
    assert cell.bench.until(lambda: not cell.node.count_subscribers(heard))  # those of the tests before are gone
    cell.play(FREE)
    assert cell.bench.until(lambda: cell.state.tip.position.x > 0.455)
    cell.bench.spin(1.0)
    assert cell.node.follow.busy
    assert cell.node.count_subscribers(heard) == 1
    cell.bench.destroy_action_clients()
    assert cell.bench.until(lambda: not cell.node.follow.busy, 10.0)
    assert cell.bench.until(lambda: cell.state.tip.position.z > 0.13)


def test_an_operator_page_that_is_open_does_not_listen_for_another(make: Callable[..., Cell]) -> None:
    cell = make()
    cell.enabled()
    page = Node("page_hands", context=cell.bench.client.context)
    try:
        action = ActionClient(page, FollowSetpoints, "controller/follow_setpoints")
        page.create_publisher(UUID, "controller/operator", COMMAND)
        cell.play(FREE)
        assert cell.bench.until(lambda: cell.state.tip.position.x > 0.455)
        assert cell.node.follow.busy
        cell.bench.destroy_action_clients()
        assert cell.bench.until(lambda: not cell.node.follow.busy, 10.0)
        action.destroy()
    finally:
        page.destroy_node()


def test_an_operator_that_must_be_heard_and_says_nothing_is_gone(make: Callable[..., Cell]) -> None:
    """It listens to the feedback as long as the middleware believes it to be alive."""
    cell = make(operator_beats=True)
    cell.enabled()
    silent = cell.play(FREE)
    assert "it never said on /controller/operator" in cell.bench.result(silent).result.message


def test_operators_that_must_be_heard_and_may_go_at_once_are_refused(make: Callable[..., Cell]) -> None:
    with pytest.raises(ConfigError, match=r"operator_beats = true asks .* set operator_timeout to 0\.4 s"):
        make(operator_beats=True, operator_timeout=0.0)


def test_an_operator_may_go_where_that_is_set(make: Callable[..., Cell]) -> None:
    cell = make(operator_timeout=0.0)
    cell.enabled()
    handle = cell.play(FREE)
    here = cell.bench.client.create_publisher(UUID, "controller/operator", COMMAND)
    assert cell.bench.until(lambda: cell.state.tip.position.x > 0.455)
    here.publish(handle.goal_id)
    cell.bench.spin(1.0)
    assert cell.node.follow.busy


@pytest.mark.parametrize(
    ("task", "overrides", "words"),
    [
        ("pen", "", "made for the tool 'pen', and the hand holds 'squeegee'"),
        ("squeegee", "force: 16", "phase 'press' asks for a force of 16 N, beyond the controller's max_force = 15 N"),
    ],
)
def test_what_does_not_fit_is_refused_before_it_begins(
    make: Callable[..., Cell], task: str, overrides: str, words: str
) -> None:
    cell = make()
    cell.enabled()
    assert words in cell.bench.result(cell.play(task, overrides)).result.message
    assert cell.state.mode == "idle"


def test_an_estimator_whose_clock_is_off_is_refused_and_held_and_told(make: Callable[..., Cell]) -> None:
    """It answers at once; only its clock is another one."""
    cell, ahead = make(), 0.0
    client = cell.bench.client
    answers = client.create_publisher(TimeReference, "clock_answer", COMMAND)

    def answer(question: TimeReference) -> None:
        message = TimeReference(time_ref=question.header.stamp)
        message.header.stamp = stamp_from_seconds(cell.now() + ahead)
        answers.publish(message)

    client.create_subscription(TimeReference, "clock_question", answer, COMMAND)
    skew = cell.node._estimator_clock.skew
    assert cell.bench.until(lambda: bool(skew.pending))
    early = enable(cell)  # takes less than two more answers, which come every 0.2 s
    assert early.success or "is not compared yet" in early.message
    assert cell.bench.until(lambda: skew.known)
    cell.enabled()
    assert not skew.problem
    assert abs(skew.offset) <= skew.within
    cell.setpoint.publish(cell.hold_here())
    assert cell.bench.until(lambda: cell.state.mode == "position")
    ahead = 0.5  # more than a busy test machine can be late by
    assert cell.bench.until(lambda: cell.state.mode == "holding", 15.0)
    assert "the clock of the estimator's computer is" in cell.state.reason
    assert "ahead of the controller's, more than clock.max_skew = 10 ms" in cell.state.reason
    assert cell.node._readiness.missing(cell.now())["estimate"] == skew.problem
    refused = enable(cell)
    assert not refused.success
    assert "synchronise the two" in refused.message
    ahead = 0.0
    assert cell.bench.until(lambda: enable(cell).success, 15.0)


def test_nothing_is_enabled_before_an_estimator_that_listens_could_answer(make: Callable[..., Cell]) -> None:
    cell = make()
    questions: list[TimeReference] = []
    cell.bench.client.create_subscription(TimeReference, "clock_question", questions.append, COMMAND)
    assert cell.bench.until(lambda: bool(questions) and bool(cell.states))
    refused = enable(cell)
    assert not refused.success
    assert "cannot enable: the estimator's clock is not compared yet" in refused.message
    assert cell.bench.until(lambda: enable(cell).success, 15.0)  # one that never answers is none of ours


def test_ready_does_not_wait_for_its_next_look_when_the_arm_holds(
    make: Callable[..., Cell], monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = make()
    told: list[DiagnosticStatus] = []
    cell.bench.client.create_subscription(DiagnosticStatus, "controller/ready", told.append, LATCHED)
    arm = cell.bench.client.create_publisher(String, "arm_hold_reason", LATCHED)
    cell.enabled()
    assert cell.bench.until(lambda: told and told[-1].message.startswith("ready"))
    monkeypatch.setattr(readiness, "EVERY", 3600.0)
    arm.publish(String(data="stopped on request"))
    assert cell.bench.until(lambda: "not ready: the arm holds: stopped on request" in told[-1].message, 5.0)
    assert told[-1].level == DiagnosticStatus.WARN
    arm.publish(String(data=""))
    assert cell.bench.until(lambda: "not ready: holds: the arm holds" in told[-1].message, 5.0)


def test_ready_names_what_is_missing_until_nothing_is(make: Callable[..., Cell]) -> None:
    cell = make()
    told: list[DiagnosticStatus] = []
    client = cell.bench.client
    client.create_subscription(DiagnosticStatus, "controller/ready", told.append, LATCHED)
    arm = client.create_publisher(String, "arm_hold_reason", LATCHED)
    cell.silent = {"current_pose", "relative_pose"}
    assert cell.bench.until(lambda: told and "no flange pose (/current_pose)" in told[-1].message)
    cell.silent = set()

    def no_reference(message: RelativePose) -> None:
        message.valid, message.reason = False, "no reference: capture_reference has not been called"

    cell.change = no_reference
    assert cell.bench.until(lambda: "capture_reference has not been called" in told[-1].message)
    cell.change = lambda _: None
    arm.publish(String(data="protective stop"))
    assert cell.bench.until(lambda: "protective stop" in told[-1].message)
    arm.publish(String(data=""))
    assert cell.bench.until(lambda: told[-1].message == "not ready: not enabled: call controller/enable on")
    cell.enabled()
    assert cell.bench.until(lambda: told[-1].message.startswith("ready"))
    assert told[-1].level == DiagnosticStatus.OK
    cell.silent = {"relative_pose"}
    assert cell.bench.until(lambda: "relative_pose is stale" in told[-1].message)
    values = {v.key: v.value for v in told[-1].values}
    assert values["pose"] == ""
    assert "holds: relative_pose is stale" in values["controller"]
    count = len(told)
    cell.bench.spin(1.5)
    assert len(told) - count <= 2  # a cause that lasts is told once, though its age grows


def test_the_log_tells_once_that_the_cell_is_up_and_before_what_it_waits_for(
    make: Callable[..., Cell], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(readiness, "PATIENCE", 1.0)
    cell = make()
    logged: list[str] = []
    log = SimpleNamespace(info=logged.append, warning=logged.append)
    monkeypatch.setattr(cell.node._readiness, "_log", log)
    cell.silent = {"relative_pose"}
    assert cell.bench.until(lambda: bool(logged))
    assert logged[0].startswith("the cell is not up after 1 s; not ready: no estimate of the relative pose has come")
    cell.silent = set()
    assert cell.bench.until(lambda: len(logged) == 2)
    assert logged[1].startswith("the cell is up; not ready: ")
    cell.enabled()
    cell.bench.spin(1.2)
    assert len(logged) == 2

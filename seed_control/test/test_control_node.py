# SPDX-License-Identifier: Apache-2.0
"""The controller as a real node, with an arm that follows at once and a tool that hangs free."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from seed_msgs.action import FollowSetpoints
from seed_msgs.msg import ControllerState, HybridSetpoint, RelativePose
from sensor_msgs.msg import TimeReference
from std_msgs.msg import Float32
from std_srvs.srv import SetBool, Trigger

from seed_control.ros import follow_setpoints
from seed_control.ros.node import ControllerNode
from seed_control.tasks import Task, read_task
from seed_core.clocks import save_clocks
from seed_core.config import ConfigError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Hand, Tool
from seed_core.spatial import inverse_pose, make_pose, rotation_from_rpy
from seed_core.stiffness_file import IdentifiedGrip, StiffnessFile, save_stiffness
from seed_ros.conversions import (
    estimate_to_message,
    fill_pose,
    pose_stamped,
    pose_to_matrix,
    stamp_from_seconds,
)
from seed_ros.qos import COMMAND, QUEUE, SENSOR
from seed_ros.testing import Bench

pytestmark = pytest.mark.ros

DOWN = rotation_from_rpy((math.pi, 0.0, 0.0))
X_W_TIP = make_pose(DOWN, (0.45, 0.0, 0.1))
PATIENT = {"kinematics_timeout": 0.8, "estimate_timeout": 1.0, "max_estimate_age": 1.5}  # a busy test machine


class Cell:
    """What stands around the controller."""

    def __init__(self, bench: Bench, **parameters: Any) -> None:
        self.bench = bench
        self.node = bench.add(ControllerNode, **(PATIENT | {"clocks": "simulated"} | parameters))
        self.X_WE = X_W_TIP @ inverse_pose(Tool().X_Ttip) @ inverse_pose(Hand().X_EC)
        self.targets = 0
        self.follows = True  # its targets, as an arm does
        self.silent: set[str] = set()
        self.change: Callable[[Any], None] = lambda _: None  # spoils relative_pose
        self.states: list[ControllerState] = []
        client = bench.client
        self._pose = client.create_publisher(PoseStamped, "current_pose", QUEUE)
        self._relative = client.create_publisher(RelativePose, "relative_pose", QUEUE)
        self.setpoint = client.create_publisher(HybridSetpoint, "controller/setpoint", COMMAND)
        client.create_subscription(PoseStamped, "target_frame", self._on_target, COMMAND)
        client.create_subscription(ControllerState, "controller/state", self.states.append, COMMAND)
        bench.every.append(self._publish)
        self._turns = 0

    def now(self) -> float:
        return self.bench.client.get_clock().now().nanoseconds * 1e-9

    def _on_target(self, message: PoseStamped) -> None:
        self.targets += 1
        if self.follows:
            self.X_WE = pose_to_matrix(message.pose)

    def _publish(self) -> None:
        self._turns += 1
        if "current_pose" not in self.silent:
            self._pose.publish(pose_stamped(self.X_WE, self.now(), "base"))
        if "relative_pose" not in self.silent and self._turns % 3 == 0:
            R_TW = self.X_WE[:3, :3].T  # the grasp's frame is turned as the flange's is
            hanging = make_pose(None, R_TW @ np.array((0.0, 0.0, -0.2 * 9.81)) / np.array((800.0, 1200.0, 800.0)))
            hanging[0, 3] += 1e-9 * (self._turns % 2)  # no two images are alike
            estimate = RelativePoseEstimate(self.now(), hanging, np.diag([1e-8] * 6), method="test")
            message = estimate_to_message(estimate, "compliance", "tool")
            self.change(message)
            self._relative.publish(message)

    @property
    def state(self) -> ControllerState:
        return self.states[-1]

    def enabled(self) -> Cell:
        assert self.bench.until(lambda: self.states and not math.isnan(self.state.estimate_age))
        assert self.bench.call(SetBool, "controller/enable", SetBool.Request(data=True)).success
        assert self.bench.until(lambda: self.state.enabled)
        return self

    def hold_here(self) -> HybridSetpoint:
        message = HybridSetpoint()
        message.header.frame_id = "base"
        message.header.stamp = stamp_from_seconds(self.now())
        fill_pose(message.pose, X_W_TIP)
        return message

    def play(self, task: str, overrides: str = "") -> Any:
        goal = FollowSetpoints.Goal(task=task, overrides=overrides)
        return self.bench.send_goal(FollowSetpoints, "controller/follow_setpoints", goal)


@pytest.fixture
def cell() -> Iterator[Cell]:
    bench = Bench()
    try:
        yield Cell(bench)
    finally:
        bench.close()


def test_nothing_is_sent_before_enable_and_enable_wants_its_inputs(cell: Cell) -> None:
    cell.silent = {"relative_pose"}
    cell.bench.spin(0.5)
    refused = cell.bench.call(SetBool, "controller/enable", SetBool.Request(data=True))
    assert not refused.success
    assert "no estimate of the relative pose has come yet" in refused.message
    assert cell.targets == 0
    assert cell.node.beats.take()["rate_hz"] == 0.0
    cell.silent = set()
    cell.enabled()
    assert cell.bench.until(lambda: cell.targets > 3)
    assert cell.bench.until(lambda: float(str(cell.node.beats.take()["rate_hz"])) > 0.0)


def press_and_be_refused(cell: Cell) -> None:
    pressing = cell.hold_here()
    pressing.force_projector = [0.0] * 8 + [1.0]
    pressing.wrench.force.z = -1.0
    cell.setpoint.publish(pressing)
    assert cell.bench.until(lambda: cell.state.refused_setpoints == 1), cell.state
    assert "SP18" in cell.state.reason


def test_force_waits_for_the_clocks_and_motion_does_not() -> None:
    bench = Bench()
    try:
        cell = Cell(bench, clocks="").enabled()
        press_and_be_refused(cell)
        assert "./seed identify --live" in cell.state.reason
        cell.setpoint.publish(cell.hold_here())
        assert bench.until(lambda: cell.state.setpoint_kind == "hybrid")
    finally:
        bench.close()


@pytest.mark.parametrize(
    ("given", "words"),
    [({"hand.name": "mine"}, "the squeegee of 0.2 kg, tip 120 mm along z: write tool"),
     ({"hand.name": "mine", "tool.mass": 0.3}, ""), ({}, "")],
)  # fmt: skip
def test_a_hand_without_a_tool_says_which_one_is_assumed(given: dict[str, Any], words: str) -> None:
    bench = Bench()
    try:
        told = bench.add(ControllerNode, **given)._assumed_tool()
    finally:
        bench.close()
    assert (words in told) if words else not told


def test_force_waits_for_an_estimator_that_takes_the_offset_off(tmp_path: Path) -> None:
    """The file was given to the controller alone, as with the cameras at another computer."""
    save_clocks(tmp_path / "clocks.yaml", 0.03, 0.0005, "2026-11-22")
    bench, taken = Bench(), ""
    try:
        cell = Cell(bench, clocks=str(tmp_path / "clocks.yaml"))
        answers = bench.client.create_publisher(TimeReference, "clock_answer", COMMAND)

        def answer(question: TimeReference) -> None:
            message = TimeReference(time_ref=question.header.stamp, source=taken)
            message.header.stamp = stamp_from_seconds(cell.now())
            answers.publish(message)

        bench.client.create_subscription(TimeReference, "clock_question", answer, COMMAND)
        checks = cell.node.core.checks
        assert bench.until(lambda: cell.node._estimator_clock.skew.known)
        assert not checks.why_no_force  # of an estimator that does not say
        taken = "0.000000"
        assert bench.until(lambda: bool(checks.why_no_force))
        cell.enabled()
        press_and_be_refused(cell)
        assert "the estimator takes 0.0 ms off" in cell.state.reason
        taken = "0.030000"
        assert bench.until(lambda: not checks.why_no_force)
    finally:
        bench.close()


def test_a_hanging_tool_shows_no_force(cell: Cell) -> None:
    cell.enabled()
    force = cell.state.estimated.force
    assert abs(force.z) < 0.02  # [N]: deflection and weight cancel
    assert cell.state.mode == "idle"


def spoiled(message: HybridSetpoint, how: str) -> HybridSetpoint:
    match how:
        case "nan":
            message.pose.position.z = float("nan")
        case "quaternion":
            message.pose.orientation.x = 0.7
        case "frame":
            message.header.frame_id = "map"
        case "both":
            message.wrench.force.z = -5.0
        case "projector":
            message.force_projector = [0.0] * 8 + [0.5]
        case "stale":
            message.header.stamp = stamp_from_seconds(5.0)
        case "torque":
            message.torque_axes = [True, False, False]
        case "infinite":
            message.wrench.torque.x = float("inf")
    return message


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("nan", "setpoint.pose has a value that is not finite"),
        ("quaternion", "a unit quaternion"),
        ("frame", "frame_id = 'map' is unknown here; known: base"),
        ("both", "force or position, not both"),
        ("projector", "no projector"),
        ("stale", "is stamped"),
        ("torque", "without a contact that resists rotation"),
        ("infinite", "not finite"),
    ],
)
def test_a_bad_setpoint_is_refused_with_its_reason_and_counted_and_the_arm_holds(
    cell: Cell, how: str, words: str
) -> None:
    cell.enabled()
    before = cell.X_WE.copy()
    cell.setpoint.publish(spoiled(cell.hold_here(), how))
    assert cell.bench.until(lambda: cell.state.refused_setpoints == 1), cell.state
    assert words in cell.node.counters.last
    cell.bench.spin(0.2)
    np.testing.assert_allclose(cell.X_WE, before, atol=1e-4)
    assert cell.state.setpoint_kind == ""


def test_the_tip_goes_where_a_good_setpoint_says(cell: Cell) -> None:
    cell.enabled()
    message = cell.hold_here()
    message.velocity.x = 0.01
    message.pose.position.x += 0.01

    def reached() -> bool:
        message.header.stamp = stamp_from_seconds(cell.now())
        cell.setpoint.publish(message)
        return abs(cell.state.tip.position.x - message.pose.position.x) < 5e-4

    assert cell.bench.until(reached), cell.state
    assert cell.state.setpoint_kind == "hybrid"
    followed = cell.node.core.law.setpoint
    assert followed is not None
    np.testing.assert_allclose(followed.velocity, (0.01, 0.0, 0.0))


@pytest.mark.parametrize("stream", ["current_pose", "relative_pose"])
def test_a_stream_that_falls_silent_makes_it_hold_until_it_is_enabled_again(cell: Cell, stream: str) -> None:
    cell.enabled()
    cell.silent = {stream}
    assert cell.bench.until(lambda: cell.state.mode == "holding")
    assert f"{stream} is stale" in cell.state.reason
    cell.silent = set()
    cell.bench.spin(0.3)
    assert cell.state.mode == "holding"  # latched
    cell.setpoint.publish(cell.hold_here())
    assert cell.bench.until(lambda: cell.state.refused_setpoints == 1)
    assert cell.bench.call(SetBool, "controller/enable", SetBool.Request(data=True)).success
    assert cell.bench.until(lambda: cell.state.mode == "idle")


def test_what_came_before_the_enabling_is_read_before_it(cell: Cell) -> None:
    """A simulated clock may be late, too: these look as if they were taken after it."""
    assert cell.bench.until(lambda: cell.states and not math.isnan(cell.state.estimate_age))

    def invalid(message: RelativePose) -> None:
        message.header.stamp, message.valid = stamp_from_seconds(cell.now() + 0.5), False

    change, cell.change = cell.change, invalid
    for _ in range(12):
        cell._publish()
    cell.change = change
    time.sleep(0.1)  # they come, and nobody reads them
    cell.node._enable(True)
    assert cell.bench.until(lambda: cell.state.ignored_estimates >= 4)
    cell.bench.spin(0.2)
    assert cell.state.mode == "idle", cell.state.reason


def test_invalid_or_foreign_estimates_are_counted_and_make_it_hold(cell: Cell) -> None:
    cell.enabled()

    def invalid(message: RelativePose) -> None:
        message.valid, message.reason = False, "left: only 3% of the depth image"

    cell.change = invalid
    assert cell.bench.until(lambda: cell.state.mode == "holding")
    assert "only 3% of the depth image" in cell.state.reason
    assert cell.state.ignored_estimates >= 3
    before = cell.state.ignored_estimates
    cell.change = lambda message: setattr(message.header, "frame_id", "elsewhere")
    assert cell.bench.until(lambda: cell.state.ignored_estimates > before)
    assert "'elsewhere' is unknown here; known: compliance" in cell.node.counters.last


def test_the_state_has_the_words_of_the_newest_estimate_and_diagnostics_those_of_the_newest_refusal(cell: Cell) -> None:
    cell.enabled()
    cell.setpoint.publish(spoiled(cell.hold_here(), "frame"))
    assert cell.bench.until(lambda: cell.state.refused_setpoints == 1)
    assert cell.state.estimator_reason == ""
    assert "'map' is unknown here" in str(cell.node._report()[2]["last_refused"])

    def invalid(message: RelativePose) -> None:
        message.valid, message.reason = False, "left: only 3% of the depth image"

    cell.change = invalid
    assert cell.bench.until(lambda: cell.state.estimator_reason == "left: only 3% of the depth image")
    cell.change = lambda _: None
    assert cell.bench.until(lambda: cell.state.estimator_reason == "")


@pytest.mark.parametrize(
    ("task", "words"),
    [
        ("no_such_task", "no task 'no_such_task': neither a file nor one of"),
        ("name: t\nphasen: []\n", "task:2: unknown key 'phasen'; known here: name"),
        ("name: t\nphases:\n  - {name: a, to: 0 0 0.1 cm}\n", "to = '0 0 0.1 cm' must be numbers with their unit, m"),
        ("name: t\nphases:\n  - {name: a, speed: .nan m/s}\n", "speed"),
    ],
)
def test_a_bad_task_is_refused_with_line_and_remedy(cell: Cell, task: str, words: str) -> None:
    cell.enabled()
    answer = cell.bench.result(cell.play(task))
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert not answer.result.success
    assert words in answer.result.message
    assert cell.state.mode == "idle"


def test_a_task_is_not_played_before_enable(cell: Cell) -> None:
    assert cell.bench.until(lambda: cell.states)
    answer = cell.bench.result(cell.play("squeegee"))
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert "then call controller/enable on" in answer.result.message


FREE = """
name: free
frame: {position: 0.45 0 0 m, rpy: 0 0 0 deg}
phases:
  - {name: out, to: 0.03 0 0.1 m, speed: 0.02 m/s}
  - {name: wait, to: 0.03 0 0.1 m, dwell: 60 s, timeout: 90 s}
"""


def test_cancelling_lifts_the_tool_and_holds(cell: Cell) -> None:
    cell.enabled()
    handle = cell.play(FREE)
    assert cell.bench.until(lambda: cell.state.tip.position.x > 0.46)
    other = cell.bench.result(cell.play(FREE))  # overlapping
    assert "is being played: cancel it first" in other.result.message
    weighed = cell.bench.call(Trigger, "controller/weigh_tool", Trigger.Request())
    assert "a task or another weighing is under way" in weighed.message
    cell.setpoint.publish(cell.hold_here())
    assert cell.bench.until(lambda: "while a task is played" in cell.node.counters.last)
    before = cell.state.tip.position.z
    handle.cancel_goal_async()
    answer = cell.bench.result(handle)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert cell.bench.until(lambda: cell.state.tip.position.z - before > 0.04)  # [m], of the task's lift of 0.05
    assert not cell.node.follow.busy


def tasks_are_read_late(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Not before the event that is returned."""
    may_end = threading.Event()

    def slow(*arguments: str) -> Task:
        assert may_end.wait(20.0)
        return read_task(*arguments)

    monkeypatch.setattr(follow_setpoints, "read_task", slow)
    return may_end


def test_the_loop_goes_on_while_a_task_is_read(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    """A long one takes longer than an arm waits for its target."""
    cell.enabled()
    may_end = tasks_are_read_late(monkeypatch)
    handle, before = cell.play(FREE), cell.targets
    assert cell.bench.until(lambda: cell.targets > before + 20, 10.0)
    assert not cell.node.follow.busy
    other = cell.bench.result(cell.play(FREE))
    assert "another task is being read" in other.result.message
    may_end.set()
    assert cell.bench.until(lambda: cell.state.tip.position.x > 0.455)
    handle.cancel_goal_async()
    assert cell.bench.result(handle).status == GoalStatus.STATUS_CANCELED
    assert cell.state.mode != "holding"


def test_a_task_that_is_being_read_can_be_cancelled(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    cell.enabled()
    may_end = tasks_are_read_late(monkeypatch)
    handle = cell.play(FREE)
    handle.cancel_goal_async()
    ended = cell.bench.result(handle)
    may_end.set()
    assert ended.status == GoalStatus.STATUS_CANCELED
    assert ended.result.message == "cancelled while it was being read; nothing has moved"
    monkeypatch.undo()
    assert cell.bench.until(lambda: not cell.node.follow.busy)
    again = cell.play(FREE)
    assert cell.bench.until(lambda: cell.state.tip.position.x > 0.455)
    again.cancel_goal_async()
    assert cell.bench.result(again).status == GoalStatus.STATUS_CANCELED


def disabled_while(cell: Cell, busy: Callable[[], bool]) -> None:
    """Disable as soon as it is busy: the command stays where it came to rest, and target_frame stays on it."""
    assert cell.bench.until(busy)
    cell.bench.spin(0.4)
    assert cell.bench.call(SetBool, "controller/enable", SetBool.Request(data=False)).success
    assert cell.bench.until(lambda: not busy())
    cell.bench.spin(0.3)
    before = cell.X_WE.copy()
    cell.bench.spin(0.3)
    np.testing.assert_allclose(cell.X_WE, before, atol=1e-6)
    assert cell.state.mode == "disabled"


def test_disabling_ends_a_task_where_it_is(cell: Cell) -> None:
    cell.enabled()
    handle = cell.play(FREE)
    disabled_while(cell, lambda: cell.node.follow.busy)
    answer = cell.bench.result(handle)
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert "disabled by controller/enable off" in answer.result.message
    again = cell.bench.result(cell.play(FREE))  # in the wrong state
    assert "then call controller/enable on" in again.result.message


def test_disabling_ends_a_weighing_where_it_is(cell: Cell) -> None:
    cell.enabled()
    client = cell.bench.client.create_client(Trigger, "controller/weigh_tool")
    assert cell.bench.until(client.service_is_ready)
    answer = client.call_async(Trigger.Request())
    disabled_while(cell, lambda: cell.node.payload.busy)
    assert cell.bench.until(answer.done)
    assert not answer.result().success
    assert "ended early: arm holds: disabled by controller/enable off" in answer.result().message


def test_weigh_tool_answers_with_the_weight_that_hangs_in_the_grasp(cell: Cell) -> None:
    """Takes as long as the motion: five orientations, held still."""
    refused = cell.bench.call(Trigger, "controller/weigh_tool", Trigger.Request())
    assert not refused.success
    assert "./seed call controller/enable on first" in refused.message
    cell.enabled()
    answer = cell.bench.call(Trigger, "controller/weigh_tool", Trigger.Request())
    assert answer.success, answer.message
    mass = float(answer.message.split()[1])
    assert mass == pytest.approx(0.2, rel=0.02)
    assert "vertical stiffness is 1.0" in answer.message or "vertical stiffness is 0.99" in answer.message


def test_a_stiffness_of_another_hand_is_refused(tmp_path: Path) -> None:
    grip = IdentifiedGrip(1020.0, 0.06, DEFAULT_STIFFNESS.rotation, DEFAULT_STIFFNESS.translation)
    save_stiffness(tmp_path / "stiffness.yaml", StiffnessFile("another", "tool", "2026-01-31", (grip,)))
    bench = Bench()
    try:
        with pytest.raises(ConfigError, match="identified with the hand 'another'"):
            Cell(bench, grip__file=str(tmp_path / "stiffness.yaml"))
    finally:
        bench.close()


def test_a_firmer_grip_stiffens_the_law_without_a_jump(tmp_path: Path) -> None:
    soft, firm = DEFAULT_STIFFNESS, DEFAULT_STIFFNESS.scaled(1.5)
    grips = tuple(
        IdentifiedGrip(p, w, k.rotation, k.translation) for p, w, k in ((1020.0, 0.06, soft), (1060.0, 0.05, firm))
    )
    save_stiffness(tmp_path / "stiffness.yaml", StiffnessFile(Hand().name, "tool", "2026-01-31", grips))
    bench = Bench()
    try:
        cell = Cell(bench, grip__file=str(tmp_path / "stiffness.yaml"))
        pressures = [bench.client.create_publisher(Float32, f"bubble_{s}/pressure", SENSOR) for s in ("left", "right")]
        pressure, heard = 1020.0, pressures
        bench.every.append(lambda: [p.publish(Float32(data=pressure)) for p in heard])
        cell.enabled()
        estimator = cell.node.core.wrench_estimator
        assert bench.until(lambda: abs(estimator.mean_stiffness - 2800.0 / 3.0) < 1e-6)
        cell.setpoint.publish(cell.hold_here())
        bench.spin(0.3)
        before, seen = cell.X_WE.copy(), []
        pressure = 1060.0
        bench.every.append(lambda: seen.append(estimator.mean_stiffness))
        assert bench.until(lambda: abs(estimator.mean_stiffness - 1400.0) < 1e-6)
        assert len({round(k) for k in seen}) > 5  # blended, not switched
        assert np.abs(cell.X_WE[:3, 3] - before[:3, 3]).max() < 2e-3
        assert cell.state.mode != "holding"
        heard = pressures[:1]  # the right sensor dies
        bench.spin(1.0)
        pressure = 1020.0
        bench.spin(1.0)
        assert estimator.mean_stiffness == pytest.approx(1400.0, abs=1e-6)
        assert "no pressure of the right bubble for 0.5 s: the stiffness stays" in cell.node.counters.last
        heard = pressures
        assert bench.until(lambda: abs(estimator.mean_stiffness - 2800.0 / 3.0) < 1e-6)
        pressure = 106000.0
        bench.spin(1.0)
        assert estimator.mean_stiffness == pytest.approx(2800.0 / 3.0, abs=1e-6)
        assert "it looks like Pa; hPa are needed: the stiffness stays" in cell.node.counters.last
    finally:
        bench.close()

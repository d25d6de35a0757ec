# SPDX-License-Identifier: Apache-2.0
"""Widths and forces as goals of a gripper's action; against a server where control_msgs is installed."""

from functools import partial
from importlib.util import find_spec
from math import isnan
from types import SimpleNamespace
from typing import Any

import pytest

from seed_core.config import ConfigError
from seed_core.errors import FailedError
from seed_driver.gripper import AGAIN, GripperActionConfig, GripperError, GripperGoals

ANGLE = GripperActionConfig(open_width=0.08, open_position=0.0, closed_position=0.8, max_force=30.0, rate=20.0)


def test_widths_become_joint_positions_and_back() -> None:
    goals = GripperGoals(ANGLE)
    goals.width(0.02)
    goal = goals.due(0.0)
    assert goal is not None
    assert goal.position == pytest.approx(0.6)  # a quarter open
    assert goal.effort == 30.0
    assert goals.width_of(0.6) == pytest.approx(0.02)
    assert goals.force_of(-7.0) == 7.0


def test_a_force_closes_with_that_much() -> None:
    goals = GripperGoals(ANGLE)
    goals.push(12.0)
    goal = goals.due(0.0)
    assert goal is not None
    assert (goal.position, goal.force) == (0.8, 12.0)


def test_fingers_that_cannot_meet_are_sent_no_further_than_they_go() -> None:
    """As a 2FG7 with its standard fingers: the driver refuses a distance below the least that it tells."""
    config = GripperActionConfig(open_width=0.05, open_position=0.05, closed_width=0.01, closed_position=0.01)
    goals = GripperGoals(config)
    goals.push(10.0)
    goal = goals.due(0.0)
    assert goal is not None
    assert goal.position == pytest.approx(0.01)
    goals.width(0.02)
    goal = goals.due(1.0)
    assert goal is not None
    assert goal.position == pytest.approx(0.02)
    assert goals.width_of(0.03) == pytest.approx(0.03)
    with pytest.raises(GripperError, match=r"must be between closed_width = 0\.01 and open_width"):
        goals.width(0.005)
    with pytest.raises(ConfigError, match=r"closed_width = 0\.085 m must be less than open_width = 0\.085 m"):
        GripperActionConfig(closed_width=0.085)


def test_goals_come_no_faster_than_the_rate_and_only_when_something_changes() -> None:
    goals = GripperGoals(ANGLE)
    sent = 0
    for i in range(200):  # two seconds, 100 commands of force a second that rise for one
        goals.push(5.0 + 0.1 * min(i, 100))
        sent += goals.due(0.01 * i) is not None
    assert 15 <= sent <= 22
    goals.refused()
    assert goals.due(3.0) is not None


def test_the_same_goal_is_sent_once_whatever_the_least_changes() -> None:
    goals = GripperGoals(GripperActionConfig(least_width=0.0, least_force=0.0))
    sent = []
    for i in range(10):
        goals.width(0.03)
        sent.append(goals.due(0.1 * i))
    assert sent[0] is not None
    assert sent[1:] == [None] * 9
    goals.width(0.031)
    assert goals.due(1.0) is not None
    goals.refused()
    assert goals.due(1.1) is not None


def test_a_server_that_comes_later_gets_no_old_command() -> None:
    goals = GripperGoals(ANGLE)
    goals.push(12.0)
    assert goals.forget()
    assert goals.due(0.0) is None
    goals.push(12.0)
    assert goals.due(1.0) is not None
    assert goals.forget()  # it went away: the same command is sent to the next one
    goals.push(12.0)
    assert goals.due(0.5) is not None  # the clock was set back, too
    goals.forget()
    assert not goals.forget()


def test_only_fingers_that_stall_push() -> None:
    goals = GripperGoals(ANGLE)
    assert isnan(goals.settled)
    goals.push(12.0)
    goal = goals.due(0.0)
    assert goal is not None
    goals.ended(goal, stalled=True, reached=False, t=0.1)
    assert goals.settled == 12.0
    goals.push(6.0)
    newer = goals.due(1.0)
    assert newer is not None
    goals.ended(goal, stalled=False, reached=False, t=1.1)  # the newer goal took its place
    assert goals.settled == 12.0
    goals.ended(newer, stalled=False, reached=True, t=1.2)  # closed on nothing
    assert goals.settled == 0.0
    goals.forget()
    assert isnan(goals.settled)


def test_a_new_width_leaves_the_push_unknown_until_it_ends() -> None:
    goals = GripperGoals(ANGLE)
    goals.push(15.0)
    goal = goals.due(0.0)
    assert goal is not None
    goals.ended(goal, stalled=True, reached=False, t=0.1)
    goals.push(15.0)
    assert goals.due(1.0) is None
    assert goals.settled == 15.0
    goals.push(5.0)
    assert goals.due(2.0) is not None
    assert goals.settled == 15.0  # the fingers push on
    goals.width(0.08)
    goal = goals.due(3.0)
    assert goal is not None
    assert isnan(goals.settled)
    goals.ended(goal, stalled=False, reached=True, t=3.5)
    assert goals.settled == 0.0


def test_the_late_end_of_a_goal_that_was_replaced_tells_no_push() -> None:
    goals = GripperGoals(ANGLE)
    goals.push(10.0)
    first = goals.due(0.0)
    goals.width(0.08)
    second = goals.due(1.0)
    assert first is not None
    assert second is not None
    assert not goals.ended(first, stalled=True, reached=False, t=1.1)
    assert isnan(goals.settled)  # the fingers open
    goals.ended(second, stalled=False, reached=True, t=1.5)
    assert goals.settled == 0.0


def test_a_goal_that_fails_is_sent_again_after_a_pause() -> None:
    """Aborted, or another client's took its place: a command that goes on asks for it still."""
    goals = GripperGoals(ANGLE)
    goals.width(0.03)
    first = goals.due(0.0)
    assert first is not None
    assert goals.ended(first, stalled=False, reached=False, t=0.1)
    goals.width(0.03)
    assert goals.due(0.1 + 0.9 * AGAIN) is None
    assert goals.due(0.1 + 1.1 * AGAIN) == first
    goals.width(0.05)
    assert goals.due(10.0) is not None
    assert not goals.ended(first, stalled=False, reached=False, t=10.1)  # ours took its place


@pytest.mark.parametrize("width", [float("nan"), -0.01, 0.2])
def test_a_width_that_cannot_be_is_refused(width: float) -> None:
    with pytest.raises(GripperError, match=r"must be between 0 and open_width = 0\.08 m"):
        GripperGoals(ANGLE).width(width)
    with pytest.raises(GripperError, match="max_force = 30 N"):
        GripperGoals(ANGLE).push(width if width < 0.0 else 31.0)
    with pytest.raises(GripperError, match="force_command = nan N"):
        GripperGoals(ANGLE).push(float("nan"))
    with pytest.raises(ConfigError, match="must differ"):
        GripperActionConfig(open_position=0.1, closed_position=0.1)


def test_no_force_is_no_goal() -> None:
    """Effort 0 closes with all or the default force, or lets the fingers go, by the server."""
    goals = GripperGoals(ANGLE)
    goals.push(5.0)
    with pytest.raises(GripperError, match=r"force_command = 0\.0 N must be above 0 .* opened by gripper/command"):
        goals.push(0.0)
    goal = goals.due(0.0)
    assert goal is not None
    assert goal.force == 5.0  # what was asked for before stands
    goals.width(0.0)
    goal = goals.due(1.0)
    assert goal is not None
    assert goal.effort == 30.0


@pytest.mark.skipif(find_spec("control_msgs") is not None, reason="control_msgs is installed")
def test_without_control_msgs_it_says_what_to_install() -> None:
    pytest.importorskip("rclpy", reason="needs ROS 2")
    from seed_driver.ros.gripper_action import action_type

    with pytest.raises(FailedError, match="control-msgs"):
        action_type("GripperCommand")


@pytest.mark.parametrize("parallel", [False, True])
def test_goals_have_the_fields_of_control_msgs(parallel: bool) -> None:
    pytest.importorskip("rclpy", reason="needs ROS 2")
    from seed_driver.gripper import Goal
    from seed_driver.ros.gripper_action import message_of

    kind = SimpleNamespace(Goal=lambda: SimpleNamespace(command=SimpleNamespace()))
    command = message_of(kind, parallel, "jaw", Goal(0.6, 12.0, 12.0)).command
    if parallel:
        assert (command.name, command.position, command.effort) == (["jaw"], [0.6], [12.0])
    else:
        assert (command.position, command.max_effort) == (0.6, 12.0)


def _keep(told: dict[str, float], name: str, message: Any) -> None:
    told[name] = message.data


class Server:
    """A gripper: a joint that closes at once until it pushes with the effort that it is allowed."""

    def __init__(self, bench: Any, kind: str) -> None:
        from control_msgs import action
        from rclpy.action import ActionServer
        from sensor_msgs.msg import JointState

        from seed_ros.qos import QUEUE

        self.parallel = kind == "ParallelGripperCommand"
        self.position, self.effort = 0.0, 0.0
        self._type = getattr(action, kind)
        self._states = bench.client.create_publisher(JointState, "joint_states", QUEUE)
        self._server = ActionServer(bench.client, self._type, "gripper_controller/gripper_cmd", self._execute)
        bench.every.append(self._tell)
        self._message = JointState

    def _tell(self) -> None:
        self._states.publish(self._message(name=["other", "gripper_joint"], position=[1.0, self.position],
                                           effort=[9.0, self.effort]))  # fmt: skip

    def _execute(self, handle: Any) -> Any:
        command = handle.request.command
        wanted = command.position[0] if self.parallel else command.position
        effort = command.effort[0] if self.parallel else command.max_effort
        touched = wanted > 0.6  # a tool of 20 mm
        self.position, self.effort = min(wanted, 0.6 + 0.005 * effort), effort if touched else 0.0
        handle.succeed()
        result = self._type.Result()
        result.stalled, result.reached_goal = touched, not touched
        return result


@pytest.mark.ros
@pytest.mark.parametrize("kind", ["GripperCommand", "ParallelGripperCommand"])
def test_against_an_action_server(kind: str) -> None:
    pytest.importorskip("control_msgs", reason="control_msgs is not installed")
    from std_msgs.msg import Float64

    from seed_driver.ros.gripper_action import GripperActionNode
    from seed_ros.qos import COMMAND, QUEUE
    from seed_ros.testing import Bench

    bench = Bench()
    try:
        server = Server(bench, kind)
        bench.add(GripperActionNode, kind=kind, open_width=0.08, open_position=0.0, closed_position=0.8)
        told: dict[str, float] = {}
        for name in ("width", "force"):
            receive = partial(_keep, told, name)
            bench.client.create_subscription(Float64, f"gripper/{name}", receive, QUEUE)
        widths = bench.client.create_publisher(Float64, "gripper/command", COMMAND)
        forces = bench.client.create_publisher(Float64, "gripper/force_command", COMMAND)
        bench.every.append(lambda: widths.publish(Float64(data=0.05)))
        assert bench.until(lambda: abs(told.get("width", 0.0) - 0.05) < 1e-6)
        bench.every[-1] = lambda: forces.publish(Float64(data=8.0))
        assert bench.until(lambda: told["force"] == 8.0)
        assert server.position == pytest.approx(0.64)
    finally:
        bench.close()

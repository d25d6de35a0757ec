# SPDX-License-Identifier: Apache-2.0
"""`gripper_action`: any gripper with a control_msgs action server as the suite's gripper (docs/gripper_contract.md)."""

from math import isfinite, nan
from typing import Any

from rclpy.action import ActionClient
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from seed_core.errors import FailedError
from seed_driver.gripper import Goal, GripperActionConfig, GripperGoals
from seed_ros import COMMAND, QUEUE, FixedRateLoop, SeedNode, diagnostics

_RATE = 100.0  # [Hz] of the loop


def action_type(kind: str) -> Any:
    """The action of control_msgs. Raises FailedError where that package is not installed."""
    try:
        from control_msgs import action
    except ImportError as error:
        raise FailedError(
            "gripper_action needs the package control_msgs, which is not installed: apt install "
            "ros-$ROS_DISTRO-control-msgs (it is not among the wheels of this environment)"
        ) from error
    if not hasattr(action, kind):
        raise FailedError(f"this control_msgs knows no {kind}: use kind: GripperCommand, or a newer control_msgs")
    return getattr(action, kind)


def message_of(kind: Any, parallel: bool, joint: str, goal: Goal) -> Any:
    """A goal for the action server."""
    message = kind.Goal()
    if parallel:
        message.command.name, message.command.position = [joint], [goal.position]
        message.command.effort = [goal.effort]
    else:
        message.command.position, message.command.max_effort = goal.position, goal.effort
    return message


class GripperActionNode(SeedNode):
    """Topics: gripper/command, gripper/force_command and joint_states in; gripper/width and gripper/force out."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("gripper_action", **arguments)
        self.config = config = self.declare(GripperActionConfig())
        self.refuse_unknown()
        self._kind, self._parallel = action_type(config.kind), config.kind == "ParallelGripperCommand"
        self.goals = GripperGoals(config)
        self._client = ActionClient(self, self._kind, config.action)
        self._width = self.publisher(Float64, "gripper/width", QUEUE)
        self._force = self.publisher(Float64, "gripper/force", QUEUE)
        self._heard = False
        self.loop = FixedRateLoop(self, _RATE, self._step)
        self.loop.poll(Float64, "gripper/command", self._on_width, COMMAND)
        self.loop.poll(Float64, "gripper/force_command", self._on_force, COMMAND)
        self.loop.poll(JointState, "joint_states", self._on_joints, QUEUE)
        self.diagnose("gripper_action", self._report)

    def _on_width(self, message: Float64) -> None:
        with self.counters.refusing("commands_refused"):
            self.goals.width(message.data)

    def _on_force(self, message: Float64) -> None:
        with self.counters.refusing("commands_refused"):
            self.goals.push(message.data)

    def _on_joints(self, message: JointState) -> None:
        if self.config.joint not in message.name:
            return
        i = message.name.index(self.config.joint)
        if i >= len(message.position):
            return
        if not isfinite(message.position[i]):
            self.counters.add("joints_refused", f"joint_states tell {message.position[i]} of {self.config.joint}")
            return
        self._heard = True
        self._width.publish(Float64(data=self.goals.width_of(message.position[i])))
        force = self.goals.settled
        if self.config.force == "measured":
            force = self.goals.force_of(message.effort[i] if i < len(message.effort) else nan)
        if isfinite(force):
            self._force.publish(Float64(data=force))

    def _step(self) -> None:
        self.beats.add()
        if not self._client.server_is_ready():
            if self.goals.forget():
                self.counters.add("commands_lost", f"no action server {self.config.action}: commands are dropped")
            return
        goal = self.goals.due(self.now())
        if goal is not None:
            message = message_of(self._kind, self._parallel, self.config.joint, goal)
            self._client.send_goal_async(message).add_done_callback(lambda sent: self._sent(goal, sent.result()))

    def _sent(self, goal: Goal, handle: Any) -> None:
        if handle is None or not handle.accepted:
            self.goals.refused()
            self.counters.add(
                "goals_refused", f"the gripper refused position {goal.position:g}, effort {goal.effort:g}"
            )
            return
        handle.get_result_async().add_done_callback(lambda done: self._ended(goal, done.result()))

    def _ended(self, goal: Goal, answer: Any) -> None:
        if answer is not None and self.goals.ended(goal, answer.result.stalled, answer.result.reached_goal, self.now()):
            self.counters.add(
                "goals_failed",
                f"the gripper neither reached position {goal.position:g} nor stalled: another client's goal, or a "
                "fault; it is sent again",
            )

    def _report(self) -> diagnostics.Report:
        values: dict[str, object] = {"action": self.config.action, **self.counters.values()}
        if not self._client.server_is_ready():
            what = f"no action server {self.config.action} of type {self.config.kind}"
            return diagnostics.WARN, f"{what}: start the gripper's controller, or set kind to what it offers", values
        if not self._heard:
            return diagnostics.WARN, f"joint_states tell no {self.config.joint}", values
        return diagnostics.OK, self.counters.last or "the gripper answers", values


main = GripperActionNode.main

# SPDX-License-Identifier: Apache-2.0
"""The driver's ROS node: a lifecycle node that wires topics, services and parameters to the servo process."""

import re
import sys
import time
from typing import Any

from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from seed_core.arm.target_checks import Target, refusal
from seed_core.config import ConfigError, check_values
from seed_core.errors import SeedError
from seed_driver.config import FIXED, DriverConfig, from_json
from seed_driver.motion.calibrated_kinematics import arm_kinematics, out_of_reach
from seed_driver.motion.clearances import Clearances
from seed_driver.process.supervisor import Supervisor
from seed_driver.ros.outputs import DIAGNOSTICS_EVERY, Outputs, link_status
from seed_driver.ros.requests import Requests
from seed_ros import COMMAND, Counters, Diagnostics, FixedRateLoop, SeedNode, diagnostics, run
from seed_ros.arm import TargetSenders
from seed_ros.conversions import pose_to_tuples, seconds
from seed_ros.parameters import Declared, checking

LOOP_RATE = 500.0  # [Hz] at which targets are looked for
SERVICE_PERIOD = 0.02  # [s]
SLOWED = 0.99  # below this scale a refusal tells it: a slow robot is left behind by its targets
UNCONFIGURED, INACTIVE = "not configured: configure and activate the node", "inactive: activate the node"
REPEAT = 1.0  # [s] the same warning is not repeated earlier


class DriverNode(SeedNode, LifecycleNode):
    """See docs/driver.md for what it offers."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("driver", **arguments)
        words = "configure and activate by itself when the node starts"
        self.declare_parameter("autostart", True, ParameterDescriptor(description=words, read_only=True))
        self._declared = Declared(self, DriverConfig(), live={*DriverConfig.__dataclass_fields__} - {"loop_priority"})
        self.refuse_unknown()
        self.add_on_set_parameters_callback(checking(self._check_parameters))
        self.add_post_set_parameters_callback(self._use_parameters)

        self.config: DriverConfig | None = None
        self.supervisor: Supervisor | None = None
        self.outputs: Outputs | None = None
        self.counters = Counters(self, REPEAT)
        self.accepted = 0
        self._idle, self._told_idle = UNCONFIGURED, 0.0  # why nothing runs, while nothing does, and when it was told
        self._idle_diagnostics = Diagnostics(
            self, "", self._report_idle, self.beats, self.counters, link_status(self), timed=False
        )
        self._start_program = True  # by the first activation; later ones wait for a request

        self.loop = FixedRateLoop(
            self,
            LOOP_RATE,
            self._step,
            steady=True,
            priority=from_json({"loop_priority": self.get_parameter("loop_priority").value}).loop_priority,
            service_period=SERVICE_PERIOD,
        )
        self._senders = TargetSenders(self)
        self.loop.poll(PoseStamped, "target_frame", self._on_target, COMMAND, informed=True)
        self.requests = Requests(self, lambda: self.config.tool_voltage if self.config is not None else 0)

    # lifecycle
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """Check the settings; FAILURE, with the reason in the log and the diagnostics, when they are wrong."""
        try:
            self.config = self._declared.read().check()
            self.arm = arm_kinematics(self.config)
            Clearances(self.arm, self.config)  # the servo process reads its files
        except SeedError as error:
            self.config, self._idle = None, f"not configured: {error}"
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self.outputs, self._idle = Outputs(self, self.config), INACTIVE
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start the servo process; the link may come up later, see ~/hold_reason."""
        assert self.config is not None
        supervisor = Supervisor(self.config)
        try:
            supervisor.start(self._start_program)  # when this fails, the node is not active and nothing starts later
        except OSError as error:
            self.get_logger().error(f"the servo process cannot be started: {error}; mend that, configure and activate")
            raise
        self.supervisor, self._start_program = supervisor, False
        self.requests.begin(supervisor, self.config.robot_ip)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Come to rest, end the program and the servo process."""
        self._end()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """Give the publishers back."""
        self._end()
        if self.outputs is not None:
            self.outputs.destroy()
            self.outputs = None
        self.config, self._idle = None, UNCONFIGURED
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """As clean up: a transition that failed ends in unconfigured."""
        return self.on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """As deactivate."""
        self._end()
        return TransitionCallbackReturn.SUCCESS

    def _end(self) -> None:
        if self.supervisor is not None:
            self.supervisor.close()
            if self.outputs is not None and self.context.ok():
                self.outputs.publish_inactive(self.supervisor.state)
            self.supervisor = None
        self.requests.end()

    def destroy_node(self) -> None:
        """End the servo process too, also after half a construction."""
        self._end()
        self.requests.close()
        super().destroy_node()

    # parameters
    def _check_parameters(self, parameters: list[Parameter]) -> None:
        if self.config is None:  # each by itself: how they go together is checked when the driver is configured
            check_values(self._declared.among(parameters), DriverConfig, "driver")
            return
        for name in sorted(self._declared.among(parameters)):
            if name in FIXED:
                raise ConfigError(
                    f"{name} is fixed while the driver is configured: deactivate it and clean it up first"
                )
        self._declared.read(parameters).check()

    def _use_parameters(self, parameters: list[Parameter]) -> None:
        if self.config is not None and self._declared.among(parameters):
            self.config = self._declared.read()
            if self.supervisor is not None:
                self.supervisor.set_config(self.config)

    # topics
    def _step(self) -> None:
        now = time.monotonic()
        if self.supervisor is None or self.outputs is None:
            if now - self._told_idle > DIAGNOSTICS_EVERY:
                self._told_idle = now
                self._idle_diagnostics.publish()
            return
        state = self.supervisor.step(now)
        self.outputs.publish(state, now, self.counters.total(), self.accepted, self.supervisor.deaths)
        self.requests.answer(now)

    def _report_idle(self) -> diagnostics.Report:
        level = diagnostics.WARN if self._idle in (UNCONFIGURED, INACTIVE) else diagnostics.ERROR
        return level, self._idle, self.counters.values()

    def _on_target(self, message: PoseStamped, information: dict[str, Any]) -> None:
        received = time.monotonic()
        several = self._senders.conflict(information)
        supervisor, config = self.supervisor, self.config
        if supervisor is None or config is None:
            return
        state = supervisor.state
        if not state.armed:
            remedy = "; call driver/resend_robot_program" if state.linked else ""
            self._refused(f"target_frame is not followed: {state.reason or 'no robot program'}{remedy}")
            return
        if several:
            supervisor.send("hold", reason=several)
            self._refused(f"target_frame is not followed: {several}")
            return
        target = self._target(message)
        why = refusal(target, state.command, config) or out_of_reach(target, self.arm, state.sample.q)
        if why:
            if state.sample.speed_scaling < SLOWED:
                why += f"; the robot runs at {state.sample.speed_scaling:.0%} of its speed (slider of the pendant?)"
            supervisor.send("refuse", reason=why)
            self._refused(f"refused: {why}")
            return
        self.accepted += 1
        supervisor.write_target(target.p, target.q, received)

    def _refused(self, words: str) -> None:
        self.counters.add(re.split(r"['=\d]", words)[0][:40].strip(), words)  # a cause without its numbers

    def _target(self, message: PoseStamped) -> Target:
        age = self.now() - seconds(message.header.stamp)
        return Target(message.header.frame_id, age, *pose_to_tuples(message.pose))


def _create() -> DriverNode:
    """The node; with autostart it configures and activates itself."""
    node = DriverNode()
    if node.get_parameter("autostart").value:
        if node.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            node.trigger_activate()
        else:
            node.get_logger().error("not configured: correct the parameter, then configure and activate the node")
    return node


def main() -> int:
    """Run the node until it is interrupted; the exit code."""
    return run(_create)


if __name__ == "__main__":
    sys.exit(main())

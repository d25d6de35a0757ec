# SPDX-License-Identifier: Apache-2.0
"""The controller's ROS node: relative pose, kinematics and set-point in; flange pose out, at a fixed rate."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, WrenchStamped
from seed_msgs.msg import ControllerState as StateMsg
from seed_msgs.msg import HybridSetpoint as HybridMsg
from seed_msgs.msg import RelativePose, WrenchEstimate
from seed_msgs.msg import RelativePoseSetpoint as RelativePoseMsg
from seed_msgs.msg import WrenchSetpoint as WrenchMsg
from std_msgs.msg import String
from std_srvs.srv import SetBool

from seed_control.controller import Controller, ControlRefusedError
from seed_control.grip import GripSettings
from seed_control.monitor.clock_skew import SkewSettings
from seed_control.parameters import LIVE, ControllerParameters
from seed_control.ros.bubble_pressures import BubblePressures
from seed_control.ros.conversions import fill_state, hybrid_setpoint, relative_pose_setpoint, wrench_setpoint
from seed_control.ros.estimator_clock import EstimatorClock
from seed_control.ros.follow_setpoints import FollowServer
from seed_control.ros.grip import GripAnswer
from seed_control.ros.identify_payload import PayloadIdentification
from seed_control.ros.readiness import Readiness
from seed_control.ros.stiffness_schedule import StiffnessScheduleInput
from seed_control.ros.task_operator import Operator
from seed_control.setpoint.setpoints import Setpoint
from seed_control.state import ControllerState, ControlOutput
from seed_control.wrench.choose_model import choose_model
from seed_control.wrench.stiffness_schedule import ScheduleSettings
from seed_core.bushing import Stiffness
from seed_core.clocks import CLOCKS_DOC, read_clocks
from seed_core.config import ConfigError, field
from seed_core.errors import SeedError
from seed_core.hand import DEFAULT_STIFFNESS, Hand, Tool
from seed_core.spatial import Wrench
from seed_core.wrench_settings import ReferenceSettings, WrenchSettings
from seed_ros import COMMAND, LATCHED, QUEUE, FixedRateLoop, FrameNames, SeedNode, TransformBroadcaster, diagnostics
from seed_ros.arm import arm_holds
from seed_ros.conversions import (
    check_frame,
    check_not_ahead,
    estimate_from_message,
    fill_wrench,
    pose_stamped,
    pose_to_matrix,
    seconds,
    stamped,
    swap_halves,
    transform_stamped,
    wrench_stamped,
    wrench_to_core,
)
from seed_ros.private_rclpy import given_parameters


@dataclass(frozen=True)
class NodeSettings:
    """What is the node's alone."""

    state_rate: float = field(50.0, unit="Hz", low=1.0, high=1000.0, doc="of ~/state and wrench_estimate")
    publish_tf: bool = field(True, doc="publish tool to tip on /tf_static")
    clocks: str = field("", doc=f"{CLOCKS_DOC}; while unknown, force and torque are refused (SP18)")
    operator_timeout: float = field(
        0.4,
        unit="s",
        low=0.0,
        high=60.0,
        doc="a task ends when its operator was not heard for so long (~/operator, or the listener to its feedback); "
        "0: it goes on",
    )
    operator_beats: bool = field(
        False,
        doc="every task ends whose operator is not heard on ~/operator: that a client was killed is else noticed "
        "after the middleware's 20 s",
    )
    operator_lost: str = field("lift", choices=("lift", "hold"), doc="how a task ends whose operator is lost")
    realtime_priority: int = field(40, low=0, high=98, doc="SCHED_FIFO priority of the loop if allowed; 0: none")

    def __post_init__(self) -> None:
        """Raises ConfigError: an operator must be heard who may go."""
        if self.operator_beats and not self.operator_timeout:
            raise ConfigError(
                "operator_beats = true asks that every operator is heard, and operator_timeout = 0 s that none "
                "needs be: set operator_timeout to 0.4 s, or operator_beats to false"
            )


GONE = 0.5  # [s] beyond kinematics_timeout: an arm without a pose for so long may be anywhere when it is back


class ControllerNode(SeedNode):
    """See docs/interfaces.md."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("controller", **arguments)
        self.settings = self.declare(NodeSettings())
        self.parameters = self.declare(ControllerParameters(), live=LIVE, on_change=self._on_limits)
        self.frames = self.declare(FrameNames(), "frames")
        self.tool = self.declare(Tool(), "tool")
        live = ("rotation", "translation")
        stiffness = self.declare(DEFAULT_STIFFNESS, "grasp", live=live, on_change=self._on_stiffness)
        hand = self.declare(Hand(), "hand")
        schedule = self.declare(ScheduleSettings(), "grip")
        grip = self.declare(GripSettings(), "grip_answer")
        wrench = self.declare(WrenchSettings(), "wrench")
        references = self.declare(ReferenceSettings(), "reference")
        skew = self.declare(SkewSettings(), "clock")
        self.refuse_unknown()
        if assumed := self._assumed_tool():
            self.get_logger().warning(assumed)

        model, pressure = choose_model(wrench, stiffness, hand, datetime.now(UTC), schedule.file)
        self.core = Controller(self.parameters, hand, self.tool, stiffness, model, references, pressure)
        self.clocks = read_clocks(self.settings.clocks)
        self.core.checks.clock_problem = self.clocks.problem
        if self.clocks.problem:
            self.get_logger().warning(f"force and torque are refused (SP18): {self.clocks.problem}")
        if schedule.file and wrench.model != "bushing":
            self.get_logger().warning(
                f"grip.file is not used: wrench.model is '{wrench.model}', which has a stiffness of its own"
            )
        self.steps = 0
        self._estimator_says = ""  # reason of the newest estimate
        self._arm_holds = ""  # why
        self._was_enabled = False
        self._here, self._here_at = np.eye(4), 0.0  # the newest flange pose and its stamp [s]
        self._output: ControlOutput | None = None

        self._create_outputs()
        self.loop = FixedRateLoop(self, self.parameters.rate, self._step, priority=self.settings.realtime_priority)
        self._pressures = BubblePressures(self) if wrench.file else None  # polled before relative_pose
        self._create_inputs()
        StiffnessScheduleInput(self, schedule, hand, self._on_stiffness)
        self.grip = GripAnswer(self, self.core, grip)
        self._estimator_clock = EstimatorClock(self, skew, self.clocks)
        self._create_services()
        skewed = self._estimator_clock.skew
        self._readiness = Readiness(self, self.core, lambda: self._arm_holds, lambda: skewed.problem)
        self.diagnose("controller", self._report)

    def _assumed_tool(self) -> str:
        """Which tool is assumed with a hand that was given without one; '' where a tool was given, or no hand."""
        given, t = given_parameters(self), self.tool
        if not any(n.startswith("hand.") for n in given) or any(n.startswith("tool.") for n in given):
            return ""
        return (
            f"a hand without a tool was given: assumed is the {t.name} of {t.mass:g} kg, "
            f"tip {1e3 * t.T_tip.position[2]:g} mm along z: write tool into the hand_file"
        )

    def _create_outputs(self) -> None:
        self._target = self.publisher(PoseStamped, "target_frame", COMMAND)
        self._wrench = self.publisher(WrenchEstimate, "wrench_estimate", COMMAND)
        self._drawn = self.publisher(WrenchStamped, "~/wrench", COMMAND)
        self._state = self.publisher(StateMsg, "~/state", COMMAND)
        self._state_every = max(1, round(self.parameters.rate / self.settings.state_rate))  # [steps]
        self._reference = self.publisher(PoseStamped, "~/reference", COMMAND)
        transforms = TransformBroadcaster(self, moving=False)
        if self.settings.publish_tf:
            tip = transform_stamped(self.tool.X_Ttip, self.now(), self.frames.tool, self.frames.tip)
            transforms.send_static(tip)

    def _create_inputs(self) -> None:
        self.listen(PoseStamped, "current_pose", self._on_pose, QUEUE, refused="poses_refused")
        self.listen(RelativePose, "relative_pose", self._on_estimate, QUEUE, refused="estimates_refused")
        self.listen(HybridMsg, "~/setpoint", self._on_hybrid, COMMAND, refused="setpoints_unreadable")
        self.listen(WrenchMsg, "~/wrench_setpoint", self._on_wrench, COMMAND, refused="setpoints_unreadable")
        self.listen(
            RelativePoseMsg, "~/relative_pose_setpoint", self._on_relative, COMMAND, refused="setpoints_unreadable"
        )
        self.listen(WrenchStamped, "arm_wrench", self._on_arm_wrench, QUEUE, refused="arm_wrench_refused")
        self.loop.poll(String, "arm_hold_reason", self._on_arm_hold, LATCHED)

    def _create_services(self) -> None:
        s = self.settings
        self.serve(SetBool, "~/enable", self._enable)
        operator = Operator(self, "~/follow_setpoints", s.operator_timeout, must_beat=s.operator_beats)
        self.follow = FollowServer(self, self.core, self._why_not, operator, s.operator_lost, self.frames.base)
        self.payload = PayloadIdentification(self, self.core, lambda: self.follow.busy)

    # in
    @contextmanager
    def _telling(self, kind: str) -> Iterator[None]:
        """What is refused here, before the controller sees it, is told in its state, too."""
        try:
            yield
        except SeedError as error:
            self.core.refused(kind, str(error))
            raise

    def _on_pose(self, message: PoseStamped) -> None:
        with self._telling("kinematics"):
            check_frame(message.header.frame_id, (self.frames.base,), "current_pose")
            X_WE = pose_to_matrix(message.pose, "current_pose")
            stamp = self._dated(message, self.parameters.kinematics_timeout, "current_pose")
        if self.core.add_kinematics(stamp, X_WE):
            self._here, self._here_at = X_WE, stamp

    def _on_estimate(self, message: RelativePose) -> None:
        with self._telling("estimates"):
            check_frame(message.header.frame_id, (self.frames.compliance,), "relative_pose")
            check_frame(message.child_frame_id, (self.frames.tool,), "relative_pose (child)")
            self._dated(message, self.parameters.max_estimate_age, "relative_pose")
            estimate = estimate_from_message(message)
        self._estimator_says = estimate.reason
        self.grip.estimate(estimate)
        self.core.add_estimate(self._pressures.into(estimate) if self._pressures else estimate)

    def _on_arm_wrench(self, message: WrenchStamped) -> None:
        check_frame(message.header.frame_id, (self.frames.flange,), "arm_wrench")
        stamp = self._dated(message, self.parameters.kinematics_timeout, "arm_wrench")
        self.core.add_arm_wrench(stamp, wrench_to_core(message.wrench, "arm_wrench"))

    def _dated(self, message: Any, most_ahead: float, name: str) -> float:
        """A message's stamp [s]. Raises MessageError when it is further ahead of now."""
        stamp = seconds(message.header.stamp)
        check_not_ahead(stamp, self.now(), most_ahead, name)
        return stamp

    def _on_hybrid(self, message: HybridMsg) -> None:
        with self._telling("setpoints"):
            setpoint = hybrid_setpoint(message, self.frames)
        self._take(setpoint)

    def _on_wrench(self, message: WrenchMsg) -> None:
        with self._telling("setpoints"):
            setpoint = wrench_setpoint(message, self.frames, self.tool)
        self._take(setpoint)

    def _on_relative(self, message: RelativePoseMsg) -> None:
        with self._telling("setpoints"):
            setpoint = relative_pose_setpoint(message, self.frames)
        self._take(setpoint)

    def _take(self, setpoint: Setpoint) -> None:
        """A set-point from a topic; while a task is played it is refused."""
        if self.follow.busy or self.payload.busy:
            why = "a set-point came while a task is played: cancel the task first"
            self.counters.add("setpoints_during_task", why)
            self.core.refused("setpoints", why)
            return
        with self.counters.refusing("setpoints_refused"):
            self.core.set_setpoint(setpoint, self.now())

    def _on_limits(self, parameters: ControllerParameters) -> None:
        self.parameters = parameters
        self.core.set_limits(parameters, self.now())

    def _on_stiffness(self, stiffness: Stiffness) -> None:
        self.core.set_stiffness(stiffness, self.now())

    def _on_arm_hold(self, message: String) -> None:
        """What moves the arm follows nothing any more; or, with an empty reason, what comes from now on."""
        self._arm_holds = arm_holds(self, message.data)
        if message.data:
            self.core.hold(self.now(), self._arm_holds)
        self._readiness.look(self.now(), at_once=True)

    def _why_not(self) -> str:
        """Why no task may begin, beyond what the controller says; '' for nothing."""
        weighing = "the tool is being weighed: wait for controller/weigh_tool to answer" if self.payload.busy else ""
        return weighing or self._arm_holds or self.grip.hold or self._estimator_clock.skew.problem

    def _enable(self, on: bool) -> str:
        if on:
            self.loop.take()  # what came before it must not be taken for news afterwards; nor must the clock be old
            clock = self._estimator_clock
            if why := self._arm_holds or self.grip.hold or clock.skew.problem or clock.pending(self.now()):
                raise ControlRefusedError(f"cannot enable: {why}")
            self.core.enable(self.now())
            return "enabled: send a set-point or a task"
        self.core.disable(self.now(), "disabled by controller/enable off")
        return "disabled: the arm comes to rest and holds"

    # the step
    def _step(self) -> None:
        now = self.now()
        self._estimator_clock.look(now)
        self.core.checks.clock_problem = self.clocks.problem or self._estimator_clock.not_taken_off
        if skewed := self._estimator_clock.skew.problem:
            self.core.hold(now, skewed)
        self.follow.before_step(now)
        self.payload.before_step(now)
        self._output = output = self.core.step(now)
        self.grip.after_step(now)
        self.steps += 1
        if output.X_WE is not None and self._may_send(output):
            self._target.publish(pose_stamped(output.X_WE, now, self.frames.base))
            self.beats.add(output.state.image_age)
        self.follow.after_step(output.state)
        if self.steps % self._state_every == 0:
            self._publish_state(now, output)

    def _may_send(self, output: ControlOutput) -> bool:
        """From the first enable on; no more once an arm holds, was moved by something else or was gone, until enable.

        Or else it would be sent back to where it was as soon as it follows again, before any enable. And an arm that
        was resumed, and then hears the targets of a controller that is not enabled yet, would take each pause of them
        on a busy machine for another silence.
        """
        assert output.X_WE is not None
        away = self.core.away(self._here)
        enabled, holding = output.state.enabled, output.state.mode == "holding"
        if enabled and not holding:
            self._was_enabled = True
        elif self._arm_holds:
            self._was_enabled = False
        elif self._was_enabled and (away or self.now() - self._here_at > self.parameters.kinematics_timeout + GONE):
            self._was_enabled = False
            what = "was moved by something else" if away else "is not heard any more"
            self.counters.add("moved_by_others", f"the arm {what}; target_frame pauses until enable")
        return self._was_enabled

    def _publish_state(self, now: float, output: ControlOutput) -> None:
        message = stamped(StateMsg, now, self.frames.base)
        fill_state(message, output.state, self.core.law.setpoint, self.core.law.regulated_error())
        message.steps = self.steps
        message.ignored_poses += self.counters["poses_refused"]
        message.ignored_estimates += self.counters["estimates_refused"]
        message.refused_setpoints += self.counters["setpoints_unreadable"] + self.counters["setpoints_during_task"]
        message.estimator_reason = self._estimator_says
        self._state.publish(message)
        self._readiness.look(now)
        if self.core.law.setpoint is not None:
            self._reference.publish(pose_stamped(self.core.law.setpoint.X_W_tip, now, self.frames.base))
        if output.state.estimated is not None:
            stamp = now - output.state.image_age
            in_base = output.state.estimated.rotated(output.state.R_W_task)
            self._wrench.publish(self._wrench_estimate(in_base, stamp, output.state))
            self._drawn.publish(wrench_stamped(in_base, stamp, self.frames.base))

    def _wrench_estimate(self, wrench: Wrench, stamp: float, state: ControllerState) -> WrenchEstimate:
        message = stamped(WrenchEstimate, stamp, self.frames.base)
        fill_wrench(message.wrench, wrench)
        if state.covariance is not None:
            message.covariance = swap_halves(state.covariance).ravel()
        message.model = self.core.wrench_estimator.model.name
        message.reason = "; ".join((*state.contradictions, *filter(None, (state.doubt,))))
        return message

    def _report(self) -> diagnostics.Report:
        values: dict[str, object] = {"steps": self.steps, "last_refused": self.counters.last, **self.counters.values()}
        if self._output is None:
            return diagnostics.STALE, "no step yet", values
        state = self._output.state
        values |= state.counters._asdict() | {"mode": state.mode, "law": self.parameters.law}
        if len(self.loop.periods) > 10:
            values |= diagnostics.percentiles_ms("period", self.loop.periods, 3) | {"overruns": self.loop.overruns}
        skew = self._estimator_clock.skew
        values |= self._estimator_clock.values() | {"clocks": self.clocks.remark}
        late = self.core.supervisor.watch.late
        if late.error is not None:
            values |= {"stamp_error_ms": 1e3 * late.error, "stamp_error_deviation_ms": 1e3 * late.deviation}
        doubts = "; ".join(filter(None, (skew.problem or skew.doubt, late.warning, *state.contradictions, state.doubt)))
        holding = state.mode == "holding"
        level = diagnostics.WARN if holding or doubts else diagnostics.OK
        return level, (state.reason if holding else doubts or state.reason) or state.mode, values


main = ControllerNode.main

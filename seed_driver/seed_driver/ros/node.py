# SPDX-License-Identifier: Apache-2.0
"""The driver's ROS node: a lifecycle node that wires topics, services and parameters to the servo process."""

from __future__ import annotations

import sys
import time
from concurrent.futures import Future as ThreadFuture
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from seed_core.arm.target_checks import Target, refusal
from seed_core.errors import SeedError
from seed_driver.config import FIXED, DriverConfig, from_json, to_json
from seed_driver.motion.kinematics import arm_kinematics, out_of_reach
from seed_driver.process.shared_memory import State
from seed_driver.process.supervisor import Supervisor
from seed_driver.robot.dashboard import dashboard
from seed_driver.ros.outputs import Outputs
from seed_ros.conversions import seconds
from seed_ros.loop import FixedRateLoop
from seed_ros.node import run
from seed_ros.parameters import refuse_unknown
from seed_ros.qos import COMMAND

LOOP_RATE = 500.0  # [Hz] at which targets are looked for
SERVICES_EVERY = 0.02  # [s]
REPEAT = 1.0  # [s] the same warning is not repeated earlier
ANSWER_TIMEOUT = 8.0  # [s] of a service call


class DriverNode(LifecycleNode):
    """See docs/driver.md for what it offers."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("driver", **arguments)
        self.declare_parameter("autostart", True)
        for name, value in to_json(DriverConfig()).items():
            # any type is let in here: the check in on_configure says what would have been right
            self.declare_parameter(name, value, ParameterDescriptor(description=_describe(name), dynamic_typing=True))
        refuse_unknown(self)
        self.supervisor: Supervisor | None = None
        self.config: DriverConfig | None = None
        self.refused = 0
        self.accepted = 0
        self._waiting: dict[int, tuple[Future, float]] = {}
        self._thread = ThreadPoolExecutor(1, "dashboard")
        self._thread_calls: list[tuple[ThreadFuture[str], Future]] = []
        self._said: dict[str, float] = {}
        self.outputs: Outputs | None = None
        self.loop = FixedRateLoop(self, LOOP_RATE, self._step, steady=True, rest=SERVICES_EVERY)
        self.loop.poll(PoseStamped, "target_frame", self._on_target, COMMAND)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._use_parameters)
        self._offer_services()

    # lifecycle
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """Check the settings; FAILURE, with the reason in the log and the diagnostics, when they are wrong."""
        try:
            self.config = from_json(self._settings()).check()
            self.arm = arm_kinematics(self.config)
        except (SeedError, TypeError) as error:
            self.config = None
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self.outputs = Outputs(self, self.config)
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start the servo process; the link may come up later, see ~/hold_reason."""
        assert self.config is not None
        self.supervisor = Supervisor(self.config)
        self.supervisor.start(start_program=True)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Come to rest, end the program and the servo process."""
        self._release()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """Give the publishers back."""
        self._release()
        if self.outputs is not None:
            self.outputs.destroy()
            self.outputs = None
        self.config = None
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """As deactivate."""
        self._release()
        return TransitionCallbackReturn.SUCCESS

    def _release(self) -> None:
        if self.supervisor is not None:
            self.supervisor.close()
            if self.outputs is not None and self.context.ok():
                self.outputs.publish_inactive(self.supervisor.state)
            self.supervisor = None
        for future, _ in self._waiting.values():
            future.set_result((False, "the driver was deactivated"))
        self._waiting.clear()
        for _, future in self._thread_calls:
            future.set_result("the driver was deactivated")
        self._thread_calls.clear()

    def destroy_node(self) -> None:
        """End the servo process too, also after half a construction."""
        self._release()
        self._thread.shutdown(wait=False, cancel_futures=True)
        super().destroy_node()

    # parameters
    def _settings(self) -> dict[str, Any]:
        names = to_json(DriverConfig())
        values = {name: self.get_parameter(name).value for name in names}
        return {n: list(v) if isinstance(names[n], list) and v is not None else v for n, v in values.items()}

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        known = to_json(DriverConfig())
        changes = {p.name: p.value for p in parameters if p.name in known}
        if self.config is None:
            return SetParametersResult(successful=True)  # everything is checked when the driver is configured
        fixed = sorted(set(changes) & set(FIXED))
        if fixed:
            reason = f"{fixed[0]} is fixed while the driver is configured: deactivate it and clean it up first"
            return SetParametersResult(successful=False, reason=reason)
        try:
            lists = {n: list(v) if isinstance(known[n], list) else v for n, v in changes.items()}
            from_json({**self._settings(), **lists}).check()
        except (SeedError, TypeError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _use_parameters(self, parameters: list[Parameter]) -> None:
        if self.config is not None and any(p.name in to_json(DriverConfig()) for p in parameters):
            self.config = from_json(self._settings())
            if self.supervisor is not None:
                self.supervisor.set_config(self.config)

    # topics
    def _step(self) -> None:
        if self.supervisor is None or self.outputs is None:
            return
        now = time.monotonic()
        state = self.supervisor.step(now)
        self.outputs.publish(state, now, self.refused, self.accepted, self.supervisor.deaths)
        self._answer(now)

    def _on_target(self, message: PoseStamped) -> None:
        received = time.monotonic()
        supervisor, config = self.supervisor, self.config
        if supervisor is None or config is None:
            return
        state = supervisor.state
        if not state.armed:
            self.refused += 1
            self._warn(f"target_frame is not followed: {state.reason or 'no robot program'}{_remedy(state)}")
            return
        target = self._target(message)
        sample = state.sample
        x, y, z, w = state.command[3:7]
        command = _vector(state.command), (x, y, z, w)
        why = refusal(target, command, config) or out_of_reach(target, self.arm, sample.q)
        if why:
            self.refused += 1
            supervisor.send("refuse", reason=why)
            self._warn(f"refused: {why}")
            return
        self.accepted += 1
        supervisor.write_target(target.p, target.q, received)

    def _target(self, message: PoseStamped) -> Target:
        p, q = message.pose.position, message.pose.orientation
        age = self.get_clock().now().nanoseconds * 1e-9 - seconds(message.header.stamp)
        return Target(message.header.frame_id, age, (p.x, p.y, p.z), (q.x, q.y, q.z, q.w))

    def _warn(self, text: str) -> None:
        kind = text[:40]
        now = time.monotonic()
        if now - self._said.get(kind, float("-inf")) > REPEAT:
            self._said[kind] = now
            self.get_logger().warning(text)

    # services
    def _offer_services(self) -> None:
        group = ReentrantCallbackGroup()  # a call that waits for the robot does not hold up another

        def offer(kind: Any, name: str, callback: Any) -> None:
            self.create_service(kind, f"~/{name}", callback, callback_group=group)

        offer(Trigger, "stop", self._request("stop"))
        offer(Trigger, "zero_ftsensor", self._request("zero_ft"))
        offer(Trigger, "resend_robot_program", self._request("start"))
        offer(SetBool, "set_freedrive", self._freedrive)
        offer(Trigger, "unlock_protective_stop", self._dashboard("unlock protective stop", "releasing"))
        offer(Trigger, "power_on", self._dashboard("brake release", "releasing", first="power on"))

    def _request(self, do: str) -> Any:
        async def callback(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.success, response.message = await self._ask(do)
            return response

        return callback

    async def _freedrive(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success, response.message = await self._ask("freedrive", on=bool(request.data))
        return response

    def _ask(self, do: str, **arguments: Any) -> Future:
        future = Future()
        if self.supervisor is None:
            future.set_result((False, "the driver is not active"))
            return future
        number = self.supervisor.send(do, **arguments)
        self._waiting[number] = (future, time.monotonic() + ANSWER_TIMEOUT)
        return future

    def _dashboard(self, command: str, expected: str, first: str = "close safety popup") -> Any:
        async def callback(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            if self.supervisor is None or self.config is None:
                response.success, response.message = False, "the driver is not active"
                return response
            future = Future()
            call = self._thread.submit(dashboard, self.config.robot_ip, first, command)
            self._thread_calls.append((call, future))
            answer = await future
            response.success, response.message = expected in answer.lower(), answer
            return response

        return callback

    def _answer(self, now: float) -> None:
        """Pass on what has been answered since the last look."""
        assert self.supervisor is not None
        for number, (future, deadline) in list(self._waiting.items()):
            reply = self.supervisor.replies.pop(number, None)
            if reply is not None:
                future.set_result((reply.ok, reply.text))
            elif now > deadline:
                future.set_result((False, f"no answer within {ANSWER_TIMEOUT} s"))
            else:
                continue
            del self._waiting[number]
        for call, future in [c for c in self._thread_calls if c[0].done()]:
            error = call.exception()
            future.set_result(str(error) if error is not None else call.result())
            self._thread_calls.remove((call, future))


def _vector(numbers: tuple[float, ...]) -> tuple[float, float, float]:
    return numbers[0], numbers[1], numbers[2]


def _remedy(state: State) -> str:
    return "; call ~/resend_robot_program" if state.linked else ""


def _describe(name: str) -> str:
    meta = DriverConfig.__dataclass_fields__[name].metadata
    bounds = "" if meta["low"] == float("-inf") else f", {meta['low']:g} to {meta['high']:g}"
    return f"{meta['doc']} [{meta['unit'] or '-'}{bounds}]"


def _create() -> DriverNode:
    """The node; with autostart it configures and activates itself."""
    node = DriverNode()
    if node.get_parameter("autostart").value:
        if node.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            node.trigger_activate()
        else:
            node.get_logger().error("not configured: correct the parameter, then configure and activate the node")
    return node


def main() -> None:
    """Run the node until it is interrupted."""
    sys.exit(run(_create))


if __name__ == "__main__":
    main()

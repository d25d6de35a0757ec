# SPDX-License-Identifier: Apache-2.0
"""A client of a running cell: prepare it, play a task, look at the fingers."""

import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import rclpy
from action_msgs.srv import CancelGoal
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from seed_msgs.action import FollowSetpoints
from seed_msgs.msg import ControllerState
from sensor_msgs.msg import Image
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from unique_identifier_msgs.msg import UUID

from seed_bringup.ros.played_goal import PlayedGoal
from seed_control.tasks import task_to_send
from seed_core.errors import FailedError, SeedError
from seed_ros.conversions import seconds
from seed_ros.loop import realtime
from seed_ros.node import client_node, no_security
from seed_ros.qos import COMMAND, LATCHED

AGAIN = 2.0  # [s] after which an unanswered request to cancel is sent again
ANSWERED = 3.0  # [s] for a goal that is interrupted on its way to be answered
MEET = 0.3  # [s] for an action server to know its new client: until then it leaves its answers out
BEAT = 0.1  # [s] between two signs of life of whoever has a task played
PRIORITY = 10  # of SCHED_FIFO for them, where the system allows it: below every loop of the cell
ALONE = 4.0  # [s] without another node, after which there is no cell
SEEN = 5.0  # [s] for driver or simulation to be seen, and for the driver's answer
STUCK = 3.0  # [s] without a turn of the loop, after which there is none


class SessionError(FailedError):
    """The cell did not do what was asked; the message says which part and why."""


class SilenceError(SessionError):
    """Nobody answered, or what was waited for did not come, in time."""


@dataclass
class Played:
    """What came of a task: the result message, and when each phase began (ROS time [s])."""

    result: Any = None
    phases: list[tuple[str, float]] = field(default_factory=list)
    ended: float = 0.0
    contact: float | None = None  # [s] of first contact
    real_time_factor: float = 1.0


class Session:
    """One client of the cell; `watch` is called often and may raise to end everything."""

    def __init__(self, watch: Callable[[], None], follow: bool = True, namespace: str = "") -> None:
        """Join the graph.

        Args:
            follow: listen to the controller's state, which costs a fifth of a core.
            namespace: of the cell.
        """
        self.watch = watch
        self._turned = time.monotonic()  # when the loop went round last [s]
        try:
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            self.node = client_node("seed_client", namespace=namespace)
        except RuntimeError as error:
            raise SessionError(no_security(error) or str(error)) from error
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.state: ControllerState | None = None
        self.played = Played()
        self.holds: list[str] = []  # why the arm held during the task
        self.cancelling: Callable[[], None] = lambda: None  # called at once when an interrupt ends the task
        self._goal: Any = None  # the task that is played
        self._watched: PlayedGoal | None = None  # and whether its controller is there
        if follow:
            self.node.create_subscription(ControllerState, "controller/state", self._on_state, 10)
        for arm in ("driver", "sim"):
            self.node.create_subscription(String, f"{arm}/hold_reason", self._on_hold, LATCHED)

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()
        rclpy.try_shutdown()

    def _on_state(self, message: ControllerState) -> None:
        self.state = message
        if message.in_contact and self.played.contact is None and self.played.phases:
            self.played.contact = seconds(message.header.stamp)

    def _on_hold(self, message: String) -> None:
        if message.data and self.played.phases and not self.played.ended:
            self.holds.append(message.data)

    def spin(self, duration: float) -> None:
        """Let time pass."""
        self.until(lambda: False, duration, "")

    def until(self, condition: Callable[[], bool], patience: float, what: str) -> None:
        """Spin until a condition holds; SilenceError after `patience` [s] unless `what` is empty."""
        deadline = time.monotonic() + patience
        while not condition():
            self._turned = time.monotonic()
            self.watch()
            self._executor.spin_once(timeout_sec=0.05)
            if time.monotonic() > deadline:
                if what:
                    raise SilenceError(f"{what} within {patience:g} s")
                return

    def find(self, condition: Callable[[], bool], patience: float) -> None:
        """Spin until a condition holds: for up to `patience` [s], for ALONE [s] where there is no other node."""
        began, own = time.monotonic(), [self.node.get_name()]

        def over() -> bool:
            return condition() or (time.monotonic() - began > ALONE and self.node.get_node_names() == own)

        self.until(over, patience, "")

    def call(self, kind: Any, name: str, request: Any, patience: float = 20.0) -> Any:
        """A service's response; SessionError when it does not come or says no."""
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready, patience, f"no service {name}")
        future = client.call_async(request)
        self.until(future.done, patience, f"no answer of {name}")
        response = future.result()
        self.node.destroy_client(client)
        if not response.success:
            raise SessionError(f"{name}: {response.message}")
        return response

    def trigger(self, name: str, patience: float = 20.0) -> str:
        """Call a std_srvs/Trigger and return its message."""
        return str(self.call(Trigger, name, Trigger.Request(), patience).message)

    def switch(self, name: str, on: bool) -> str:
        """Call a std_srvs/SetBool and return its message."""
        return str(self.call(SetBool, name, SetBool.Request(data=on)).message)

    def enable(self, arm_service: str = "", patience: float = 15.0) -> None:
        """Enable arm (by its service, if it has one) and controller, as soon as their inputs are there."""
        if arm_service:
            self._insist(Trigger, arm_service, Trigger.Request(), patience)
        self._insist(SetBool, "controller/enable", SetBool.Request(data=True), patience)

    def _insist(self, kind: Any, name: str, request: Any, patience: float) -> None:
        deadline = time.monotonic() + patience
        while True:
            try:
                self.call(kind, name, request)
            except SessionError:
                if time.monotonic() > deadline:
                    raise
                self.spin(0.2)
            else:
                return

    def play(self, task: str, force: float | None, tell: Callable[[Any], None], patience: float) -> Played:
        """Play a task to its end; `tell` gets each feedback.

        task: name or file; force: [N] size of every force in it, its own if None; patience: [s] without progress.
        """
        overrides = "" if force is None else f"force: {force}"
        goal = FollowSetpoints.Goal(task=task_to_send(task), overrides=overrides)
        client = ActionClient(self.node, FollowSetpoints, "controller/follow_setpoints")
        try:
            return self._played(client, task, goal, tell, patience)
        finally:
            client.destroy()  # here and now: the middleware may wait for ever for one that is left to the collector

    def _played(
        self, client: ActionClient, task: str, goal: Any, tell: Callable[[Any], None], patience: float
    ) -> Played:
        self.until(client.server_is_ready, 20.0, "no action controller/follow_setpoints")
        self.spin(MEET)

        reached, since = ("", 0.0), time.monotonic()  # phase and progress, and when they came

        def on_feedback(message: Any) -> None:
            nonlocal reached, since
            phase = message.feedback.phase
            if (phase, message.feedback.progress) != reached:
                reached, since = (phase, message.feedback.progress), time.monotonic()
            if not self.played.phases or self.played.phases[-1][0] != phase:
                self.played.phases.append((phase, self.now()))
            if self._watched is not None:
                self._watched.hear()
            tell(message.feedback)

        def progressing() -> None:
            if time.monotonic() - since > patience:
                raise SilenceError(f"the task '{task}' made no progress for {patience:g} s")

        sent = client.send_goal_async(goal, feedback_callback=on_feedback)
        try:
            self.until(sent.done, 10.0, "follow_setpoints did not answer")
        except KeyboardInterrupt:
            self._call_back(client, sent)
            raise
        began, steady = self.now(), time.monotonic()
        self._goal = sent.result()
        self._watched = PlayedGoal(client, self._goal)
        result = self._goal.get_result_async()
        with self._beating(self._goal.goal_id):
            try:
                self._await_end(result, math.inf, "", progressing)
            except KeyboardInterrupt:
                self.cancelling()
                self.cancel()  # while it is still seen to
                raise
        self.played.result, self.played.ended = result.result().result, self.now()
        self.played.real_time_factor = (self.played.ended - began) / (time.monotonic() - steady)
        return self.played

    def _call_back(self, client: ActionClient, sent: Any) -> None:
        """Cancel a goal that was on its way as it was interrupted: nobody would see to its task."""
        self.until(sent.done, ANSWERED, "")
        if sent.done() and sent.result().accepted:
            self._goal = sent.result()
            self._watched = PlayedGoal(client, self._goal)
            self.cancelling()
            self.cancel()

    def _await_end(self, result: Any, patience: float, what: str, check: Callable[[], None] = lambda: None) -> None:
        """As `until`; `check` may raise. Raises SessionError: the controller that plays the task is gone."""

        def ended() -> bool:
            if not result.done() and self._watched is not None and (why := self._watched.why_over()):
                self._goal = None  # there is nothing to cancel
                raise SessionError(why)
            if not result.done():
                check()
            return bool(result.done())

        self.until(ended, patience, what)

    @contextmanager
    def _beating(self, goal: Any) -> Iterator[None]:
        """Tell the controller that somebody sees to the task: without that it ends.

        By a thread of its own, for on a busy machine messages keep the loop for long; while the loop turns at all. The
        whole process goes ahead of ordinary ones meanwhile, for the thread waits for an interpreter that does not run.
        """
        here, over = self.node.create_publisher(UUID, "controller/operator", COMMAND), threading.Event()

        def beat() -> None:
            while not over.wait(BEAT):
                if time.monotonic() - self._turned < STUCK:
                    here.publish(goal)

        here.publish(goal)
        thread = threading.Thread(target=beat, daemon=True)
        thread.start()
        try:
            with realtime(PRIORITY):
                yield
        finally:
            over.set()
            thread.join()

    def arm(self, patience: float = 20.0) -> str:
        """Which arm moves here, in words. Raises SeedError: no controller is here."""
        action = self.node.create_client(CancelGoal, "controller/follow_setpoints/_action/cancel_goal")
        self._find_controller(action, patience)
        self.node.destroy_client(action)
        client = self.node.create_client(GetParameters, "driver/get_parameters")
        self.until(lambda: client.service_is_ready() or "sim" in self.node.get_node_names(), SEEN, "")
        try:
            if client.service_is_ready():
                future = client.call_async(GetParameters.Request(names=["robot_ip"]))
                self.until(future.done, SEEN, "")
                values = future.result().values if future.done() else []
                return f"the arm at {values[0].string_value}" if values else "the arm of the driver"
        finally:
            self.node.destroy_client(client)
        return "a simulated arm" if "sim" in self.node.get_node_names() else "an arm of another maker's driver"

    def _find_controller(self, client: Any, patience: float) -> None:
        """Wait for the service of the controller's action. Raises SeedError: there is none, and why."""
        self.find(client.service_is_ready, patience)
        if client.service_is_ready():
            return
        if self.node.get_node_names() == [self.node.get_name()]:
            domain = os.environ.get("ROS_DOMAIN_ID", 0)
            raise SeedError(f"no cell is running in ROS domain {domain}: ./seed launch cell starts one")
        raise SeedError(
            f"no action controller/follow_setpoints within {patience:g} s, though other nodes are here: does the "
            "cell's controller run? If the cell has a namespace, say --namespace"
        )

    def cancel_all(self, patience: float = 10.0) -> int:
        """End whatever task is played, whoever began it; how many there were."""
        client = self.node.create_client(CancelGoal, "controller/follow_setpoints/_action/cancel_goal")
        self._find_controller(client, patience)
        asked: list[Any] = []

        def answered() -> bool:
            if time.monotonic() >= began + AGAIN * len(asked):  # a request or its answer may be lost while nodes meet
                asked.append(client.call_async(CancelGoal.Request()))  # no goal and no time: all of them
            return any(future.done() for future in asked)

        began = time.monotonic()
        self.until(answered, patience, "no answer of controller/follow_setpoints")
        return max(len(future.result().goals_canceling) for future in asked if future.done())

    def cancel(self, patience: float = 60.0) -> None:
        """End the task, if one is played: the tool is lifted."""
        if self._goal is not None:
            self._goal.cancel_goal_async()
            ended = self._goal.get_result_async()
            self._await_end(ended, patience, "the cancelled task did not end")
            self.played.result = ended.result().result

    @property
    def pressing_force(self) -> float:
        """As estimated [N]; 0 before the controller's first state."""
        return 0.0 if self.state is None else -float(self.state.estimated.force.z)

    def picture(self, topic: str, keep: Callable[[bytes], None], delay: float = 0.0) -> None:
        """Take one image of a topic, `delay` [s] from now, as PNG."""
        holder: dict[str, Any] = {}

        def on_image(message: Image) -> None:
            if "subscription" not in holder:
                return
            self.node.destroy_subscription(holder.pop("subscription"))
            keep(_png(message))

        def begin() -> None:
            holder.pop("timer").cancel()
            holder["subscription"] = self.node.create_subscription(Image, topic, on_image, qos_profile_sensor_data)

        holder["timer"] = self.node.create_timer(max(delay, 1e-3), begin)

    def now(self) -> float:
        """Time of the controller's newest state [s]."""
        return 0.0 if self.state is None else seconds(self.state.header.stamp)


def _png(message: Image) -> bytes:
    """A bgr8 image, enlarged so that dots are seen, as PNG."""
    pixels = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
    bgr = pixels[:, : 3 * message.width].reshape(message.height, message.width, 3)
    large = cv2.resize(bgr, None, fx=2.0, fy=2.0, interpolation=cv2.INTER_CUBIC)
    return bytes(cv2.imencode(".png", large)[1])

# SPDX-License-Identifier: Apache-2.0
"""What the buttons do: calls of the cell's services and its action, by a node with a thread of its own.

Nothing here waits in a callback, so that Stop goes out at once however slow a page or another call is: its requests are
sent by the very thread that hears the click. Of two pages that ask for different things the first is served, the other
is told so; Stop is always served.
"""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Sequence
from typing import Any

from action_msgs.srv import CancelGoal
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from seed_msgs.action import FollowSetpoints
from std_srvs.srv import SetBool, Trigger
from unique_identifier_msgs.msg import UUID

from seed_bringup.page.panel import Playing
from seed_core.errors import SeedError
from seed_core.hand import Frame, Tool
from seed_ros import COMMAND

BEAT = 0.1  # [s] between two signs of life of whoever has a task played
LOOK = 2.0  # [s] between two questions for the tool
PATIENCE, STOP_PATIENCE = 20.0, 1.0  # [s] for an answer; for that to a Stop
UNSEEN = 5.0  # [s] that nobody looks at the page while a task is played, after which it ends
STUCK = 3.0  # [s] that the page is not drawn anew, after which the same holds
KEPT = 20  # answers
TRIGGERS = (
    "estimator/capture_reference", "estimator/initialize_grasp", "sim/grasp", "sim/release",
    "driver/resend_robot_program", "sim/resend_robot_program", "guard/resend_robot_program",
    "driver/stop", "guard/stop",
)  # fmt: skip
STOPS = ("driver/stop", "guard/stop")
RESUMES = ("driver/resend_robot_program", "guard/resend_robot_program", "sim/resend_robot_program")
ENABLE = "controller/enable"
ACTION = "controller/follow_setpoints"


class NotDoneError(SeedError):
    """The cell did not do what was asked, in its own words."""


class CellHands:
    """See Hands of panel.py. `saw` is called with every picture while a page is open."""

    def __init__(self, context: Context, tasks: Sequence[str], namespace: str = "", name: str = "page_hands") -> None:
        self.tasks = tasks
        self.playing = Playing()
        self.said: Sequence[tuple[bool, str]] = ()
        self._lines: deque[tuple[bool, str]] = deque(maxlen=KEPT)
        self._lock = threading.Lock()
        self._busy = ""  # the button that is being served
        self._stops = 0  # presses of Stop so far
        self._spoken = 0  # answers so far
        self._seen = self._drawn = time.monotonic()
        self._deadlines: list[tuple[float, Future, str]] = []
        self._goal: Any = None
        self.node = Node(name, context=context, namespace=namespace or None, start_parameter_services=False)
        self._triggers = {t: self.node.create_client(Trigger, t) for t in TRIGGERS}
        self._enable = self.node.create_client(SetBool, ENABLE)
        self._cancel = self.node.create_client(CancelGoal, f"{ACTION}/_action/cancel_goal")
        self._parameters = self.node.create_client(GetParameters, "controller/get_parameters")
        self.tool: Tool | None = None  # as the controller knows it
        self._action = ActionClient(self.node, FollowSetpoints, ACTION)
        self._here = self.node.create_publisher(UUID, "controller/operator", COMMAND)
        self.node.create_timer(BEAT, self._beat)
        self.node.create_timer(LOOK, self._look)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, name="hands", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and the node. A task that is played ends with it, for nobody sees to it."""
        self._executor.shutdown(timeout_sec=1.0)
        self._thread.join(timeout=2.0)
        self.node.destroy_node()

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException, RuntimeError):  # RCLError is one: the context has ended
            self._executor.spin()

    @property
    def simulated(self) -> bool:
        """Whether the gripper is simulated."""
        return bool(self._triggers["sim/release"].service_is_ready())

    def saw(self, viewers: int) -> None:
        """A picture was drawn for so many pages."""
        self._drawn = time.monotonic()
        if viewers:
            self._seen = self._drawn

    # Stop
    def stop(self) -> None:
        """Come to rest: sent here and now, whatever else is under way."""
        self._stops += 1
        pressed, sent = time.monotonic(), []
        calls = [(self._enable, SetBool.Request(data=False), ENABLE)]
        calls += [(self._triggers[t], Trigger.Request(), t) for t in STOPS]
        for client, request, name in calls:
            if client.service_is_ready():
                answer = client.call_async(request)
                answer.add_done_callback(lambda f, n=name: self._on_stopped(f, n, pressed))
                self._expect(answer, STOP_PATIENCE, name)
                sent.append(name)
        if not sent:
            self._say(False, "Stop: no cell answers. Use the arm's own emergency stop.")

    def _on_stopped(self, answer: Future, name: str, pressed: float) -> None:
        after = time.monotonic() - pressed
        node = name.split("/")[0]
        if answer.exception() is not None:
            self._say(False, f"Stop: {answer.exception()}. Use the arm's own emergency stop.")
        elif answer.result().success:
            self._say(True, f"Stop: {node} comes to rest ({1e3 * after:.0f} ms).")
        else:
            self._say(False, f"Stop: {node}: {answer.result().message}.")

    # the other buttons
    def press(self, button: str) -> None:
        """Reference, Grasp, Release, Enable or Lift."""
        if button == "Lift":  # ends a task, so it may come while one is played
            self._executor.create_task(self._serve("Cancel", self._lift, always=True))
            return
        steps = {"Reference": self._reference, "Grasp": self._grasp, "Release": self._release, "Enable": self._start}
        self._executor.create_task(self._serve(button, steps[button]))

    def play(self, task: str, force: float | None) -> None:
        """Play a task; force: [N] of every force in it, its own if None."""
        self._executor.create_task(self._serve(f"Play {task}", lambda: self._play(task, force)))

    def answered(self, press: Callable[[], None], patience: float) -> tuple[bool, str]:
        """Press, and wait up to patience [s] for the answer: whether it is good, and its words. Not for callbacks."""
        before, deadline = self._spoken, time.monotonic() + patience
        press()
        while self._spoken == before:
            if time.monotonic() > deadline:
                return False, f"no answer within {patience:g} s"
            time.sleep(0.01)
        return self.said[0]

    async def _serve(self, button: str, steps: Callable[[], Awaitable[str]], always: bool = False) -> None:
        """One button at a time; the answer goes to `said`."""
        with self._lock:
            if self._busy and not always:
                why = f"{button}: not now, {self._busy} is under way (asked for here or on another page)."
                self._say(False, f"{why} Wait for it, or press Stop.")
                return
            before, self._busy = self._busy, self._busy or button
        stops = self._stops
        try:
            words = await steps()
            if stops != self._stops and button == "Enable":
                await self._ask(self._enable, SetBool.Request(data=False), ENABLE)
                raise NotDoneError("Stop was pressed meanwhile, and Stop counts")
            self._say(True, f"{button}: {words}.")
        except SeedError as error:
            self._say(False, f"{button}: {error}.")
        finally:
            self._busy = before

    async def _reference(self) -> str:
        return await self._trigger("estimator/capture_reference")

    async def _grasp(self) -> str:
        words = []
        if self._triggers["sim/grasp"].service_is_ready():
            words.append(await self._trigger("sim/grasp"))
            await self._pause(0.4)  # until cameras show the grasp
        if self._triggers["estimator/initialize_grasp"].service_is_ready():
            words.append(await self._trigger("estimator/initialize_grasp"))
        if not words:
            raise NotDoneError("neither sim/grasp nor estimator/initialize_grasp is offered: does the cell run?")
        return "; ".join(words)

    async def _release(self) -> str:
        return await self._trigger("sim/release")

    async def _start(self) -> str:
        """Arm first, then controller; a Stop in between ends it."""
        stops = self._stops
        for name in RESUMES:
            if self._triggers[name].service_is_ready():
                await self._trigger(name)
        if stops != self._stops:
            raise NotDoneError("Stop was pressed meanwhile, and Stop counts")
        return str((await self._ask(self._enable, SetBool.Request(data=True), ENABLE)).message)

    async def _lift(self) -> str:
        if not self._cancel.service_is_ready():
            raise NotDoneError(f"{ACTION} is not offered: does the cell run?")
        answer = await self._within(self._cancel.call_async(CancelGoal.Request()), PATIENCE, ACTION)
        if not answer.goals_canceling:
            raise NotDoneError("no task is being played")
        return "the task ends, the tool is lifted"

    async def _play(self, task: str, force: float | None) -> str:
        if not self._action.server_is_ready():
            raise NotDoneError(f"{ACTION} is not offered: does the cell run?")
        overrides = "" if force is None else f"force: {force}"
        self.playing = Playing(task, "asked for", 0.0)
        self._seen = time.monotonic()
        try:
            goal = FollowSetpoints.Goal(task=task, overrides=overrides)
            sent = self._action.send_goal_async(goal, feedback_callback=self._on_feedback)
            self._goal = await self._within(sent, PATIENCE, ACTION)
            result = (await self._goal.get_result_async()).result
        finally:
            self.playing, self._goal = Playing(), None
        if not result.success:
            raise NotDoneError(result.message)
        return f"done in {result.duration:.1f} s; force within {result.force_rmse:.2f} N rms of what was wanted"

    def _on_feedback(self, message: Any) -> None:
        f = message.feedback
        phase = f"{f.phase} ({f.phase_index + 1} of {f.phase_count})" if f.phase_index < f.phase_count else f.phase
        self.playing = Playing(self.playing.task, phase, float(f.progress))

    # what is held
    def _look(self) -> None:
        """Ask the controller for the tool, which another cell may have changed."""
        if self._parameters.service_is_ready():
            names = ["tool.name", "tool.T_tip.position", "tool.T_tip.rpy_deg"]
            self._parameters.call_async(GetParameters.Request(names=names)).add_done_callback(self._on_tool)

    def _on_tool(self, answer: Future) -> None:
        response = answer.result()
        if response is not None and len(response.values) == 3:
            name, position, turned = response.values
            with contextlib.suppress(SeedError, ValueError):
                x, y, z = position.double_array_value
                roll, pitch, yaw = turned.double_array_value
                self.tool = Tool(name.string_value, Frame((x, y, z), (roll, pitch, yaw)))

    # waiting
    def _beat(self) -> None:
        """Tell the controller that somebody sees to the task; end what was waited for too long."""
        now = time.monotonic()
        if self._goal is not None and now - self._seen < UNSEEN and now - self._drawn < STUCK:
            self._here.publish(self._goal.goal_id)
        with self._lock:
            late = [d for d in self._deadlines if now > d[0]]
            self._deadlines = [d for d in self._deadlines if now <= d[0] and not d[1].done()]
        for _, future, name in late:
            if not future.done():
                future.set_exception(NotDoneError(f"no answer of {name}"))

    def _expect(self, future: Future, patience: float, name: str) -> None:
        """An answer that does not come within patience [s] is an error."""
        with self._lock:
            self._deadlines.append((time.monotonic() + patience, future, name))

    async def _within(self, future: Future, patience: float, name: str) -> Any:
        self._expect(future, patience, name)
        return await future

    async def _pause(self, duration: float) -> None:
        over = Future(executor=self._executor)
        timer = self.node.create_timer(duration, lambda: over.set_result(None))
        try:
            await over
        finally:
            self.node.destroy_timer(timer)

    async def _trigger(self, name: str) -> str:
        return str((await self._ask(self._triggers[name], Trigger.Request(), name)).message)

    async def _ask(self, client: Client, request: Any, name: str) -> Any:
        if not client.service_is_ready():
            raise NotDoneError(f"{name} is not offered: does the cell run, with this part?")
        response = await self._within(client.call_async(request), PATIENCE, name)
        if not response.success:
            raise NotDoneError(response.message)
        return response

    def _say(self, good: bool, words: str) -> None:
        self._lines.appendleft((good, words.removesuffix(".") if words[-2:] in ("..", "?.", "!.") else words))
        self.said = tuple(self._lines)
        self._spoken += 1

# SPDX-License-Identifier: Apache-2.0
"""What the buttons do: calls of the cell's services and its action, by a node with a thread of its own.

Nothing here waits in a callback, so that Stop goes out at once however slow a page or another call is: its requests are
sent by the very thread that hears the click. Of two pages that ask for different things the first is served, the other
is told so; Stop is always served. One that was pressed during an Enable is sent again when that has ended, however it
ended: the arm, or the controller, may have done the older request after the newer.
"""

import atexit
import contextlib
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Mapping, Sequence
from concurrent import futures
from typing import Any

from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.task import Future
from seed_msgs.action import FollowSetpoints
from std_srvs.srv import SetBool, Trigger
from unique_identifier_msgs.msg import UUID

from seed_bringup.demo.terminal import done_in
from seed_bringup.page.panel import Playing
from seed_bringup.page.ros.cell_parameters import CellParameters
from seed_bringup.page.ros.waiting import Deadlines, NotDoneError, UnansweredError
from seed_bringup.ros.played_goal import PlayedGoal
from seed_control.tasks import task_to_send
from seed_core.errors import SeedError
from seed_core.hand import Tool
from seed_ros import COMMAND, client_node

BEAT = 0.1  # [s] between two signs of life of whoever has a task played
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


Said = futures.Future[tuple[bool, str]]  # what came of a button: whether it was done, and the words
STOPPED = "Stop was pressed meanwhile, and Stop counts"


class CellHands:
    """See Hands of panel.py. `saw` is called with every picture while a page is open."""

    def __init__(
        self,
        context: Context,
        tasks: Sequence[str],
        namespace: str = "",
        name: str = "page_hands",
        tools: Mapping[str, str] | None = None,
    ) -> None:
        self.tasks, self.tools = tasks, tools or {}
        self.playing = Playing()
        self.said: Sequence[tuple[bool, str]] = ()
        self._lines: deque[tuple[bool, str]] = deque(maxlen=KEPT)
        self._lock = threading.Lock()
        self._busy = ""  # the button that is being served
        self._stops = 0  # presses of Stop so far
        self._seen = self._drawn = time.monotonic()
        self._deadlines = Deadlines()
        self._goal: Any = None
        self._watched: PlayedGoal | None = None  # the task that is played
        self._ended: Future | None = None  # its end
        own = ["--ros-args", "-r", f"__node:={name}"]  # a launch file names every node of its process
        self.node = client_node(name, context=context, namespace=namespace or None, cli_args=own)
        self._triggers = {t: self.node.create_client(Trigger, t) for t in TRIGGERS}
        self._enable = self.node.create_client(SetBool, ENABLE)
        self._cancel = self.node.create_client(CancelGoal, f"{ACTION}/_action/cancel_goal")
        self._known = CellParameters(self.node)
        self._action = ActionClient(self.node, FollowSetpoints, ACTION)
        self._here = self.node.create_publisher(UUID, "controller/operator", COMMAND)
        self.node.create_timer(BEAT, self._beat)
        self._closing = False
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, name="hands", daemon=True)
        atexit.register(self._end)  # whoever is interrupted before he has these hands cannot close them
        self._thread.start()

    def close(self) -> None:
        """End the thread and the node. A task that is played ends with it, for nobody sees to it."""
        self._end()
        atexit.unregister(self._end)
        self._action.destroy()
        self.node.destroy_node()

    def _end(self) -> None:
        """End the thread: were it in the middleware as Python ends, that would abort the process."""
        self._closing = True
        self._executor.shutdown(timeout_sec=1.0)
        with contextlib.suppress(RuntimeError):  # it was never started
            self._thread.join(timeout=2.0)

    def _spin(self) -> None:
        while not self._closing and self._executor.context.ok():
            try:
                self._executor.spin()
            except ExternalShutdownException:
                return
            except Exception as error:  # a fault in one callback: the other buttons go on, Stop's answers first of all
                if not self._closing and self._executor.context.ok():
                    self._say(False, f"The page has a fault: {type(error).__name__}: {error}.")
                    time.sleep(BEAT)  # one that comes again and again shall not take the whole processor

    @property
    def tool(self) -> Tool | None:
        """As the controller knows it."""
        return self._known.tool

    @property
    def begun(self) -> str:
        """As the simulation knows it."""
        return self._known.task

    @property
    def arm(self) -> str:
        """As its driver knows it."""
        return self._known.arm

    def forget(self) -> None:
        """Tool, arm and task are those of a cell that may have ended: until they are told anew."""
        self._known.forget()

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
    def stop(self) -> Said:
        """Come to rest: sent here and now, whatever else is under way. Good: everybody that was asked does."""
        self._stops += 1
        return self._send_stop()

    def _send_stop(self) -> Said:
        said, answers, pressed = Said(), list[tuple[bool, str]](), time.monotonic()
        calls = [(self._enable, SetBool.Request(data=False), ENABLE)]
        calls += [(self._triggers[t], Trigger.Request(), t) for t in STOPS]
        calls = [call for call in calls if call[0].service_is_ready()]
        if not calls:
            self._say(False, "Stop: no cell answers. Use the arm's own emergency stop.", said)

        def on_answer(answer: Future, name: str) -> None:
            good, words = _stopped(answer, name, time.monotonic() - pressed)
            self._say(good, words)
            with self._lock:
                answers.append((good, words))
                last = len(answers) == len(calls)
            if last:
                said.set_result((all(g for g, _ in answers), " ".join(w for _, w in sorted(answers))))

        for client, request, name in calls:
            answer = client.call_async(request)
            answer.add_done_callback(lambda f, n=name: on_answer(f, n))
            self._deadlines.expect(answer, STOP_PATIENCE, name)
        return said

    # the other buttons
    def press(self, button: str) -> Said:
        """Reference, Grasp, Release, Enable or Lift."""
        if button == "Lift":  # ends a task, so it may come while one is played
            return self._begin("Cancel", self._lift, always=True)
        stops = self._stops  # a Stop from now on counts
        steps = {
            "Reference": self._reference,
            "Grasp": self._grasp,
            "Release": self._release,
            "Enable": lambda: self._start(stops),
        }
        return self._begin(button, steps[button])

    def play(self, task: str, force: float | None) -> Said:
        """Play a task; force: [N] of every force in it, its own if None."""
        stops = self._stops
        return self._begin(f"Play {task}", lambda: self._play(task, force, stops))

    def _begin(self, button: str, steps: Callable[[], Awaitable[str]], always: bool = False) -> Said:
        said = Said()
        self._executor.create_task(self._serve(button, steps, said, always))
        return said

    async def _serve(self, button: str, steps: Callable[[], Awaitable[str]], said: Said, always: bool) -> None:
        """One button at a time, but those that come always; the answer goes to `said`."""
        if not always:
            if self._busy:
                why = f"{button}: not now, {self._busy} is under way (asked for here or on another page)."
                self._say(False, f"{why} Wait for it, or press Stop.", said)
                return
            self._busy = button
        try:
            self._say(True, f"{button}: {await steps()}.", said)
        except SeedError as error:
            self._say(False, f"{button}: {error}.", said)
        except Exception as error:
            self._say(False, f"{button}: the page has a fault: {type(error).__name__}: {error}.", said)
        finally:
            if not always:
                self._busy = ""

    async def _reference(self) -> str:
        return await self._trigger("estimator/capture_reference")

    async def _grasp(self) -> str:
        words = []
        if self._triggers["sim/grasp"].service_is_ready():
            words.append(await self._trigger("sim/grasp"))
            await self._pause(0.4)  # until cameras show the grasp
        if self._triggers["estimator/initialize_grasp"].service_is_ready():
            try:
                words.append(await self._trigger("estimator/initialize_grasp"))
            except NotDoneError as error:
                if not words:
                    raise
                raise NotDoneError(f"{error}; {await self._open_again()}") from None
        if not words:
            raise NotDoneError("neither sim/grasp nor estimator/initialize_grasp is offered: does the cell run?")
        return "; ".join(words)

    async def _open_again(self) -> str:
        """Release, for a reference, as may be needed, is of an open gripper; how the gripper is."""
        try:
            await self._release()
        except NotDoneError as error:
            return f"the gripper stays closed: {error}"
        return "the gripper is open again"

    async def _release(self) -> str:
        return await self._trigger("sim/release")

    async def _start(self, stops: int) -> str:
        """Arm first, then controller; a Stop since then ends it, and so does silence. stops: pressed before."""
        silent = False
        try:
            for name in RESUMES:
                if self._triggers[name].service_is_ready() and stops == self._stops:
                    await self._trigger(name)
            if stops == self._stops:
                words = str((await self._ask(self._enable, SetBool.Request(data=True), ENABLE)).message)
        except UnansweredError:
            silent = True  # it may be done yet, when nobody waits for it any more
            raise
        finally:
            if silent or stops != self._stops:
                self._send_stop()
        if stops != self._stops:
            raise NotDoneError(STOPPED)
        return words

    async def _lift(self) -> str:
        if not self._cancel.service_is_ready():
            raise NotDoneError(f"{ACTION} is not offered: does the cell run?")
        answer = await self._deadlines.within(self._cancel.call_async(CancelGoal.Request()), PATIENCE, ACTION)
        if not answer.goals_canceling:
            if self._watched is not None:
                self._watched.ask()
            raise NotDoneError("no task is being played")
        return "the task ends, the tool is lifted"

    async def _play(self, task: str, force: float | None, stops: int) -> str:
        if stops != self._stops:
            raise NotDoneError(STOPPED)
        if not self._action.server_is_ready():
            raise NotDoneError(f"{ACTION} is not offered: does the cell run?")
        overrides = "" if force is None else f"force: {force}"
        self.playing = Playing(task, "asked for", 0.0)
        self._seen = time.monotonic()
        try:
            # what the cell was launched with is a file of its computer
            named = task if task == self.begun else task_to_send(task)
            goal = FollowSetpoints.Goal(task=named, overrides=overrides)
            sent = self._action.send_goal_async(goal, feedback_callback=self._on_feedback)
            self._goal = await self._deadlines.within(sent, PATIENCE, ACTION)
            if not self._goal.accepted:
                raise NotDoneError("the controller refuses the task")
            self._watched = PlayedGoal(self._action, self._goal)
            self._ended = self._goal.get_result_async()
            result = (await self._ended).result
        finally:
            self.playing, self._goal, self._watched, self._ended = Playing(), None, None, None
        if not result.success:
            raise NotDoneError(result.message)
        return done_in(result.duration, result.force_rmse)

    def _on_feedback(self, message: Any) -> None:
        if self._watched is not None:
            self._watched.hear()
        f = message.feedback
        phase = f"{f.phase} ({f.phase_index + 1} of {f.phase_count})" if f.phase_index < f.phase_count else f.phase
        self.playing = Playing(self.playing.task, phase, float(f.progress))

    # waiting
    def _beat(self) -> None:
        """Tell the controller that somebody sees to the task; end what was waited for too long."""
        now = time.monotonic()
        if self._goal is not None and now - self._seen < UNSEEN and now - self._drawn < STUCK:
            self._here.publish(self._goal.goal_id)
        self._deadlines.look(now)
        if self._watched is None or self._ended is None or self._ended.done():
            return
        if why := self._watched.why_over():
            self._ended.set_exception(UnansweredError(why))

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
        response = await self._deadlines.within(client.call_async(request), PATIENCE, name)
        if not response.success:
            raise NotDoneError(response.message)
        return response

    def _say(self, good: bool, words: str, said: Said | None = None) -> None:
        self._lines.appendleft((good, words.removesuffix(".") if words[-2:] in ("..", "?.", "!.") else words))
        self.said = tuple(self._lines)
        if said is not None:
            said.set_result(self._lines[0])


def _stopped(answer: Future, name: str, after: float) -> tuple[bool, str]:
    """What came of a Stop to a service, after so long [s]."""
    node = name.split("/")[0]
    if answer.exception() is not None:
        return False, f"Stop: {answer.exception()}. Use the arm's own emergency stop."
    if answer.result().success:
        return True, f"Stop: {node} comes to rest ({1e3 * after:.0f} ms)."
    return False, f"Stop: {node}: {answer.result().message}."

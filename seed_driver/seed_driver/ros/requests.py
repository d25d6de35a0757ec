# SPDX-License-Identifier: Apache-2.0
"""The driver's services: each waits for the servo process, or for the controller's dashboard, and blocks nothing."""

import time
from collections.abc import Callable
from concurrent.futures import Future as ThreadFuture
from functools import partial
from queue import SimpleQueue
from threading import Event, Thread
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from seed_core.errors import SeedError
from seed_driver.power.recovery import local_control, power_on, recover, restart_safety, unlock
from seed_driver.process.supervisor import Supervisor
from seed_driver.robot.link import LinkError
from seed_driver.robot.tool_io import set_tool_output, set_tool_voltage
from seed_ros import SeedNode

TOOL_OUTPUTS = (0, 1)
ANSWER_TIMEOUT = 8.0  # [s] of a service call


class RequestError(SeedError):
    """The robot did not do what a service asked for."""


class _Calls:
    """Made one after the other in a thread that, unlike an executor's, does not keep the process from ending."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[tuple[ThreadFuture[str], Callable[[], str]] | None] = SimpleQueue()
        Thread(target=self._make, name="dashboard", daemon=True).start()

    def submit(self, call: Callable[[], str]) -> ThreadFuture[str]:
        future: ThreadFuture[str] = ThreadFuture()
        self._queue.put((future, call))
        return future

    def close(self) -> None:
        """End the thread once the call that is being made has come back."""
        self._queue.put(None)

    def _make(self) -> None:
        while (entry := self._queue.get()) is not None:
            future, call = entry
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(call())
                except Exception as error:  # as an executor does: it is raised where the result is asked for
                    future.set_exception(error)


class Requests:
    """Served between `begin` and `end`; `answer` is called now and then."""

    def __init__(self, node: SeedNode, tool_voltage: Callable[[], int]) -> None:
        """tool_voltage: what is configured [V]."""
        self._tool_voltage = tool_voltage
        self._active: tuple[Supervisor, str] | None = None  # and the controller's address
        self._given_up = Event()
        self._waiting: dict[int, tuple[Future, float]] = {}  # answers by number of the request, and deadlines [s]
        self._thread = _Calls()
        self._thread_calls: list[tuple[ThreadFuture[str], Future]] = []
        group = ReentrantCallbackGroup()  # a call that waits for the robot does not hold up another
        services: dict[str, Callable[..., Any]] = {
            "stop": self._stop,
            "zero_ftsensor": partial(self._ask_servo, "zero_ft"),
            "resend_robot_program": partial(self._ask_servo, "start"),
            "unlock_protective_stop": self._unlock,
            "power_on": self._power_on,
            "restart_safety": self._restart_safety,
            "recover": self._recover,
        }
        for name, method in services.items():
            node.serve(Trigger, f"~/{name}", method, group=group)
        for pin in TOOL_OUTPUTS:
            node.serve(SetBool, f"~/set_tool_output_{pin}", partial(self._in_thread, set_tool_output, pin), group=group)
        node.serve(SetBool, "~/set_tool_power", self._power_tool, group=group)
        node.serve(SetBool, "~/set_freedrive", lambda on: self._ask_servo("freedrive", on=on), group=group)

    def begin(self, supervisor: Supervisor, robot_ip: str) -> None:
        """The driver is active."""
        self._active = supervisor, robot_ip

    def end(self) -> None:
        """The driver is not active any more."""
        self._active = None
        self._give_up()
        for future in (*(f for f, _ in self._waiting.values()), *(f for _, f in self._thread_calls)):
            future.set_exception(RequestError("the driver was deactivated"))
        self._waiting.clear()
        self._thread_calls.clear()

    def close(self) -> None:
        """End the thread as well."""
        self.end()
        self._thread.close()

    async def _ask_servo(self, do: str, **arguments: Any) -> str:
        """The servo process's answer to a request."""
        supervisor, _ = self._require_active()
        future, number = Future(), supervisor.send(do, **arguments)
        self._waiting[number] = (future, time.monotonic() + ANSWER_TIMEOUT)
        return str(await future)

    async def _stop(self) -> str:
        """Come to rest; no brake is released any more that somebody has asked for before."""
        self._give_up()
        return await self._ask_servo("stop")

    def _give_up(self) -> None:
        """End what the thread repeats until the robot does it, and what waits for the thread."""
        self._given_up.set()
        self._given_up = Event()
        for call, _ in self._thread_calls:
            call.cancel()

    async def _in_thread(self, call: Callable[..., str], *arguments: Any) -> str:
        """What `call(address of the robot, ...)` returns, made in the thread."""
        _, robot_ip = self._require_active()
        future = Future()
        self._thread_calls.append((self._thread.submit(partial(call, robot_ip, *arguments)), future))
        return str(await future)

    async def _power_tool(self, on: bool) -> str:
        """The voltage that is configured at the tool's connector, or none."""
        return await self._in_thread(set_tool_voltage, self._tool_voltage() if on else 0)

    def _safety_mode(self) -> int:
        """That the robot told last; 0 without a link."""
        state = self._require_active()[0].state
        return state.sample.modes.safety_mode if state.linked else 0

    async def _unlock(self) -> str:
        return await self._end_stop(partial(unlock, safety_mode=self._safety_mode(), pause=self._pause()))

    async def _restart_safety(self) -> str:
        return await self._in_thread(partial(restart_safety, safety_mode=self._safety_mode(), pause=self._pause()))

    def _pause(self) -> Callable[[float], None]:
        """Waits so long [s], as time.sleep does. Raises LinkError: it was given up meanwhile."""
        given_up = self._given_up

        def pause(duration: float) -> None:
            if given_up.wait(duration):
                raise LinkError("given up: the arm was stopped, or the driver deactivated, meanwhile")

        return pause

    async def _power_on(self) -> str:
        return await self._end_stop(partial(power_on, pause=self._pause()))

    async def _recover(self) -> str:
        return await self._end_stop(partial(recover, pause=self._pause()))

    async def _end_stop(self, call: Callable[..., str]) -> str:
        """Do what ends a stop; the arm waits for its program then, and hold_reason says if it takes none."""
        said = await self._in_thread(call)
        local = await self._in_thread(local_control)
        self._require_active()[0].send("wait", reason=local)
        return said

    def _require_active(self) -> tuple[Supervisor, str]:
        if self._active is None:
            raise RequestError("the driver is not active")
        return self._active

    def answer(self, now: float) -> None:
        """Pass on what has been answered since the last look; now: time.monotonic() [s]."""
        supervisor, _ = self._require_active()
        for number, (future, deadline) in list(self._waiting.items()):
            reply = supervisor.replies.pop(number, None)
            if reply is not None and reply.ok:
                future.set_result(reply.text)
            elif reply is not None or now > deadline:
                words = reply.text if reply is not None else f"no answer within {ANSWER_TIMEOUT} s"
                future.set_exception(RequestError(words))
            else:
                continue
            del self._waiting[number]
        for call, future in [c for c in self._thread_calls if c[0].done()]:
            error = None if call.cancelled() else call.exception()
            if call.cancelled():
                future.set_exception(RequestError("given up: the arm was stopped meanwhile"))
            elif error is not None:
                future.set_exception(RequestError(str(error)))
            else:
                future.set_result(call.result())
            self._thread_calls.remove((call, future))

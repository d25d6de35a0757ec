# SPDX-License-Identifier: Apache-2.0
"""One node under fuzz: its callbacks are called with nonsense, its clock is turned by hand, what it says is checked."""

import time
from collections.abc import Callable, Iterator
from functools import partial
from random import Random
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np
from rclpy.action import ActionServer
from rclpy.clock_type import ClockType
from rclpy.logging import LoggingSeverity
from rclpy.serialization import serialize_message
from rclpy.task import Future
from rclpy.time import Time
from unique_identifier_msgs.msg import UUID

from seed_core.errors import SeedError
from seed_ros.testing import Bench
from seed_testing.fuzz.nonsense import message, reals, spoil, text, value

START = 1000.0  # [s] that the nodes' clocks show first
STEP = 0.004  # [s] between two inputs
STAMPS = (-1e4, -10.0, -0.3, -0.05, 0.0, 0.0, 0.02, 0.3, 1e6)  # [s] from now
JUMPS = (0.02, 0.2, 1.5, 8.0, -0.5, -20.0)  # [s] of the clock
LONGEST = 1.0  # [s] of processor time for one input
# Not a number by their definition: no contact, nothing measured yet, nobody measures it.
MAY_BE_NAN = ("estimate_age", "centroid", "centroid_in_hand", "pressure", "force_rmse", "torque_rmse", "remaining")
FAR = 10.0  # [m] no arm reaches so far


class FuzzError(SeedError):
    """A node said what it must not say, or took too long."""


class Step(NamedTuple):
    """One input: what it is, the name of its topic, service or action, and what its content is drawn from."""

    what: str
    name: str
    seed: int


class Goal:
    """A goal of an action, as its server gets it."""

    def __init__(self, request: Any, check: Callable[[str, Any], None]) -> None:
        self.request, self._check = request, check
        self.is_cancel_requested = False
        self.goal_id = UUID(uuid=list(uuid4().bytes))

    def publish_feedback(self, feedback: Any) -> None:
        """Check it."""
        self._check("feedback", feedback)

    def succeed(self) -> None:
        """Nothing more."""

    abort = canceled = succeed


class Subject:
    """A node with its surroundings; a context manager.

    Attributes:
        node: the node.
        now: its time [s].
        inputs: what can be put into it: (what, name) and the callback.
    """

    parameters: dict[str, Any] = {}
    every = 1  # inputs per period of the node's loop

    def __init__(self, kind: Any) -> None:
        self.bench = Bench()
        try:
            given = {"use_sim_time": True, **self.parameters}
            self.node = self.bench.add(kind, **given)
        except BaseException:
            self.bench.close()
            raise
        self.now, self.longest, self._count = START, 0.0, 0
        self.said: dict[str, Any] = {}  # newest message by topic
        self.goals: list[Goal] = []
        self._turn_clock()
        self.inputs = {(what, name): call for what, name, call in self._inputs()}
        self.node.get_logger().set_level(LoggingSeverity.FATAL)  # a thousand refusals are not news
        self.prepare()
        self.turn()
        self.overhear()

    def __enter__(self) -> "Subject":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the node."""
        self.bench.close()

    # what a kind of node has besides
    def prepare(self) -> None:
        """Once, before the first input."""

    def calm(self) -> None:
        """Bring the node to where it works, by good inputs."""

    def background(self) -> None:
        """Good inputs that come all the while."""

    def good(self, rng: Random, name: str, kind: Any) -> Any:  # noqa: ARG002
        """A good message for an input; what is not told stays at its default."""
        return kind()

    # inputs
    def _inputs(self) -> Iterator[tuple[str, str, Callable[[Random], Any]]]:
        streams = {s: call for s, call in self.node.loop.streams.items() if s.topic_name != "/clock"}
        for subscription, call in streams.items():
            yield "in", self.short(subscription.topic_name), self._topic(subscription, call)
        for subscription in self.node.subscriptions:
            if subscription not in self.node.loop.streams and subscription.topic_name != "/clock":
                receive = partial(_without_information, subscription.callback)
                yield "in", self.short(subscription.topic_name), self._topic(subscription, receive)
        for service in self.node.services:
            yield "service", self.short(service.srv_name), partial(self._call, service=service)
        for server in self.node.waitables:
            if isinstance(server, ActionServer):
                yield "action", server._action_type.__name__, partial(self._send_goal, server=server)
        yield "time", "clock", self._jump
        yield "calm", "cell", lambda _: self.calm()

    def short(self, name: str) -> str:
        """A topic's or service's name relative to the node."""
        return name.removeprefix("/").replace(f"{self.node.get_name()}/", "~/", 1)

    def _topic(self, subscription: Any, call: Callable[[Any, Any], None]) -> Callable[[Random], Any]:
        name, kind = self.short(subscription.topic_name), subscription.msg_type

        def give(rng: Random) -> Any:
            made = self.drawn(rng, name, kind)
            call(_damaged(rng, serialize_message(made)) if subscription.raw else made, {})

        return give

    def drawn(self, rng: Random, name: str, kind: Any) -> Any:
        """A good message, one with some fields spoilt, or nonsense altogether."""
        if rng.random() < 0.05:
            return message(rng, kind)
        made = self.good(rng, name, kind)
        if hasattr(made, "header"):
            self._date(rng, made)
        if rng.random() < 0.5:
            for _ in range(rng.choice((1, 1, 1, 2, 4))):
                spoil(rng, made)
        return made

    def _date(self, rng: Random, made: Any) -> None:
        away = rng.choice(STAMPS) if rng.random() < 0.2 else 0.0
        made.header.stamp = Time(nanoseconds=max(0, int((self.now + away) * 1e9))).to_msg()

    def _call(self, rng: Random, service: Any) -> None:
        kind = service.srv_type
        request, response = self.drawn(rng, self.short(service.srv_name), kind.Request), kind.Response()
        if hasattr(request, "parameters") or hasattr(request, "names"):
            self._name_parameters(rng, request)
        answer = service.callback(request, response)
        if not hasattr(answer, "send"):
            self._check_answer(service.srv_name, answer)
        else:
            self._run(answer).add_done_callback(lambda task: self._check_answer(service.srv_name, task.result()))

    def _name_parameters(self, rng: Random, request: Any) -> None:
        known = [n for n in self.node.get_parameters_by_prefix("") if n != "use_sim_time"]  # the clock is ours
        if hasattr(request, "names"):
            request.names = [rng.choice((rng.choice(known), text(rng))) for _ in range(rng.randint(0, 4))]
        elif hasattr(request, "parameters"):
            kind = "rcl_interfaces/Parameter"
            request.parameters = [value(rng, kind) for _ in range(rng.randint(0, 3))]
            for parameter in request.parameters:
                parameter.name = rng.choice(known) if rng.random() < 0.9 else text(rng)
                parameter.value.type = rng.randint(0, 9) if rng.random() < 0.95 else rng.randint(0, 255)

    def _run(self, coroutine: Any) -> Future:
        """Until it waits for something; the rest at the looks of the node's loop."""
        return self.node.executor.create_task(_ending(coroutine))

    def _check_answer(self, name: str, answer: Any) -> None:
        if answer is None:
            raise FuzzError(f"{name} gives no answer")
        if getattr(answer, "success", True) is False and not getattr(answer, "message", "none by its type"):
            raise FuzzError(f"{name} refuses without a word")

    def _send_goal(self, rng: Random, server: Any) -> None:
        if self.goals and rng.random() < 0.3:
            self.goals[-1].is_cancel_requested = True
            return
        goal = Goal(self.drawn(rng, server._action_type.__name__, server._action_type.Goal), self._check)
        self.goals = [*self.goals[-3:], goal]
        self._run(server._execute_callback(goal))

    def _jump(self, rng: Random) -> None:
        self.now = max(START, self.now + rng.choice(JUMPS))
        self._turn_clock()

    def _turn_clock(self) -> None:
        self.node.get_clock().set_ros_time_override(
            Time(nanoseconds=int(self.now * 1e9), clock_type=ClockType.ROS_TIME)
        )

    # outputs
    def overhear(self) -> None:
        """Check what is published from now on, also by publishers that are new."""
        for publisher in self.node.publishers:
            if "publish" not in vars(publisher) and publisher.topic_name != "/parameter_events":
                self._overhear(publisher)

    def _overhear(self, publisher: Any) -> None:
        name, publish = self.short(publisher.topic_name), publisher.publish

        def listen(said: Any) -> None:
            self._check(name, said)
            publish(said)

        publisher.publish = listen

    def _check(self, name: str, said: Any) -> None:
        if isinstance(said, bytes) or hasattr(said, "encoding"):
            return  # images hold what is not a number where there is no depth
        self.said[name] = said
        for path, number in reals(said):
            if not np.isfinite(number) and not any(word in path.split(".") for word in MAY_BE_NAN):
                raise FuzzError(f"{name} is published with {path} = {number}")
        if hasattr(said, "pose") and hasattr(said.pose, "orientation"):
            p, q = said.pose.position, said.pose.orientation
            if abs(float(np.linalg.norm((q.x, q.y, q.z, q.w))) - 1.0) > 1e-3 or max(abs(p.x), abs(p.y), abs(p.z)) > FAR:
                raise FuzzError(f"{name} is published with position {p}, orientation {q}")

    # the run
    def apply(self, step: Step) -> None:
        """Put one input into the node and turn its loop. Raises whatever comes out."""
        began = time.thread_time()
        self.background()
        self.inputs[step.what, step.name](Random(step.seed))
        self.now += STEP
        self._turn_clock()
        self._count += 1
        if self._count % self.every == 0:
            self.node.loop.once()
        spent = time.thread_time() - began
        if step.what != "calm":
            self.longest = max(self.longest, spent)
            if spent > LONGEST:
                raise FuzzError(f"{step.what} {step.name} takes {spent:.2f} s of processor time")

    def turn(self, periods: int = 1) -> None:
        """The node's loop, without further inputs."""
        for _ in range(periods):
            self.now += STEP
            self._turn_clock()
            self.node.loop.once()


async def _ending(coroutine: Any) -> Any:
    return await coroutine


def _without_information(call: Callable[[Any], None], message: Any, _: Any) -> None:
    call(message)


def _damaged(rng: Random, data: bytes) -> bytes:
    """A serialized message, sometimes cut short or with other bytes in its head."""
    chance = rng.random()
    if chance < 0.05:
        return data[: rng.randrange(len(data))]
    if chance < 0.1:
        head = bytearray(data)
        for _ in range(rng.randint(1, 4)):
            head[rng.randrange(min(len(head), 100))] = rng.randrange(256)
        return bytes(head)
    return data

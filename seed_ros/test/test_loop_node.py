# SPDX-License-Identifier: Apache-2.0
"""A loop by a simulated clock: it keeps the clock's periods, and stands still where the clock does."""

import os
import threading
import time
from collections.abc import Iterator
from itertools import pairwise

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")

from rclpy.context import Context  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402

from seed_ros.conversions import stamp_from_seconds  # noqa: E402
from seed_ros.loop import FixedRateLoop  # noqa: E402
from seed_ros.qos import CLOCK  # noqa: E402

PERIOD = 0.01  # [s]


class Ticking:
    """A node whose loop runs in a thread and notes the time of each tick."""

    def __init__(self, context: Context) -> None:
        self.node = Node("ticking", context=context, parameter_overrides=[Parameter("use_sim_time", value=True)])
        self.times: list[float] = []
        self.loop = FixedRateLoop(self.node, 1.0 / PERIOD, self._tick)
        self.stopped = threading.Event()
        self.thread = threading.Thread(target=self.loop.run, args=(self.stopped.is_set,))
        self.thread.start()

    def _tick(self) -> None:
        self.times.append(self.node.get_clock().now().nanoseconds * 1e-9)


@pytest.fixture
def context() -> Iterator[Context]:
    context = Context()
    rclpy.init(args=[], context=context)
    yield context
    rclpy.try_shutdown(context=context)


def test_loop_follows_the_simulated_clock_and_stands_still_with_it(context: Context) -> None:
    source = Node("source", context=context)
    clock = source.create_publisher(Clock, "/clock", CLOCK)
    ticking = Ticking(context)
    try:
        deadline = time.monotonic() + 10.0
        while clock.get_subscription_count() < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert ticking.times == []  # no clock was heard yet
        for i in range(201):
            clock.publish(Clock(clock=stamp_from_seconds(100.0 + 0.1 * PERIOD * i)))
            time.sleep(0.004)
        counted = len(ticking.times)
        assert counted == pytest.approx(21, abs=2)
        assert ticking.times[-1] == pytest.approx(100.2, abs=2 * PERIOD)
        time.sleep(20 * PERIOD)
        assert len(ticking.times) == counted
        clock.publish(Clock(clock=stamp_from_seconds(50.0)))  # a bag that starts again
        time.sleep(0.1)
        assert ticking.times[-1] == pytest.approx(50.0, abs=PERIOD)
    finally:
        ticking.stopped.set()
        ticking.thread.join()
        ticking.node.destroy_node()
        source.destroy_node()


def test_priority_lasts_as_long_as_the_loop(context: Context) -> None:
    node, seen, before = Node("urgent", context=context), [], os.sched_getscheduler(0)
    try:
        loop = FixedRateLoop(node, 200.0, lambda: seen.append(os.sched_getscheduler(0)), priority=5)
        loop.run(lambda: len(seen) >= 2)
    finally:
        node.destroy_node()
    assert set(seen) <= {os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.SCHED_FIFO, os.SCHED_OTHER}  # as the system allows
    assert os.sched_getscheduler(0) == before


def test_the_middlewares_threads_have_the_loops_priority_too(context: Context) -> None:
    """Messages come from them: on a busy machine a loop that is on time would wait for threads that do not run."""
    node, seen = Node("urgent", context=context), []

    def look() -> None:
        seen.append({os.sched_getscheduler(int(t)) for t in os.listdir("/proc/self/task")})

    try:
        FixedRateLoop(node, 200.0, look, priority=5).run(lambda: len(seen) >= 2)
        threads = len(os.listdir("/proc/self/task"))
    finally:
        node.destroy_node()
    assert threads > 1
    assert len(seen[-1]) == 1  # all as the loop's own, which is SCHED_FIFO where the system allows it


def test_an_eager_loop_hands_over_messages_as_they_come(context: Context) -> None:
    source, listener = Node("source", context=context), Node("listener", context=context)
    publisher = source.create_publisher(Clock, "news", CLOCK)
    heard: list[Clock] = []
    loop = FixedRateLoop(listener, 1.0 / 30.0, lambda: None, steady=True, eager=True)  # one period is half a minute
    loop.poll(Clock, "news", heard.append, CLOCK)
    stopped = threading.Event()
    thread = threading.Thread(target=loop.run, args=(lambda: stopped.is_set() or len(heard) > 2,))
    thread.start()
    deadline = time.monotonic() + 10.0
    while thread.is_alive() and time.monotonic() < deadline:
        publisher.publish(Clock())
        time.sleep(0.05)
    stopped.set()
    publisher.publish(Clock())  # wakes it
    thread.join()
    assert len(heard) > 2
    for node in (source, listener):
        node.destroy_node()


def test_a_steady_loop_can_be_asked_for_a_period_between_the_regular_ones(context: Context) -> None:
    node, ticks = Node("asking", context=context), []
    loop = FixedRateLoop(node, 2.0, lambda: ticks.append(time.monotonic()), steady=True, eager=True)
    loop.poll(Clock, "news", lambda _: None, CLOCK)
    started = time.monotonic()  # deadlines are absolute: a first period that is late does not move the next
    loop.also_at(asked := started + 0.1)
    loop.run(lambda: len(ticks) >= 3)
    node.destroy_node()
    _, between, regular = ticks
    assert asked <= between < started + 0.5 <= regular


@pytest.mark.parametrize("catch_up", [True, False])
def test_a_late_loop_makes_up_for_what_it_missed_only_where_that_is_wanted(context: Context, catch_up: bool) -> None:
    node, ticks = Node("late", context=context), []

    def tick() -> None:
        ticks.append(time.monotonic())
        if len(ticks) == 3:
            time.sleep(3.5 * PERIOD)

    FixedRateLoop(node, 1.0 / PERIOD, tick, catch_up=catch_up).run(lambda: len(ticks) >= 10)
    node.destroy_node()
    shortest = min(b - a for a, b in pairwise(ticks))
    assert shortest < 0.5 * PERIOD if catch_up else shortest >= 0.8 * PERIOD

# SPDX-License-Identifier: Apache-2.0
"""The private names of rclpy are there in this release; where they are not, the loop does without them."""

import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from seed_ros import private_rclpy
from seed_ros.conversions import seconds, stamp_from_seconds
from seed_ros.loop import FixedRateLoop
from seed_ros.private_rclpy import can_poll, given_parameters
from seed_ros.qos import CLOCK, QUEUE

pytestmark = pytest.mark.ros


@pytest.fixture
def context() -> Iterator[Context]:
    context = Context()
    rclpy.init(args=[], context=context)
    yield context
    rclpy.try_shutdown(context=context)


def test_this_release_has_every_private_name(context: Context) -> None:
    assert can_poll()
    node = Node("given", context=context, parameter_overrides=[Parameter("nobody_declares_this", value=1)])
    assert list(given_parameters(node)) == ["nobody_declares_this"]
    node.destroy_node()


@pytest.mark.parametrize("there", [None, SimpleNamespace(WaitSet=object), SimpleNamespace(Subscription=object)])
def test_a_release_without_one_of_the_names_is_told(there: object) -> None:
    assert not can_poll(there)
    assert list(given_parameters(SimpleNamespace())) == []


@pytest.mark.parametrize("eager", [False, True])
@pytest.mark.parametrize("polls", [True, False])
def test_messages_reach_their_callbacks_in_order_with_and_without_the_private_names(
    context: Context, monkeypatch: pytest.MonkeyPatch, eager: bool, polls: bool
) -> None:
    if not polls:
        monkeypatch.setattr(private_rclpy, "can_poll", lambda: False)
        monkeypatch.delattr(private_rclpy, "take")
        monkeypatch.delattr(private_rclpy, "wait_for")
    source, listener = Node("source", context=context), Node("listener", context=context)
    publisher = source.create_publisher(Clock, "news", QUEUE)
    heard: list[float] = []
    raw: list[bytes] = []
    loop = FixedRateLoop(listener, 100.0, lambda: None, steady=True, eager=eager)
    loop.poll(Clock, "news", lambda message: heard.append(seconds(message.clock)), QUEUE)
    loop.poll(Clock, "news", lambda message, _: raw.append(message), QUEUE, raw=True)
    began = time.monotonic()
    thread = threading.Thread(target=loop.run, args=(lambda: len(raw) >= 10 or time.monotonic() > began + 20.0,))
    thread.start()
    while publisher.get_subscription_count() < 2 and time.monotonic() < began + 10.0:
        time.sleep(0.01)
    for i in range(10):
        publisher.publish(Clock(clock=stamp_from_seconds(float(i))))
        time.sleep(0.01)
    thread.join()
    assert heard == [float(i) for i in range(10)]
    assert len(raw) == 10
    assert all(isinstance(message, bytes) for message in raw)
    for node in (source, listener):
        node.destroy_node()


def test_a_simulated_clock_is_followed_without_the_private_names(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(private_rclpy, "can_poll", lambda: False)
    source = Node("source", context=context)
    clock = source.create_publisher(Clock, "/clock", CLOCK)
    node = Node("ticking", context=context, parameter_overrides=[Parameter("use_sim_time", value=True)])
    times: list[float] = []
    loop = FixedRateLoop(node, 100.0, lambda: times.append(node.get_clock().now().nanoseconds * 1e-9))
    stopped = threading.Event()
    thread = threading.Thread(target=loop.run, args=(stopped.is_set,))
    thread.start()
    deadline = time.monotonic() + 10.0
    i = 0
    while len(times) < 10 and time.monotonic() < deadline:
        clock.publish(Clock(clock=stamp_from_seconds(100.0 + 0.002 * i)))
        time.sleep(0.005)
        i += 1
    stopped.set()
    clock.publish(Clock(clock=stamp_from_seconds(1000.0)))
    thread.join()
    assert len(times) >= 10
    assert times[0] >= 100.0
    for n in (source, node):
        n.destroy_node()

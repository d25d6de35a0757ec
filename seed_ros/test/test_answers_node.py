# SPDX-License-Identifier: Apache-2.0
"""An answer reaches a client that the middleware did not know yet when it was ready."""

import warnings
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from rclpy.service import Service
from std_srvs.srv import Trigger

from seed_ros.loop import FixedRateLoop
from seed_ros.node import SeedNode
from seed_ros.services import answers
from seed_ros.testing import Bench

pytestmark = pytest.mark.ros


class Counting(SeedNode):
    def __init__(self, **arguments: Any) -> None:
        super().__init__("counting", **arguments)
        self.asked = 0
        self.loop = FixedRateLoop(self, 100.0, lambda: None, service_period=0.0)
        self.serve(Trigger, "~/count", self._count)

    def _count(self) -> str:
        self.asked += 1
        return f"{self.asked}"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setattr(answers, "AGAIN", 0.005)
    made = Bench()
    yield made
    made.close()


def lose(answers_lost: int, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Have rclpy leave out so many answers, as it does where the client is not known; those that it was given."""
    send, given = Service.send_response, list[Any]()

    def sends(self: Service, response: Any, header: Any) -> None:
        given.append(response)
        if len(given) <= answers_lost:
            warnings.warn("failed to send response (timeout): client will not receive response", RuntimeWarning, 1)
        else:
            send(self, response, header)

    monkeypatch.setattr(Service, "send_response", sends)
    return given


def test_an_answer_is_sent_again_until_the_client_is_known(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    given = lose(3, monkeypatch)
    node = bench.add(Counting)
    assert bench.call(Trigger, "counting/count", Trigger.Request()).message == "1"
    assert node.asked == 1  # what was asked for is done once
    assert len(given) == 4
    assert bench.call(Trigger, "counting/count", Trigger.Request()).message == "2"
    timers = len(list(node.timers))
    bench.spin(0.1)
    assert len(given) == 5
    assert len(list(node.timers)) == timers


def test_an_answer_that_nobody_takes_is_given_up(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    given = lose(1000, monkeypatch)
    node = bench.add(Counting)
    before = len(list(node.timers))
    client = bench.client.create_client(Trigger, "counting/count")
    assert bench.until(client.service_is_ready)
    client.call_async(Trigger.Request())
    assert bench.until(lambda: len(given) == answers.ATTEMPTS)
    bench.spin(0.5)
    assert len(given) == answers.ATTEMPTS
    assert len(list(node.timers)) == before

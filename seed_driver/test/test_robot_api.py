# SPDX-License-Identifier: Apache-2.0
"""Power, brakes and stops on PolyScope X, which has HTTP in place of the dashboard: against a server of that."""

import json
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, HTTPServer
from types import SimpleNamespace
from typing import Any

import pytest

from seed_driver.power import robot_api
from seed_driver.power.recovery import restart_safety
from seed_driver.power.robot_api import PATH, switch
from seed_driver.robot.link import LinkError

HOST = "127.0.77.3"


class Robot:
    """What was asked for; `refuses` answers `code` to so many of an action."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, Any]] = []
        self.refuses: dict[str, int] = {}
        self.code = 409
        self.takes = 0.0  # [s] for each action


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Iterator[Robot]:
    there = Robot()

    class Answers(BaseHTTPRequestHandler):
        def do_PUT(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            there.asked.append((self.path, body))
            time.sleep(there.takes)
            left = there.refuses.get(body["action"], 0)
            there.refuses[body["action"]] = left - 1
            self.send_response(there.code if left > 0 else 200)
            with suppress(OSError):  # nobody waits any more
                self.end_headers()
                self.wfile.write(b"not in remote mode" if left > 0 else b"{}")

        def log_message(self, *_: Any) -> None:
            pass

    with HTTPServer((HOST, 0), Answers) as server:
        monkeypatch.setattr(robot_api, "PORT", server.server_port)
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield there
        server.shutdown()
        thread.join()


def test_power_and_brakes_are_asked_for_in_turn_and_brakes_wait_for_the_power(robot: Robot) -> None:
    robot.refuses = {"BRAKE_RELEASE": 1}
    said = switch(HOST, "power on", "brake release", said="releasing")
    assert said == "POWER_ON, BRAKE_RELEASE: accepted by the Robot API"
    assert [body["action"] for _, body in robot.asked] == ["POWER_ON", "BRAKE_RELEASE", "BRAKE_RELEASE"]
    assert {path for path, _ in robot.asked} == {PATH}


def test_a_proxy_of_the_computer_is_not_asked(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("http_proxy", "http://127.0.77.5:9")
    for name in ("no_proxy", "NO_PROXY"):
        monkeypatch.delenv(name, raising=False)
    switch(HOST, "unlock protective stop", said="releasing")
    assert len(robot.asked) == 1


def test_a_refusal_is_told_at_once_with_what_to_do(robot: Robot) -> None:
    robot.refuses = {"UNLOCK_PROTECTIVE_STOP": 9}
    words = r"refuses UNLOCK_PROTECTIVE_STOP \(HTTP 409 not in remote mode\): is the robot in Automatic"
    with pytest.raises(LinkError, match=words):
        switch(HOST, "close safety popup", "unlock protective stop", said="releasing")
    assert len(robot.asked) == 1


def test_brakes_that_are_refused_for_good_are_asked_for_once(robot: Robot) -> None:
    robot.refuses, robot.code = {"BRAKE_RELEASE": 9}, 403
    with pytest.raises(LinkError, match=r"refuses BRAKE_RELEASE \(HTTP 403"):
        switch(HOST, "power on", "brake release", said="releasing")
    assert [body["action"] for _, body in robot.asked] == ["POWER_ON", "BRAKE_RELEASE"]


def test_waiting_for_the_brakes_ends_when_it_is_given_up(robot: Robot) -> None:
    robot.refuses = {"BRAKE_RELEASE": 99}
    pauses: list[float] = []

    def pause(duration: float) -> None:
        pauses.extend([duration] if duration else [])
        if len(pauses) == 2:
            raise LinkError("given up")

    with pytest.raises(LinkError, match="given up"):
        switch(HOST, "power on", "brake release", said="releasing", pause=pause)
    assert [body["action"] for _, body in robot.asked] == ["POWER_ON", "BRAKE_RELEASE", "BRAKE_RELEASE"]


def test_no_brake_is_released_where_it_was_given_up_while_the_power_came(robot: Robot) -> None:
    def given_up(_: float) -> None:
        raise LinkError("given up")

    with pytest.raises(LinkError, match="given up"):
        switch(HOST, "power on", "brake release", said="releasing", pause=given_up)
    assert [body["action"] for _, body in robot.asked] == ["POWER_ON"]


def test_an_answer_is_no_longer_waited_for_once_it_is_given_up(robot: Robot) -> None:
    """What waits for the same thread, as unlock_protective_stop, would come as late as that answer."""
    robot.takes = 3.0
    begun = time.monotonic()

    def given_up(_: float) -> None:
        if time.monotonic() - begun > 0.5:
            raise LinkError("given up")

    with pytest.raises(LinkError, match="given up"):
        switch(HOST, "power on", "brake release", said="releasing", pause=given_up)
    assert time.monotonic() - begun < 1.5
    assert [body["action"] for _, body in robot.asked] == ["POWER_ON"]


@pytest.mark.parametrize("name", ["power_on", "unlock_protective_stop", "restart_safety"])
def test_a_stop_ends_the_wait_of_each_service_for_the_robot_api(robot: Robot, name: str) -> None:
    pytest.importorskip("rclpy", reason="needs ROS 2")
    from seed_driver.ros.requests import Requests

    robot.takes = 2.5
    offered: dict[str, Any] = {}
    requests = Requests(SimpleNamespace(serve=lambda _, name, method, **__: offered.update({name: method})), lambda: 0)
    supervisor = SimpleNamespace(state=SimpleNamespace(linked=False), send=lambda *_, **__: 1, replies={})
    requests.begin(supervisor, HOST)
    try:
        offered[f"~/{name}"]().send(None)
        until = time.monotonic() + 3.0
        while not robot.asked and time.monotonic() < until:
            time.sleep(0.02)
        assert robot.asked
        [(call, answer)] = requests._thread_calls
        offered["~/stop"]().send(None)
        begun = time.monotonic()
        assert "given up: the arm was stopped" in str(call.exception(timeout=10.0))
        assert time.monotonic() - begun < 1.0
        requests.answer(time.monotonic())
        assert answer.done()
    finally:
        requests.close()


def test_an_arm_that_takes_long_for_its_power_is_waited_for(robot: Robot) -> None:
    """UR's own client waits for the answer until the arm has its power: self-checks take more than 5 s."""
    robot.takes = 6.0
    assert switch(HOST, "power on", said="powering") == "POWER_ON: accepted by the Robot API"


def test_a_robot_api_that_does_not_answer_is_not_told_to_be_absent(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_api, "USUAL_PATIENCE", 0.2)
    robot.takes = 0.5
    with pytest.raises(LinkError, match=r"has not answered BRAKE_RELEASE within 0.2 s: look at its screen"):
        switch(HOST, "brake release", said="releasing")


def test_the_safety_system_is_restarted(robot: Robot) -> None:
    assert "RESTART_SAFETY: accepted by the Robot API; then call power_on" in restart_safety(HOST)
    assert [body["action"] for _, body in robot.asked] == ["RESTART_SAFETY"]


def test_without_dashboard_and_robot_api_both_are_named() -> None:
    with pytest.raises(LinkError, match=r"no dashboard at .*, and no Robot API at .*: use its screen"):
        switch("127.0.77.4", "power on", said="releasing")

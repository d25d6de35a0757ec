# SPDX-License-Identifier: Apache-2.0
"""A dashboard server that takes its time is waited for, and is never taken for a robot that has none."""

import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from seed_driver.power import robot_api
from seed_driver.power.recovery import local_control, power_on
from seed_driver.robot import dashboard as module
from seed_driver.robot.dashboard import LateError, NoDashboardError, dashboard
from seed_driver.robot.link import LinkError

HOST = "127.0.77.8"
ANSWERS = {"safetystatus": "Safetystatus: NORMAL", "power on": "Powering on", "brake release": "Brake releasing"}


class Slow:
    """A server; it answers each line, and greets, after so long [s]."""

    def __init__(self) -> None:
        self.greets_after, self.acts_after, self.answers_after = 0.0, 0.0, 0.0
        self.heard: list[str] = []
        self.listener = socket.create_server((HOST, 0))

    def serve(self) -> None:
        while True:
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            with connection, connection.makefile("rwb") as file:
                self._greet_and_answer(file.write, file.flush, file)

    def _greet_and_answer(self, write: Callable[[bytes], int], flush: Callable[[], None], lines: Iterator) -> None:
        try:
            time.sleep(self.greets_after)
            write(b"Connected: Universal Robots Dashboard Server\n")
            flush()
            for line in lines:
                command = line.decode().strip()
                self.heard.append(command)
                time.sleep(self.acts_after if command in ("power on", "brake release") else self.answers_after)
                write(ANSWERS.get(command, "true").encode() + b"\n")
                flush()
        except OSError:  # the client has given up
            pass


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> Iterator[Slow]:
    server = Slow()
    monkeypatch.setattr(module, "PORT", server.listener.getsockname()[1])
    monkeypatch.setattr(robot_api, "PORT", 9)  # a robot with a dashboard has no Robot API
    thread = threading.Thread(target=server.serve)
    thread.start()
    yield server
    server.listener.shutdown(socket.SHUT_RDWR)
    server.listener.close()
    thread.join()


def test_a_robot_that_takes_a_second_for_its_power_is_powered(slow: Slow) -> None:
    slow.acts_after = 1.0
    assert power_on(HOST) == "Brake releasing"
    assert slow.heard[-2:] == ["power on", "brake release"]


def test_no_brake_is_released_where_it_was_given_up_while_the_power_came(slow: Slow) -> None:
    def given_up(_: float) -> None:
        raise LinkError("given up")

    with pytest.raises(LinkError, match="given up"):
        power_on(HOST, pause=given_up)
    assert slow.heard == ["safetystatus", "power on"]


def test_a_robot_whose_dashboard_has_just_started_is_powered(slow: Slow) -> None:
    slow.greets_after = 0.8
    assert dashboard(HOST, "power on", "brake release") == "Brake releasing"


def test_one_that_does_not_answer_is_not_told_to_have_none(slow: Slow, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.3)
    slow.acts_after = 0.6
    with pytest.raises(LateError, match=r"has not answered 'power on' within 0.3 s: look at the pendant"):
        power_on(HOST)


def test_a_question_is_not_waited_for_so_long(slow: Slow) -> None:
    slow.answers_after = 0.8
    begin = time.monotonic()
    with pytest.raises(LateError, match=r"'is in remote control' within 0\.5 s"):
        dashboard(HOST, "is in remote control")
    assert time.monotonic() - begin < 0.75
    assert local_control(HOST) == ""


def test_where_nobody_is_there_is_none() -> None:
    with pytest.raises(NoDashboardError, match="PolyScope X has none"):
        dashboard("127.0.77.9", "power on")

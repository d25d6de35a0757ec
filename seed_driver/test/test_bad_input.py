# SPDX-License-Identifier: Apache-2.0
"""Whatever is wrong at the robot's end is named within three seconds, and the driver goes on trying."""

import contextlib
import socket
import struct
import threading
import time
from pathlib import Path

import pytest

from seed_driver.config import DriverConfig
from seed_driver.process.supervisor import Supervisor
from seed_driver.robot.rtde_client import RtdeClient
from seed_testing.fault_bench.bench import FaultBench
from seed_ur.standin_client import StandIn, private_host

NAMED_WITHIN = 3.0  # [s]
pytestmark = pytest.mark.realtime


def reason(supervisor: Supervisor, text: str, within: float = NAMED_WITHIN) -> str:
    """The driver's reason once it contains `text`, else the last one after `within` seconds."""
    until = time.monotonic() + within
    while time.monotonic() < until:
        state = supervisor.step(time.monotonic())
        if text in state.reason:
            break
        time.sleep(0.01)
    return supervisor.state.reason


def complaint(text: str, host: str, **settings) -> str:
    supervisor = Supervisor(DriverConfig(robot_ip=host, **settings))
    try:
        supervisor.start(start_program=True)
        found = reason(supervisor, text)
        assert supervisor.pid is not None
        return found
    finally:
        supervisor.close()


@pytest.mark.parametrize(
    "host", ["127.0.77.1", "192.0.2.1", "192.168..1"], ids=["nobody-there", "no-such-network", "no-address"]
)
def test_wrong_address(host: str) -> None:
    assert f"no controller at {host}:30004" in complaint("no controller", host)


def test_a_port_that_says_nothing_and_comes_to_life_later() -> None:
    with StandIn() as robot:
        robot.ask("mute", seconds=2.0)
        supervisor = Supervisor(DriverConfig(robot_ip=robot.host))
        try:
            supervisor.start(start_program=True)
            assert "does not speak RTDE" in reason(supervisor, "does not speak RTDE")
            assert reason(supervisor, "nothing", within=3.0) is not None
            until = time.monotonic() + 8.0
            while not supervisor.step(time.monotonic()).armed and time.monotonic() < until:
                time.sleep(0.01)
            assert supervisor.state.armed
        finally:
            supervisor.close()


def test_a_controller_that_answers_but_sends_no_data() -> None:
    with StandIn() as robot:
        robot.ask("no_data", seconds=30.0)
        assert "sends no data" in complaint("sends no data", robot.host)


@pytest.mark.parametrize(
    ("answers", "text"),
    [
        ([b"SSH-2.0-OpenSSH_9.6\r\n"], "does not speak RTDE"),
        ([b"\0\4V\1", b"\0\7v\0\0\0\5"], "answers like no UR controller"),
        (
            [b"\0\4V\1", b"\0\x13v" + struct.pack(">4I", 5, 12, 4, 1), b"\0\x0aO\1BANANA"],
            "answers like no UR controller",
        ),
    ],
    ids=["another-service", "short-version", "unknown-type"],
)
def test_something_else_that_listens_at_the_address(answers: list[bytes], text: str) -> None:
    host, ended = private_host(), threading.Event()
    with socket.create_server((host, 30004)) as server:

        def serve() -> None:
            while not ended.is_set():
                connection, _ = server.accept()
                with connection, contextlib.suppress(OSError):
                    for answer in answers:
                        connection.recv(4096)
                        connection.sendall(answer)
                    connection.recv(4096)
                    connection.sendall(b"\0\4S\1\0\4U\1")

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            assert text in complaint(text, host)
        finally:
            ended.set()
            socket.create_connection((host, 30004)).close()
            thread.join()


def test_protective_stop_at_start_is_named_and_needs_a_request_afterwards() -> None:
    with FaultBench("--protective-stop", "--unlock-after", "0") as bench:
        bench.wait(lambda s: s.reason == "protective stop", NAMED_WITHIN, "protective stop named")
        refused = bench.ask("start")
        assert not refused.ok
        assert "protective stop" in refused.text
        from seed_driver.robot.dashboard import dashboard

        assert "releasing" in dashboard(bench.robot.host, "unlock protective stop")
        bench.run(0.5)
        assert not bench.state.armed
        bench.recover(3.0)


@pytest.mark.parametrize("version", ["3.5.4", "5.0.2", "10.7.0"])
def test_unsupported_polyscope(version: str) -> None:
    with StandIn(None, "--version", version) as robot:
        assert "is not supported; it needs at least 3.10, 5.4, 10.10" in complaint("not supported", robot.host)


def test_a_second_client_is_told_who_holds_the_registers() -> None:
    with FaultBench() as first:
        first.ready()
        said = complaint("another RTDE client", first.robot.host)
        assert "another RTDE client holds the input registers" in said
        assert "EtherNet/IP" in said
        assert "ask again in some seconds" in said
        first.run(0.2)
        assert first.state.armed  # undisturbed
        assert first.state.linked


def test_the_driver_of_a_force_sensor_keeps_its_input() -> None:
    """A sensor that is not the robot's own is told to it by RTDE; only one client may write an input."""
    with StandIn() as robot, RtdeClient(robot.host) as sensor:
        assert sensor.take_inputs("external_force_torque")
        with FaultBench(robot=robot) as bench:
            bench.ready()
            assert bench.state.armed


def test_a_missing_library_names_the_pip_command(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "rtde_control.py").write_text("raise ImportError('hidden for a test')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    import os

    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    assert "pip install ur-rtde==1.6.5" in complaint("pip install", private_host())


def test_the_wrong_model_is_noticed_before_anything_moves() -> None:
    with StandIn(None, "--model", "ur10e") as robot:
        text = complaint("set model", robot.host, model="ur5e")
        assert "model ur5e puts the flange" in text
        assert "known are ur5e and ur10e, no arm of a CB3" in text
        assert robot.ask("stats")["servo_count"] == 0

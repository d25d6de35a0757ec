# SPDX-License-Identifier: Apache-2.0
"""Whatever was held or refused once moves again on request only; what is wrong is one sentence, in bounded time."""

import contextlib
import socket
import threading
import time

import pytest

from seed_driver.config import DriverConfig
from seed_driver.process.supervisor import Supervisor
from seed_testing.fault_bench.bench import FaultBench
from seed_ur.standin_client import StandIn, private_host

pytestmark = pytest.mark.realtime

pytest.importorskip("rtde_control", reason="ur_rtde is not installed (pip install ur-rtde==1.6.5)")


@pytest.fixture(scope="module")
def robot():
    with StandIn(None, "--unlock-after", "0") as made:
        yield made


def uploads(robot: StandIn) -> int:
    return robot.ask("state")["uploads"]


def test_a_second_driver_does_not_take_over_when_the_first_ones_link_drops(robot) -> None:
    with FaultBench(robot=robot) as first:
        first.ready()
        with FaultBench(robot=robot) as second:
            second.wait(lambda s: "another RTDE client" in s.reason, 10.0, "refusal")
            assert second.state.reason.endswith("then call resend_robot_program")
            assert first.step().armed  # undisturbed
            before = uploads(robot)
            robot.ask("drop_rtde")
            first.wait(lambda s: not s.armed, 1.0, "report")
            until = time.monotonic() + 1.5
            while time.monotonic() < until:
                assert not first.step().armed
                assert not second.step().armed
            assert uploads(robot) == before
            second.recover()
            assert not first.ask("start").ok
            assert second.step().armed


def test_a_switch_to_remote_control_starts_nothing() -> None:
    with FaultBench("--local") as bench:
        bench.wait(lambda s: "local control" in s.reason, 10.0, "local control named")
        assert bench.state.linked
        bench.robot.ask("option", name="remote_control", value=True)
        bench.run(1.5)
        assert not bench.state.armed
        assert uploads(bench.robot) == 0
        bench.recover()


def test_local_control_is_named_on_a_later_request_too(robot) -> None:
    with FaultBench(robot=robot) as bench:
        bench.ready()
        robot.ask("pendant_stop")
        bench.wait(lambda s: not s.armed, 2.0, "report")
        robot.ask("option", name="remote_control", value=False)
        reply = bench.ask("start", timeout=2.0)
        robot.ask("option", name="remote_control", value=True)
        assert not reply.ok
        assert "local control: switch it to remote control" in reply.text
        bench.recover()


@pytest.mark.parametrize("program", ["checked", "ur_rtde"])
def test_local_control_in_between_needs_one_request_only(robot, program: str) -> None:
    """A UR closes the connections for programs then, and ur_rtde has one for ever."""
    with FaultBench(robot=robot, robot_program=program) as bench:
        bench.ready()
        pid = bench.supervisor.pid
        robot.ask("option", name="remote_control", value=False)
        robot.ask("pendant_stop")
        bench.wait(lambda s: not s.armed, 2.0, "report")
        bench.run(0.2)
        robot.ask("option", name="remote_control", value=True)
        bench.run(0.2)
        before = uploads(robot)
        reply = bench.ask("start", timeout=3.0)
        assert reply.ok, reply.text
        assert bench.supervisor.pid == pid
        assert uploads(robot) == before + 1


def test_a_wrong_model_is_said_once_and_nothing_is_uploaded() -> None:
    with FaultBench("--model", "ur10e") as bench:
        bench.wait(lambda s: "model ur5e puts the flange" in s.reason, 10.0, "model named")
        bench.run(1.5)
        assert uploads(bench.robot) == 0
        assert not bench.ask("start", timeout=2.0).ok


@pytest.mark.parametrize("fed", [False, True], ids=["at-start", "on-request"])
def test_another_program_is_left_playing_and_named(robot, fed: bool) -> None:
    with contextlib.ExitStack() as stack:
        if fed:
            bench = stack.enter_context(FaultBench(robot=robot))
            bench.ready()
            robot.ask("pendant_stop")
            bench.wait(lambda s: not s.armed, 2.0, "report")
        robot.ask("play", seconds=30.0)
        time.sleep(0.2)
        if not fed:
            bench = stack.enter_context(FaultBench(robot=robot))
            bench.wait(lambda s: "another program plays" in s.reason, 10.0, "program named")
        deaths, start = bench.supervisor.deaths, time.monotonic()
        reply = bench.ask("start", timeout=4.0)
        assert time.monotonic() - start < 3.0
        assert not reply.ok
        assert "another program plays on the robot" in reply.text
        assert "PLAYING pick_and_place" in reply.text
        assert robot.ask("state")["program"] == "pick_and_place"
        assert bench.supervisor.deaths == deaths
        robot.ask("pendant_stop")
        bench.recover()


def test_a_control_script_that_a_dead_driver_left_is_ended() -> None:
    """It died before it could arm the watchdog."""
    with StandIn() as robot:
        robot.ask("play", seconds=30.0, name="rtde_control")
        time.sleep(0.2)
        with FaultBench(robot=robot) as bench:
            bench.ready()


def test_a_clock_that_is_set_back_holds_and_goes_on_when_asked(robot) -> None:
    with FaultBench(robot=robot) as bench:
        bench.ready()
        bench.sway()
        bench.run(0.5)
        robot.ask("set_clock_back", seconds=20.0)
        bench.wait(lambda s: not s.armed, 0.5, "report")
        assert "clock went back by 20.0 s" in bench.state.reason
        bench.still()
        bench.run(0.3)
        bench.recover_in_place()
        (x, y, z), q = bench.state.command
        bench.follow(lambda t: ((x, y + min(0.01, 0.05 * t), z), q))
        bench.run(0.8)
        assert bench.state.reason == ""
        assert bench.state.sample.p[1] == pytest.approx(y + 0.01, abs=2e-4)


class Far:
    """A robot whose every byte takes some time, there and back."""

    PORTS = (29999, 30003, 30004)

    def __init__(self, host: str, delay: float) -> None:
        self.host, self._behind, self._delay = private_host(), host, delay
        self._servers = [socket.create_server((self.host, port)) for port in self.PORTS]
        for server in self._servers:
            threading.Thread(target=self._accept, args=(server,), daemon=True).start()

    def close(self) -> None:
        for server in self._servers:
            server.shutdown(socket.SHUT_RDWR)
            server.close()

    def _accept(self, server: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = server.accept()
                far = socket.create_connection((self._behind, server.getsockname()[1]))
                for pair in ((near, far), (far, near)):
                    threading.Thread(target=self._carry, args=pair, daemon=True).start()

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError), source, sink:
            while data := source.recv(65_536):
                time.sleep(self._delay)  # what comes meanwhile waits in the socket, and less long
                sink.sendall(data)


def test_a_robot_that_is_far_away_is_refused_in_one_sentence(robot) -> None:
    far = Far(robot.host, 0.06)
    with contextlib.closing(far):
        supervisor = Supervisor(DriverConfig(robot_ip=far.host))
        try:
            supervisor.start(start_program=True)
            until = time.monotonic() + 10.0
            while "ms to answer" not in supervisor.step(time.monotonic()).reason and time.monotonic() < until:
                time.sleep(0.01)
            assert "(limit 50 ms): connect this machine" in supervisor.state.reason
            assert supervisor.deaths == 0
        finally:
            supervisor.close()

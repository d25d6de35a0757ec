# SPDX-License-Identifier: Apache-2.0
"""Every fault: reported, the arm comes to rest, the driver lives, one service call brings it back without a jump."""

import math
import os
import signal
import time

import numpy as np
import pytest

from seed_driver.process.shared_memory import Stage
from seed_driver.robot.dashboard import dashboard
from seed_driver.robot.program import AT_REST
from seed_testing.fault_bench.bench import JUMP, FaultBench, leftover_processes
from seed_testing.fault_bench.faults import FAULTS, Fault, run_fault
from seed_testing.fault_bench.play import play_after_stop

pytest.importorskip("rtde_control", reason="ur_rtde is not installed (pip install ur-rtde==1.6.5)")
FURTHEST = 0.9  # [m] of the flange from any joint of a UR5e
PATIENCE = 0.4  # [s] added to the bound of a report: a test machine may pause; ./seed bench driver has the figures
pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def bench():
    with FaultBench("--unlock-after", "0.5") as made:
        yield made
    assert leftover_processes(os.getpid()) == []


@pytest.mark.parametrize("fault", FAULTS, ids=lambda f: f.name.replace(" ", "-"))
def test_fault_is_reported_rests_and_recovers(bench: FaultBench, fault: Fault) -> None:
    if not bench.state.armed:
        bench.run(0.5)
        bench.recover() if bench.state.linked else bench.ready()
    outcome = run_fault(bench, fault, moving=0.3)
    assert outcome.report <= fault.report_within + PATIENCE
    assert outcome.recovery <= 2.0 + PATIENCE
    assert outcome.coast < 0.01  # the sway is slower than 0.04 m/s


def test_a_command_left_in_the_register_does_not_move_the_arm_on_recovery() -> None:
    """A script that found it would go there at once."""
    with FaultBench() as bench:
        bench.ready()
        bench.sway()
        bench.run(0.5)
        bench.robot.ask("pendant_stop")
        bench.wait(lambda s: not s.armed, 1.0, "report")
        bench.run(0.3)
        state = bench.robot.ask("state")
        x, y, *rest = state["tcp_pose"]
        bench.robot.ask("stale_command", pose=[x, y + 0.03, *rest])
        assert bench.robot.ask("state")["command"] == 24
        bench.still()
        bench.recover()
        bench.run(0.5)
        moved = np.subtract(bench.robot.ask("state")["tcp_pose"][:3], state["tcp_pose"][:3])
        assert np.linalg.norm(moved) < JUMP


@pytest.mark.parametrize("program", ["checked", "ur_rtde"])
def test_unlock_and_play_after_the_driver_died_in_a_stop(program: str) -> None:
    """Nobody is there to empty the register, and the robot's watchdog sleeps while the program is paused."""
    played = play_after_stop(program)
    if program == "checked":
        assert played.moved < 1e-4
        assert played.top_speed < 1e-3
    else:
        assert played.moved > 1e-3  # what ur_rtde's own program does


@pytest.mark.parametrize(
    ("on_stop", "slowest", "fastest", "most"),
    [
        ("paused", 0.03, 1.0, 1e-4),
        ("playing", 0.03, 1.0, 1e-4),
        ("paused", 0.0, 0.005, AT_REST * FURTHEST),  # at a turning point: what the program lets a resting arm go
    ],
)
def test_the_register_is_empty_after_a_stop_and_unlock_and_play_move_nothing(
    on_stop: str, slowest: float, fastest: float, most: float
) -> None:
    with FaultBench("--unlock-after", "0.2", "--on-stop", on_stop) as bench:
        bench.ready()
        bench.robot.ask("option", name="watchdog_sleeps", value=True)
        bench.sway(amplitude=0.05, rate=4.0)
        bench.run(0.8)
        bench.wait(lambda s: slowest <= math.hypot(*s.sample.twist[:3]) <= fastest, 4.0, "speed to be stopped at")
        bench.robot.ask("protective_stop")
        bench.run(0.4)
        state = bench.robot.ask("state")
        assert state["command"] == 0
        dashboard(bench.robot.host, "close safety popup", "unlock protective stop", "play")
        bench.run(0.5)
        assert math.dist(bench.position(), state["tcp_pose"][:3]) < most
        assert not bench.state.armed
        bench.still()
        bench.recover()


@pytest.mark.parametrize(
    ("version", "setting", "register"),
    [
        ("5.12.4", "auto", 24),
        ("5.12.4", "lower", 0),
        ("5.23.0", "auto", 0),
    ],
)
def test_registers_are_the_upper_ones_where_ur_rtde_can(version: str, setting: str, register: int) -> None:
    with FaultBench("--version", version, registers=setting) as bench:
        bench.ready()
        bench.sway()
        bench.run(0.4)
        assert bench.robot.ask("state")["registers"] == register
        assert bench.robot.ask("stats")["top_speed"] > 0.005


@pytest.mark.parametrize(("name", "value"), [("actual_q", float("nan")), ("safety_mode", -1)])
def test_a_state_that_cannot_be_is_never_told_on(bench: FaultBench, name: str, value: float) -> None:
    bench.recover()
    bench.sway()
    bench.run(0.3)
    bench.robot.ask("corrupt", name=name, value=value)
    try:
        bench.wait(lambda s: s.reason.startswith(f"the robot's {name}"), 1.0, "report")
        assert not bench.state.armed
        told, deaths = bench.state.sample_time, bench.supervisor.deaths
        for _ in range(50):
            state = bench.step()
            assert np.isfinite([*state.sample.q, *state.sample.p, *state.sample.orientation, *state.sample.twist]).all()
            assert state.sample.modes.safety_mode == 1
        assert bench.state.sample_time == told
        assert not bench.ask("start").ok
    finally:
        bench.robot.ask("corrupt", name=name)
    bench.still()
    bench.recover()
    assert bench.supervisor.deaths == deaths


@pytest.mark.parametrize("stop", [False, True], ids=["as it is", "and a stop"])
def test_good_states_after_bad_ones_do_not_move_an_arm_that_holds(bench: FaultBench, stop: bool) -> None:
    """The command stood at speed: it must not go on from there once the robot can be heard again."""
    bench.recover()
    (x, y, z), q = bench.state.command
    bench.follow(lambda t: ((x, y, z + 0.15 * t - 0.15 * 0.25 * (1.0 - math.exp(-t / 0.25))), q))
    bench.run(0.6)
    bench.robot.ask("corrupt", name="payload", value=-1.0)
    try:
        bench.wait(lambda s: not s.armed, 1.0, "hold")
        if stop:
            assert bench.ask("stop").ok
        bench.still()
        bench.run(0.4)
        rest = bench.position()
    finally:
        bench.robot.ask("corrupt", name="payload")
    bench.run(0.5)
    assert math.dist(bench.position(), rest) < 1e-4
    bench.still()
    bench.recover_in_place()


def test_polyscope_x_takes_the_program_again() -> None:
    """It has no dashboard, on which ur_rtde relies elsewhere."""
    with FaultBench("--version", "10.10.0") as bench:
        bench.ready()
        bench.sway()
        bench.run(0.3)
        deaths = bench.supervisor.deaths
        bench.robot.ask("pendant_stop")
        bench.wait(lambda s: not s.armed, 1.0, "report")
        bench.still()
        bench.recover()
        assert bench.supervisor.deaths == deaths
        assert bench.robot.ask("state")["runtime_state"] == 2


def test_a_silent_controller_does_not_stop_the_servo_loop(bench: FaultBench) -> None:
    """The command decelerates by itself, long before the robot's watchdog would stop a process that waits."""
    bench.recover()
    bench.sway()
    bench.run(0.5)
    deaths, sent = bench.supervisor.deaths, bench.state.sent
    bench.robot.ask("pause_outputs", seconds=0.4)
    bench.run(0.35)
    assert bench.state.reason == "link lost: the controller's clock stands still"
    assert bench.state.sent - sent > 100
    assert bench.supervisor.deaths == deaths
    bench.still()
    bench.wait(lambda s: s.linked, 2.0, "link")


def test_the_robot_stops_by_itself_when_the_driver_is_gone() -> None:
    with FaultBench() as bench:
        bench.ready()
        bench.sway(amplitude=0.05)
        bench.run(0.6)
        start = time.monotonic()
        os.kill(bench.supervisor.pid, signal.SIGKILL)
        time.sleep(0.5)
        motion = bench.motion(start)
        assert bench.robot.ask("state")["runtime_state"] == 1
        assert motion[-1, 4] < 1e-3
        assert np.linalg.norm(motion[-1, 1:4] - motion[0, 1:4]) < 0.02


@pytest.mark.parametrize("fault", ["servo process killed", "RTDE connections dropped"])
def test_a_fault_during_the_first_start_does_not_end_the_starting(fault: str) -> None:
    """Nothing has been commanded yet: the program starts by itself in the first life that gets there, in no later."""
    (inject,) = (f.inject for f in FAULTS if f.name == fault)
    with FaultBench() as bench:
        bench.wait(lambda s: s.stage == Stage.BUSY, 20.0, "program on its way")
        inject(bench)
        bench.wait(lambda _: bench.supervisor.deaths == 1, 10.0, "end of the first life")
        bench.ready(20.0)
        os.kill(bench.supervisor.pid, signal.SIGKILL)
        bench.wait(lambda s: s.reason == "waiting for the robot program", 20.0, "link")
        bench.run(1.0)
        assert not bench.state.armed


def test_a_request_to_a_process_that_has_only_just_been_started_is_answered_at_once() -> None:
    with FaultBench() as bench:
        bench.ready()
        os.kill(bench.supervisor.pid, signal.SIGKILL)
        bench.wait(lambda _: bench.supervisor.deaths == 1, 2.0, "death")
        bench.wait(lambda _: bench.supervisor.pid is not None, 2.0, "next life")
        reply = bench.supervisor.replies[bench.supervisor.send("start")]
        assert not reply.ok
        assert "no link to the robot" in reply.text


def test_a_process_stopped_while_it_starts_is_replaced_before_a_request_gives_up() -> None:
    """It does not work any more: that is seen in the first life as in a later one."""
    with FaultBench() as bench:
        os.kill(bench.supervisor.pid, signal.SIGSTOP)
        bench.wait(lambda _: bench.supervisor.deaths == 1, 4.0, "end of the first life")
        bench.ready()
        os.kill(bench.supervisor.pid, signal.SIGKILL)
        bench.wait(lambda s: s.stage == Stage.STARTING, 5.0, "third life")
        os.kill(bench.supervisor.pid, signal.SIGSTOP)
        bench.recover()
        assert bench.supervisor.deaths == 3

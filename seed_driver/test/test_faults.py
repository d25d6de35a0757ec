# SPDX-License-Identifier: Apache-2.0
"""Every fault: reported, the arm comes to rest, the driver lives, one service call brings it back without a jump."""

import os
import signal
import time

import numpy as np
import pytest

from seed_driver.process.shared_memory import Stage
from seed_testing.fault_bench.bench import Rig, leftover_processes
from seed_testing.fault_bench.faults import FAULTS, JUMP, Fault, suffer

pytest.importorskip("rtde_control", reason="ur_rtde is not installed (pip install ur-rtde==1.6.5)")
PATIENCE = 0.4  # [s] added to the bound of a report: a test machine may pause; ./seed bench driver has the figures
pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def rig():
    with Rig("--unlock-after", "0.5") as made:
        yield made
    assert leftover_processes(os.getpid()) == []


@pytest.mark.parametrize("fault", FAULTS, ids=lambda f: f.name.replace(" ", "-"))
def test_fault_is_reported_rests_and_recovers(rig: Rig, fault: Fault) -> None:
    if not rig.state.armed:
        rig.run(0.5)
        rig.recover() if rig.state.linked else rig.ready()
    outcome = suffer(rig, fault, moving=0.3)
    assert outcome.report <= fault.report_within + PATIENCE
    assert outcome.recovery <= 2.0 + PATIENCE
    assert outcome.coast < 0.01  # the sway is slower than 0.04 m/s


def test_a_command_left_in_the_register_does_not_move_the_arm_on_recovery() -> None:
    """The robot lags far behind its command when the program dies: a script that found it would go there at once."""
    with Rig() as rig:
        rig.ready()
        rig.robot.ask("option", name="speed_scaling", value=0.02)
        x, y, z, *q = rig.state.command
        rig.follow(lambda t: ((x, y + min(0.05, 0.1 * t), z), tuple(q)))
        rig.run(0.8)
        rig.robot.ask("pendant_stop")
        rig.wait(lambda s: not s.armed, 1.0, "report")
        rig.run(0.3)
        rig.robot.ask("stale_command")  # ur_rtde may have cleared it, if it was quicker than the program's end
        state = rig.robot.ask("state")
        left = rig.robot.ask("targets")["targets"][-1][2]
        assert state["command"] == 24
        assert abs(left - state["tcp_pose"][1]) > 0.02  # and would take the arm centimetres away
        rig.robot.ask("option", name="speed_scaling", value=1.0)
        rig.still()
        rig.recover()
        rig.run(0.5)
        moved = np.subtract(rig.robot.ask("state")["tcp_pose"][:3], state["tcp_pose"][:3])
        assert np.linalg.norm(moved) < JUMP


def test_polyscope_x_takes_the_program_again() -> None:
    """It has no dashboard, on which ur_rtde relies elsewhere."""
    with Rig("--version", "10.10.0") as rig:
        rig.ready()
        rig.sway()
        rig.run(0.3)
        deaths = rig.supervisor.deaths
        rig.robot.ask("pendant_stop")
        rig.wait(lambda s: not s.armed, 1.0, "report")
        rig.still()
        rig.recover()
        assert rig.supervisor.deaths == deaths
        assert rig.robot.ask("state")["runtime_state"] == 2


def test_a_silent_controller_does_not_stop_the_servo_loop(rig: Rig) -> None:
    """The command decelerates by itself, long before the robot's watchdog would stop a process that waits."""
    rig.recover()
    rig.sway()
    rig.run(0.5)
    deaths, sent = rig.supervisor.deaths, rig.state.sent
    rig.robot.ask("pause_outputs", seconds=0.4)
    rig.run(0.35)
    assert rig.state.reason == "link lost: the controller's clock stands still"
    assert rig.state.sent - sent > 100
    assert rig.supervisor.deaths == deaths
    rig.still()
    rig.wait(lambda s: s.linked, 2.0, "link")


def test_the_robot_stops_by_itself_when_the_driver_is_gone() -> None:
    with Rig() as rig:
        rig.ready()
        rig.sway(amplitude=0.05)
        rig.run(0.6)
        start = time.monotonic()
        rig.supervisor._process.kill()
        time.sleep(0.5)
        motion = rig.motion(start)
        assert rig.robot.ask("state")["runtime_state"] == 1
        assert motion[-1, 4] < 1e-3
        assert np.linalg.norm(motion[-1, 1:4] - motion[0, 1:4]) < 0.02


@pytest.mark.parametrize("fault", ["servo process killed", "RTDE connections dropped"])
def test_a_fault_during_the_first_start_does_not_end_the_starting(fault: str) -> None:
    """Nothing has been commanded yet: the program starts by itself in the first life that gets there, in no later."""
    (hurt,) = (f.hurt for f in FAULTS if f.name == fault)
    with Rig() as rig:
        rig.wait(lambda s: s.stage == Stage.BUSY, 20.0, "program on its way")
        hurt(rig)
        rig.wait(lambda _: rig.supervisor.deaths == 1, 10.0, "end of the first life")
        rig.ready(20.0)
        rig.supervisor._process.kill()
        rig.wait(lambda s: s.reason == "waiting for the robot program", 20.0, "link")
        rig.run(1.0)
        assert not rig.state.armed


def test_a_request_to_a_process_that_has_only_just_been_started_is_answered_at_once() -> None:
    with Rig() as rig:
        rig.ready()
        rig.supervisor._process.kill()
        rig.wait(lambda _: rig.supervisor.deaths == 1, 2.0, "death")
        rig.wait(lambda _: rig.supervisor.pid is not None, 2.0, "next life")
        reply = rig.supervisor.replies[rig.supervisor.send("start")]
        assert not reply.ok
        assert "no link to the robot" in reply.text


def test_a_process_stopped_while_it_starts_is_replaced_before_a_request_gives_up() -> None:
    """It does not work any more: that is seen in the first life as in a later one."""
    with Rig() as rig:
        os.kill(rig.supervisor.pid, signal.SIGSTOP)
        rig.wait(lambda _: rig.supervisor.deaths == 1, 4.0, "end of the first life")
        rig.ready()
        rig.supervisor._process.kill()
        rig.wait(lambda s: s.stage == Stage.STARTING, 5.0, "third life")
        os.kill(rig.supervisor.pid, signal.SIGSTOP)
        rig.recover()
        assert rig.supervisor.deaths == 3

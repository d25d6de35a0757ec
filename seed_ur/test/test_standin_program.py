# SPDX-License-Identifier: Apache-2.0
"""Programs and the dashboard's sentences, without sockets."""

import numpy as np
import pytest

from seed_ur.standin import dashboard
from seed_ur.standin.controller import Controller
from seed_ur.standin.options import PLAYING, POWER_OFF, RUNNING, SAFETY_FAULT, STOPPED, Options
from seed_ur.standin.script import Script

DT = 0.002
CONTROL = "def rtde_control():\n# float register offset 0\n"


class Rig:
    """A stand-in with ur_rtde's control script, without sockets."""

    def __init__(self, body: str = "") -> None:
        self.robot, self.time = Controller(Options()), 0.0
        self.robot.tick(0.0)
        assert not self.robot.upload(Script(self.robot, f"{CONTROL}{body}\nend"), 0.0)
        self.run(0.1)

    def run(self, seconds: float) -> float:
        """Go on for so long; the largest speed of the TCP [m/s]."""
        top = 0.0
        for _ in range(round(seconds / DT)):
            self.time += DT
            self.robot.tick(self.time)
            top = max(top, float(np.linalg.norm(self.robot.publish()[1][:3])))
        return top

    def command(self, number: int, *numbers: float, background: int = 0) -> None:
        """Write a command with its registers d0... and i1."""
        self.robot.in_double[: len(numbers)] = numbers
        self.robot.in_int[:2] = number, background


@pytest.mark.parametrize("end", [Controller.protective_stop, lambda robot: dashboard.answer(robot, "stop")])
def test_a_program_that_was_stopped_before_it_began_does_not_begin(end) -> None:
    robot = Controller(Options())
    robot.tick(0.0)
    assert not robot.upload(Script(robot, "def f():\nend"), 0.0)
    end(robot)
    for i in range(100):
        robot.tick(DT * i)
        assert robot.program is None
        assert robot.runtime_state == STOPPED


@pytest.mark.parametrize(
    ("line", "pattern"),
    [
        ("PolyscopeVersion", "URSoftware 5.12.4.1101319"),
        ("get serial number", "20215500001"),
        ("is in remote control", "true"),
        ("stop", "Stopped"),
        ("robotmode", "Robotmode: RUNNING"),
        ("safetystatus", "Safetystatus: NORMAL"),
        ("load a.urp", "Loading program: a.urp"),
        ("what", "could not understand: 'what'"),
    ],
)
def test_the_dashboard_answers_literally(line: str, pattern: str) -> None:
    assert pattern in dashboard.answer(Controller(Options()), line)


def test_old_software_does_not_know_newer_dashboard_commands() -> None:
    robot = Controller(Options(version=(5, 4, 2, 1)))
    assert "could not understand" in dashboard.answer(robot, "is in remote control")


def test_a_path_goes_at_its_own_speeds() -> None:
    """As ur_rtde's Path.toScriptCode() writes it; to a pose, and in a straight line to joint angles."""
    here = Rig().robot.arm.tcp_pose()
    up = ",".join(str(v) for v in (*here[:2], here[2] + 0.05, *here[3:]))
    back = ",".join(map(str, Options().home))
    path = f"# inject move path\n\tmovel(p[{up}],a=0.5,v=0.02,r=0)\n\tmovel([{back}],a=0.5,v=0.1,r=0)\n"
    rig = Rig(path)
    rig.command(45)
    assert rig.run(2.4) == pytest.approx(0.02, rel=0.05)
    assert rig.robot.arm.tcp_pose()[2] > here[2] + 0.04
    assert rig.run(1.5) == pytest.approx(0.1, rel=0.05)
    assert rig.robot.arm.tcp_pose() == pytest.approx(here, abs=1e-4)
    assert rig.robot.values["output_int_register_0"] == 2


@pytest.mark.parametrize(("feature", "axis"), [(0.0, (1, 0, 0)), (1.0, (0, 1, 0)), (2.0, (0, 0, 1))])
def test_jogging_goes_along_the_axes_it_is_asked_for_and_ends_soon(feature: float, axis: tuple[int, ...]) -> None:
    rig, numbers = Rig(), (0.05, 0.0, 0.0, 0.0, 0.0, 0.0)  # the flange points down, its x along y of base
    rig.command(41, *numbers, feature, 0.5, 0.0, 0.0, 0.0, 0.0, -np.pi / 2, 0.0)
    rig.run(1.0)
    assert rig.robot.publish()[1][:3] == pytest.approx(0.05 * np.array(axis), abs=2e-3)
    rig.command(0)
    rig.run(DT)
    before = np.array(rig.robot.arm.tcp_pose()[:3])
    rig.command(42)
    rig.run(0.2)
    assert rig.robot.values["output_int_register_0"] == 2
    assert np.linalg.norm(rig.robot.arm.tcp_pose()[:3] - before) < 0.003


@pytest.mark.parametrize("feature", [0.0, 1.0])
def test_jogging_along_base_or_tcp_needs_no_frame_whatever_is_in_its_registers(feature: float) -> None:
    """Another client's, or those of an older command."""
    rig = Rig()
    rig.command(41, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, feature, 0.5, *(np.nan,) * 6)
    assert rig.run(0.5) == pytest.approx(0.05, abs=2e-3)
    rig.command(0)
    rig.run(DT)
    rig.command(41, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.5)
    rig.run(0.5)
    assert "must be finite" in rig.robot.faults.messages[-1]


@pytest.mark.parametrize("number", [1, 3, 4, 9, 10, 11, 24, 29, 41])
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_a_command_that_no_arm_can_carry_out_ends_the_program_and_moves_nothing(number: int, value: float) -> None:
    rig = Rig()
    before = list(rig.robot.arm.q)
    rig.command(number, *(value,) * 6, 1.0, 1.0, 0.002, 0.1, 300.0)
    rig.run(0.1)
    assert rig.robot.runtime_state == STOPPED
    assert "must be finite" in rig.robot.faults.messages[-1]
    assert rig.robot.arm.q == before
    assert not any(rig.robot.arm.tcp_offset)


def test_power_on_leaves_an_arm_that_runs_as_it_is() -> None:
    rig = Rig()
    assert dashboard.answer(rig.robot, "power on") == "Powering on"
    rig.run(DT)
    assert rig.robot.robot_mode == RUNNING
    assert rig.robot.runtime_state == PLAYING


def test_a_safety_fault_ends_by_a_restart_alone() -> None:
    robot = Rig().robot
    robot.safety_fault()
    robot.protective_stop()
    robot.unlock_protective_stop()
    dashboard.answer(robot, "power on")
    assert robot.safety_mode == SAFETY_FAULT
    assert robot.robot_mode == POWER_OFF
    for line in ("restart safety", "power on", "brake release"):
        dashboard.answer(robot, line)
    assert robot.robot_mode == RUNNING


def test_a_move_in_the_background_gives_way_to_the_next_and_its_end_is_told() -> None:
    def running() -> bool:
        return bool(int(rig.robot.values["output_int_register_2"]) & 0x8000)

    rig, home = Rig(), Options().home
    rig.command(1, home[0] + 1.0, *home[1:], 0.5, 1.0, background=1)
    rig.run(1.0)
    rig.command(0)
    rig.run(DT)
    assert running()
    rig.command(1, home[0] - 0.1, *home[1:], 0.5, 1.0)
    rig.run(0.3)
    assert rig.robot.arm.q[0] < home[0] + 0.45
    assert not running()
    rig.run(2.0)
    assert rig.robot.values["output_int_register_0"] == 2
    assert rig.robot.arm.q[0] == pytest.approx(home[0] - 0.1, abs=1e-3)
    rig.command(0)
    rig.run(DT)
    rig.command(1, *home, 0.1, 1.0, background=1)
    rig.run(0.3)
    rig.command(0)
    rig.run(DT)
    assert running()
    rig.command(34, 2.0)
    rig.run(0.2)
    assert not running()
    assert rig.robot.values["output_int_register_0"] == 2


@pytest.mark.parametrize("command", [(18,), (9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 1.0, 0.3)])
def test_a_move_in_the_background_does_not_go_on_after_freedrive_or_a_speed(command: tuple[float, ...]) -> None:
    rig, home = Rig(), Options().home
    rig.command(1, home[0] + 1.0, *home[1:], 0.5, 1.0, background=1)
    rig.run(0.8)
    rig.command(0)
    rig.run(DT)
    rig.command(*command)  # type: ignore[arg-type]
    rig.run(2.0)
    assert rig.robot.arm.q[0] < home[0] + 0.5
    assert not int(rig.robot.values["output_int_register_2"]) & 0x8000


def _stop_and_unlock(robot: Controller) -> None:
    robot.protective_stop()
    robot.now += 6.0
    assert robot.unlock_protective_stop()


@pytest.mark.parametrize("pause", [_stop_and_unlock, lambda robot: dashboard.answer(robot, "pause")])
@pytest.mark.parametrize("background", [0, 1])
def test_a_move_that_was_paused_goes_on_to_its_goal(pause, background: int) -> None:
    rig = Rig()
    x, y, z, *turn = rig.robot.arm.tcp_pose()
    rig.command(3, x, y, z + 0.1, *turn, 0.1, 0.5, background=background)
    rig.run(0.5)
    rig.command(0)
    pause(rig.robot)
    rig.run(0.5)
    assert rig.robot.arm.tcp_pose()[2] < z + 0.06
    assert dashboard.answer(rig.robot, "play") == "Starting program"
    rig.run(1.5)
    assert rig.robot.arm.tcp_pose()[:3] == pytest.approx((x, y, z + 0.1), abs=1e-4)

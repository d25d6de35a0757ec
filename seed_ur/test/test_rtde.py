# SPDX-License-Identifier: Apache-2.0
"""RTDE framing, the arm's servo and the dashboard's sentences, without sockets."""

import struct

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.errors import SeedError
from seed_core.spatial import make_pose
from seed_ur import rtde as wire
from seed_ur.kinematics import URKinematics
from seed_ur.pose import matrix_from_pose, pose_from_matrix
from seed_ur.standin import dashboard
from seed_ur.standin.arm import Arm, Hold, Move, Servo
from seed_ur.standin.controller import Controller
from seed_ur.standin.options import HOME, STOPPED, Options
from seed_ur.standin.rtde_session import Conversation
from seed_ur.standin.script import Script
from seed_ur.ur_sim import loopback, main, version

KINEMATICS = URKinematics.for_model("ur5e")
DT = 0.002


def test_packages_survive_any_cutting_of_the_stream() -> None:
    packages = [wire.pack(ord("V"), b"\x00\x02"), wire.pack(ord("v")), wire.pack(ord("U"), bytes(300))]
    stream, buffer, found = b"".join(packages), bytearray(), []
    for i in range(len(stream)):
        buffer += stream[i : i + 1]
        found.extend(wire.unpack_stream(buffer))
    assert [wire.pack(*p) for p in found] == packages
    assert not buffer


@pytest.mark.parametrize("head", [b"\x00\x02V", b"\xff\xffV"])
def test_an_impossible_size_is_refused(head: bytes) -> None:
    with pytest.raises(wire.WireError):
        list(wire.unpack_stream(bytearray(head)))


def test_recipes_have_the_sizes_of_the_protocol() -> None:
    recipe = wire.Recipe.of(
        ("timestamp", "actual_q", "runtime_state", "joint_mode", "actual_digital_input_bits"), wire.OUTPUTS
    )
    assert recipe.layout.size == 8 + 48 + 4 + 24 + 8
    values = {
        "timestamp": 1.5,
        "actual_q": tuple(range(6)),
        "runtime_state": 2,
        "joint_mode": (253,) * 6,
        "actual_digital_input_bits": 9,
    }
    package = recipe.encode(1, values)
    assert recipe.decode(package[4:]) == values
    assert recipe.decode(package[4:-1]) is None


def test_set_up_answers_types_unknown_names_and_owners() -> None:
    box = Controller(Options())
    first, second = Conversation(box), Conversation(box)
    ask = wire.Package(wire.SETUP_INPUTS, b"input_int_register_0,input_double_register_0,")
    assert first.handle(ask, 0.0)[3:] == b"\x01INT32,DOUBLE"
    assert second.handle(ask, 0.0)[3:] == b"\x00IN_USE,IN_USE"
    first.close()
    assert second.handle(ask, 0.0)[3:] == b"\x01INT32,DOUBLE"
    outputs = struct.pack(">d", 125.0) + b"timestamp,nonsense,actual_current_as_torque"
    assert second.handle(wire.Package(wire.SETUP_OUTPUTS, outputs), 0.0)[4:] == b"DOUBLE,NOT_FOUND,NOT_FOUND"
    assert wire.knows((5, 23, 0, 0), "actual_current_as_torque")


def test_the_servo_lags_by_what_is_documented() -> None:
    """A ramp of joint angles at lookahead 0.03 s and gain 300 comes 36 ms later: 2/wn = 30 ms, and 6 ms."""
    arm, speed = Arm(KINEMATICS, HOME), 0.2
    arm.motion = servo = Servo(HOME, 0.03, 300.0)
    for i in range(500):
        servo.goal = [HOME[0] + speed * DT * i, *HOME[1:]]
        arm.step(DT)
    assert (servo.goal[0] - arm.q[0]) / speed == pytest.approx(0.036, abs=0.003)
    assert arm.qd[0] == pytest.approx(speed, rel=1e-3)


def test_a_placed_arm_keeps_its_slider_and_forgets_how_the_last_one_reached() -> None:
    box = Controller(Options())
    pose = box.arm.tcp_pose()
    box.write_inputs({"speed_slider_mask": 1, "speed_slider_fraction": 0.4}, 0.0)
    here = box.servo_goal(pose)
    box.arm.set_tcp(make_pose(None, (0.0, 0.0, 0.1)))
    flange = matrix_from_pose(pose) @ make_pose(None, (0.0, 0.0, -0.1))
    assert_allclose(KINEMATICS.forward(box.servo_goal(pose)), flange, atol=1e-9)
    box.arm.set_tcp(np.eye(4))
    far = [HOME[0] - 0.3, *HOME[1:]]
    box.place(pose_from_matrix(KINEMATICS.forward(far)), far)
    flipped = [*HOME[:3], HOME[3] + 1e-3, HOME[4], HOME[5] + 2.0 * np.pi]
    box.place(pose, flipped)
    assert_allclose(box.servo_goal(pose), box.arm.q, atol=1e-6)
    assert abs(box.servo_goal(pose)[5] - here[5]) > 6.0
    assert box.arm.scaling == 0.4


@pytest.mark.parametrize("end", [Controller.protective_stop, lambda box: dashboard.answer(box, "stop")])
def test_a_program_that_was_stopped_before_it_began_does_not_begin(end) -> None:
    box = Controller(Options())
    box.tick(0.0)
    assert not box.upload(Script(box, "def f():\nend"), 0.0)
    end(box)
    for i in range(100):
        box.tick(DT * i)
        assert box.program is None
        assert box.runtime_state == STOPPED


def test_a_servo_step_keeps_joint_limits_and_does_not_overshoot() -> None:
    arm = Arm(KINEMATICS, HOME)
    arm.motion = Servo([HOME[0] + 1.5, *HOME[1:]], 0.03, 2000.0)
    reached, fastest = [], 0.0
    for _ in range(1500):
        arm.step(DT)
        reached.append(arm.q[0])
        fastest = max(fastest, abs(arm.target_qd[0]))
    assert fastest <= KINEMATICS.model.speed[0] + 1e-12
    assert_allclose(reached[-1], HOME[0] + 1.5, atol=1e-6)
    assert np.isfinite(reached).all()


def test_straight_moves_are_straight_and_take_the_time_of_their_trapezoid() -> None:
    arm = Arm(KINEMATICS, HOME)
    start = arm.tcp_pose()
    goal = (start[0] - 0.1, start[1] + 0.05, start[2], *start[3:])
    arm.motion = move = Move(arm, goal, 0.1, 0.5, cartesian=True)
    steps, away = 0, 0.0
    line = np.subtract(goal[:3], start[:3]) / np.linalg.norm(np.subtract(goal[:3], start[:3]))
    while not move.done:
        arm.step(DT)
        steps += 1
        off = np.subtract(arm.target_tcp_pose()[:3], start[:3])
        away = max(away, float(np.linalg.norm(off - line * (off @ line))))
    length = np.hypot(0.1, 0.05)
    assert steps * DT == pytest.approx(length / 0.1 + 0.1 / 0.5, abs=0.01)
    assert away < 1e-6
    assert_allclose(arm.target_tcp_pose(), goal, atol=1e-6)


def test_holding_brakes_every_joint_in_proportion() -> None:
    arm = Arm(KINEMATICS, HOME)
    arm.target_qd = [0.5, -0.25, 0.1, 0.0, 0.0, 0.0]
    arm.motion = hold = Hold(10.0)
    time = 0.0
    while not hold.done:
        arm.step(DT)
        time += DT
    assert time == pytest.approx(0.05, abs=0.005)


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
    box = Controller(Options(version=(5, 4, 2, 1)))
    assert "could not understand" in dashboard.answer(box, "is in remote control")


def test_only_loopback_is_served_unless_told_otherwise() -> None:
    assert loopback("127.0.0.7", anywhere=False) == "127.0.0.7"
    assert loopback("0.0.0.0", anywhere=True) == "0.0.0.0"
    for host in ("0.0.0.0", "192.168.1.5", "::"):
        with pytest.raises(SeedError, match="not a loopback address; add --anywhere"):
            loopback(host, anywhere=False)
    assert main(["--host", "0.0.0.0"]) == 2


def test_versions_are_read_and_nonsense_is_refused() -> None:
    assert version("5.12.4") == (5, 12, 4, 1101319)
    assert version("3.15.8.1") == (3, 15, 8, 1)
    with pytest.raises(SeedError, match=r"must be major.minor"):
        version("6.1")

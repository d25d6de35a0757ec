# SPDX-License-Identifier: Apache-2.0
"""No value that cannot be gets from the robot into a message, a command or an exception."""

import math

import pytest

from seed_driver.process.shared_memory import RobotState
from seed_driver.robot.connection import STATES, where_meant
from seed_driver.robot.link import RUNNING, LinkError, unable
from seed_driver.robot.state_checks import StateError, check_state
from seed_ur import rtde
from seed_ur.standin.controller import Controller
from seed_ur.standin.options import PERIOD, Options

MEANT = "target_q", "target_TCP_pose"  # used only where they are next to what the arm does
NUMBERS = [n for n in STATES if rtde.FORMATS[rtde.OUTPUTS[n]].endswith("d") and n not in MEANT]
WORDS = [n for n in STATES if n not in NUMBERS and n not in MEANT]


def values() -> dict:
    robot = Controller(Options())
    robot.tick(1.0)
    robot.tick(1.0 + PERIOD)
    return {name: robot.values[name] for name in STATES}


def spoiled(name: str, index: int, value: float) -> dict:
    good = values()
    if isinstance(good[name], int | float):
        good[name] = value
    else:
        good[name] = (*good[name][:index], value, *good[name][index + 1 :])
    return good


def test_a_state_of_a_healthy_robot_passes() -> None:
    check_state(values())


def test_a_controller_that_does_not_tell_its_tcp_passes() -> None:
    check_state({k: v for k, v in values().items() if k != "tcp_offset"})


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_that_cannot_be_is_named(name: str, value: float) -> None:
    length = 1 if isinstance(values()[name], float) else len(values()[name])
    for index in range(length):
        with pytest.raises(StateError, match=name):
            check_state(spoiled(name, index, value))


@pytest.mark.parametrize("off", [6e-3, -6e-3, math.nan, math.inf, -math.inf, 1e300])
def test_a_target_that_the_arm_is_not_next_to_is_not_taken_for_it(off: float) -> None:
    arm = RobotState(p=(0.4, 0.1, 0.3))
    near = arm._replace(q=(0.0, 0.01, *arm.q[2:]), p=(0.4, 0.101, 0.3))
    assert where_meant(arm, near) is near
    assert where_meant(arm, near._replace(p=(0.4, 0.1 + off, 0.3))) is arm
    assert where_meant(arm, near._replace(q=(0.0, 4.0 * off, *arm.q[2:]))) is arm
    assert where_meant(arm, near._replace(orientation=(0.0, 2.0 * off, 0.0, 1.0))) is arm


@pytest.mark.parametrize("value", [-2, 99, 2**31 - 1])
@pytest.mark.parametrize("name", WORDS)
def test_a_word_that_is_not_known_is_named(name: str, value: int) -> None:
    if name == "safety_status_bits" and value == 99:
        value = 1 << 12
    with pytest.raises(LinkError, match=f"{name} is {value}, which this driver does not know"):
        check_state(spoiled(name, 0, value))


def test_an_arm_with_an_enabling_device_that_is_pressed_passes_and_may_move() -> None:
    """Bit 0: normal mode; bit 11: 3PE input active."""
    bits = 1 << 0 | 1 << 11
    check_state(spoiled("safety_status_bits", 0, bits))
    assert unable(RUNNING, bits) == ""


def test_joints_further_than_they_turn_and_a_pose_further_than_it_reaches_are_named() -> None:
    with pytest.raises(StateError, match=r"actual_q\[3\] is 7, not within \+-6.4 \(rad\)"):
        check_state(spoiled("actual_q", 3, 7.0))
    with pytest.raises(StateError, match=r"actual_TCP_pose\[1\] is -12"):
        check_state(spoiled("actual_TCP_pose", 1, -12.0))
    with pytest.raises(StateError, match=r"speed_scaling is -0\.5"):
        check_state(spoiled("speed_scaling", 0, -0.5))

# SPDX-License-Identifier: Apache-2.0
"""The speed slider of the pendant: the arm falls behind, makes up for it within its limits, and is on its path again.

By simulated time; the robot's servo is the stand-in's, scaled in time as UR describes it.
"""

import pytest

from seed_core.arm.quaternion import turned
from seed_driver.motion.servo_motion import ServoMotion
from seed_testing.fault_bench.rig import play
from seed_testing.fault_bench.slider import CASES, ELBOW_UP, MAX_SPEED, MAX_TURNING, circle, measure


@pytest.mark.parametrize("case", CASES)
def test_the_arm_keeps_its_speed_and_comes_back_to_its_path(case: str) -> None:
    f = measure(CASES[case])
    assert 0.09 < f.top_speed <= MAX_SPEED
    assert f.top_turning <= MAX_TURNING
    assert f.path_error <= 1e-3
    assert f.behind <= 2e-3
    assert f.holds == 0


def test_a_command_that_is_not_scaled_would_have_the_arm_jump(monkeypatch) -> None:
    """What these cases are about: the bounds above can be missed."""
    step = ServoMotion.step
    monkeypatch.setattr(ServoMotion, "step", lambda self, share: [step(self) for _ in range(1 if share >= 0.9 else 2)])
    monkeypatch.setattr("seed_driver.motion.path_clock.STANDSTILL", 0.0)
    f = measure(CASES["10 %"], max_tracking_error=0.5, max_angular_tracking_error=3.0)
    assert f.top_speed > MAX_SPEED


def test_an_arm_slower_than_it_says_is_held_by_name() -> None:
    """A brake, a limit that is not told, somebody who holds it: the command does not go on without the arm."""
    _, holds = play(ELBOW_UP, circle, 3.0, slider=lambda t: 0.01 if t > 1.0 else 1.0, tells=False)
    assert holds[0].startswith("the arm is 0.030 m from its command (max_tracking_error 0.03 m)")
    assert "resend_robot_program" in holds[0]


def test_an_arm_that_lags_in_rotation_is_held_by_name() -> None:
    def turning(t, p, q):
        return p, turned(q, (min(0.4, 0.4 * t), 0.0, 0.0))

    _, holds = play(ELBOW_UP, turning, 1.5, slider=lambda t: 0.01 if t > 0.3 else 1.0, tells=False)
    assert "rad from its command (max_angular_tracking_error 0.15 rad)" in holds[0]


def test_usual_following_is_far_from_that_bound() -> None:
    """At the speed limit, with pauses of everything: there are holds for lost links, none for an arm left behind."""

    def shuttle(t, p, q):
        return (p[0], p[1] + 0.3 * (-1.0) ** int(t), p[2]), q

    for seed in range(3):
        robot, holds = play(ELBOW_UP, shuttle, 3.0, pauses=("process", "network", "robot"), seed=seed)
        assert robot.top_speed > 0.2
        assert not any("from its command" in reason for reason in holds)

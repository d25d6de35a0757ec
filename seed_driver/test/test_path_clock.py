# SPDX-License-Identifier: Apache-2.0
"""The command moves as the robot's clock does and as the robot scales it, whatever our clock shows."""

from itertools import pairwise

import pytest

from seed_driver.motion.path_clock import AHEAD, PathClock

DT = 0.002  # [s] the cycle
AT_ONCE = 1e9  # [1/s]


def steps(pace: float, scale: float = 1.0, cycles: int = 500) -> float:
    """Steps of motion in some cycles beside a robot whose clock runs at `pace` of ours and that scales its speed."""
    clock, total = PathClock(), 0.0
    clock.restart(7.0, scale)
    for i in range(cycles):
        clock.heard(7.0 + int(pace * i) * DT, scale)
        total += clock.share(DT, AT_ONCE)
    return total


@pytest.mark.parametrize("scale", [1.0, 0.1, 0.01])
@pytest.mark.parametrize("pace", [1.0, 0.5, 0.1])
def test_a_robot_gets_as_many_steps_as_it_has_time_for(pace, scale) -> None:
    assert steps(pace, scale) == pytest.approx(500 * pace * scale, abs=AHEAD * scale + 1e-9)


def test_a_robot_whose_clock_stands_still_gets_no_more_than_two_steps() -> None:
    assert steps(0.0) == AHEAD


def test_a_robot_whose_clock_has_run_ahead_gets_one_step_per_cycle() -> None:
    assert steps(10.0) == 500


def test_what_was_sent_too_much_before_the_slider_was_seen_is_paid_back_first() -> None:
    """Two steps ahead at full speed are 0.4 s of a robot at 1 %."""
    clock, waited = PathClock(), 0
    clock.restart(0.0, 1.0)
    assert [clock.share(DT, AT_ONCE) for _ in range(3)] == [1.0, 1.0, 0.0]
    while True:
        clock.heard((waited + 1) * DT, 0.01)
        if clock.share(DT, AT_ONCE):
            break
        waited += 1
    assert waited * DT == pytest.approx(0.4, abs=0.01)


def test_the_share_rises_slowly_and_falls_at_once() -> None:
    clock = PathClock()
    clock.restart(0.0, 0.1)
    shares = []
    for i in range(400):
        clock.heard((i + 1) * DT, 1.0 if i < 300 else 0.2)
        shares.append(clock.share(DT, 4.0))
    rises = [b - a for a, b in pairwise(shares[:300])]
    assert max(rises) <= 4.0 * DT + 1e-12
    assert shares[299] == 1.0
    assert max(shares[300:]) <= 0.2


def test_a_robot_that_comes_out_of_a_standstill_is_told() -> None:
    clock = PathClock()
    assert [clock.heard(i * DT, s) for i, s in enumerate((1.0, 0.0, 0.0, 0.5, 0.5))] == [
        False,
        False,
        False,
        True,
        False,
    ]
    assert clock.share(DT, AT_ONCE) == 0.5


@pytest.mark.parametrize("scale", [-0.5, 1.5])
def test_a_scale_that_cannot_be_is_taken_as_the_nearest_that_can(scale) -> None:
    clock = PathClock()
    clock.heard(DT, scale)
    assert clock.scale == min(1.0, max(0.0, scale))

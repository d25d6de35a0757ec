# SPDX-License-Identifier: Apache-2.0
"""The comparison of two clocks over a network, by ways there and back that are known."""

import numpy as np
import pytest

from seed_control.monitor.clock_skew import LASTS, LEAST, ClockSkew


def asked(skew: ClockSkew, at: float, there: float, back: float, ahead: float) -> bool:
    return skew.add(at, at + there + ahead, at + there + back)


@pytest.mark.parametrize("ahead", [0.0, 0.004, -0.004, 0.05, -0.05])
def test_the_offset_is_known_to_half_the_shortest_way_there_and_back(ahead: float) -> None:
    rng, skew = np.random.default_rng(3), ClockSkew(0.01)
    for i in range(25):
        there, back = 0.002 + rng.exponential(0.004, 2)
        assert asked(skew, 0.2 * i, there, back, ahead)
    assert abs(skew.offset - ahead) <= skew.within < 0.006
    assert bool(skew.problem) is (abs(ahead) > 0.01)
    side = "ahead of" if ahead > 0.0 else "behind"
    assert not skew.problem or f"{side} the controller's" in skew.problem


def test_a_way_there_that_is_longer_than_the_way_back_is_no_skew() -> None:
    """60 ms there, 2 ms back: the clocks seem 29 ms apart, and may be the same."""
    skew = ClockSkew(0.01)
    for i in range(LEAST):
        asked(skew, 0.2 * i, 0.06, 0.002, 0.0)
    assert skew.offset == pytest.approx(0.029)
    assert not skew.problem
    assert "known to 31.0 ms only" in skew.doubt


def test_too_few_answers_late_ones_and_old_ones_say_nothing() -> None:
    skew = ClockSkew(0.01)
    for i in range(LEAST):
        assert not skew.known
        assert not skew.problem
        assert bool(skew.pending) is (i > 0)
        asked(skew, 0.2 * i, 0.001, 0.001, 0.05)
    assert skew.problem
    assert not skew.pending
    assert not asked(skew, 1.0, 2.0, 0.001, 0.0)
    assert not skew.add(5.0, 5.0, 4.0)
    skew.look(LASTS + 10.0)
    assert not skew.known
    assert not skew.problem


def test_a_clock_that_was_set_right_is_believed_after_a_while() -> None:
    skew = ClockSkew(0.01)
    for i in range(30):
        asked(skew, 0.2 * i, 0.001, 0.001, 0.05)
    for i in range(30, 30 + int(LASTS / 0.2) + 2):
        asked(skew, 0.2 * i, 0.0011, 0.0011, 0.0)
        skew.look(0.2 * i)
    assert not skew.problem


def test_answers_before_this_clock_was_set_back_count_no_more() -> None:
    """By 2 s: they are not old by the new time, and 2 s wrong."""
    skew = ClockSkew(0.01)
    for i in range(20):
        asked(skew, 0.2 * i, 0.001, 0.001, 0.0)
    for i in range(LEAST):
        asked(skew, 2.0 + 0.2 * i, 0.0011, 0.0011, 2.0)
        skew.look(2.1 + 0.2 * i)
    assert skew.offset == pytest.approx(2.0)
    assert skew.problem

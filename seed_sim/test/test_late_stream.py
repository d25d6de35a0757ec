# SPDX-License-Identifier: Apache-2.0
"""Simulated time waits for a late stream, and not for ever."""

from seed_sim.plant.late_stream import LONGEST, LateStream


def test_a_stream_that_never_came_is_not_waited_for() -> None:
    assert not LateStream(0.1).late(1e9, 0.0)


def test_time_stands_still_from_the_patience_on_until_the_next_message() -> None:
    stream = LateStream(0.1)
    stream.hear(5.0)
    assert not stream.late(5.09, 0.0)
    assert stream.late(5.11, 0.0)
    stream.hear(5.08)
    assert not stream.late(5.11, 0.5)


def test_a_stream_that_has_ended_is_given_up_until_it_is_heard_again() -> None:
    stream = LateStream(0.1)
    stream.hear(5.0)
    assert stream.late(5.2, 10.0)
    assert stream.late(5.2, 10.0 + 0.9 * LONGEST)
    assert not stream.late(5.2, 10.0 + 1.1 * LONGEST)
    assert not stream.late(9.0, 20.0)
    stream.hear(9.0)
    assert stream.late(9.2, 21.0)


def test_a_slow_stream_is_given_its_own_period() -> None:
    stream = LateStream(0.1)
    for i in range(20):
        assert i < 2 or not stream.late(5.0 + 0.2 * i, 0.0)
        stream.hear(5.0 + 0.2 * i)
    assert stream.late(5.0 + 0.2 * 19 + 0.5, 0.0)


def test_a_message_that_was_lost_does_not_hold_time_up() -> None:
    """Time must go on for the next to be sent; further than that it waits."""
    stream = LateStream(0.1, 10.0)
    for i in range(20):
        stream.hear(5.0 + 0.05 * i)
    newest = 5.0 + 0.05 * 19
    assert stream.late(newest + 0.12, 0.0)
    assert stream.late(newest + 0.12, 0.9)
    assert not stream.late(newest + 0.12, 1.1)
    assert stream.late(newest + 0.17, 1.2)
    assert not stream.late(newest + 0.17, 10.1)

# SPDX-License-Identifier: Apache-2.0
"""The link is judged by the controller's clock and its state words, not by what a library returns."""

import pytest

from seed_driver.robot.link import LinkWatch, at_range_end, safety_stop, unable


def test_an_advancing_clock_is_alive_and_a_standing_one_is_lost_within_a_tenth() -> None:
    watch, now = LinkWatch(), 100.0
    for i in range(50):
        now += 0.004
        assert watch.update(i * 0.004, now)
        assert not watch.lost(now)
    start = now
    while not watch.lost(now):
        now += 0.004
        watch.update(49 * 0.004, now)
    assert 0.05 < now - start < 0.1
    assert not watch.hopeless(now)


def test_our_own_pause_is_not_taken_for_the_robots() -> None:
    watch = LinkWatch()
    watch.update(1.0, 100.0)
    watch.update(1.0, 100.3)  # we slept; the next look finds news
    assert not watch.lost(100.3)
    assert watch.update(1.3, 100.302)
    assert not watch.lost(100.302)


@pytest.mark.parametrize(
    ("bits", "name"),
    [
        (0x001, ""),
        (0x002, ""),
        (0x004, "protective stop"),
        (0x0C0, "emergency stop"),
        (0x010, "safeguard stop"),
        (0x200, "safety fault"),
    ],
)
def test_safety_bits_have_names(bits: int, name: str) -> None:
    assert safety_stop(bits) == name


def test_a_robot_without_power_or_brakes_cannot_move() -> None:
    assert unable(7, 0x001) == ""
    assert unable(3, 0x001) == "robot is powered off"
    assert "brakes closed" in unable(5, 0x001)
    assert unable(3, 0x0C0) == "emergency stop"


def test_a_joint_at_the_end_of_its_range_is_named() -> None:
    assert at_range_end((0.0, -1.7, 2.1, -6.2, 1.5, 6.22)) == ""
    words = at_range_end((0.0, -1.7, 2.1, -1.97, -6.26, 6.26))
    assert words == "wrist_2_joint is at -358.7 degrees, its range ends at 360: turn it back on the pendant"

# SPDX-License-Identifier: Apache-2.0
"""Depth that goes on turning while markers rest is a slip, though each of its images knows the turn badly."""

from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from seed_estimation.slip import turning
from seed_estimation.slip.markers import UNSEEN, Depth, Observation
from seed_estimation.slip.turning import BEFORE, FEWEST, GROWTH, RESTING, Turn, Turning, grown, slid_on

PERIOD, REACH = 1.0 / 45.0, 0.01  # [s], [m]
NOISE = 1.8e-4  # [m] of one image
STOP = 0.5  # [s] when the markers stop
Angle = Callable[[float], float]


def stopped(t: float, speed: float = 2.0) -> float:
    """[rad] of markers that go with a tool until STOP."""
    return speed * (min(t, STOP) - STOP)


def told(
    tool: Angle, markers: Angle = stopped, noise: float = NOISE, deviation: float = 2.5 * NOISE, seed: int = 0
) -> float | None:
    """When a turn is told [s] after STOP; None: never within 0.4 s."""
    rng, turns = np.random.default_rng(seed), deque[Turn](maxlen=RESTING + BEFORE)
    for t in np.arange(0.0, STOP + 0.4, PERIOD).tolist():
        gap = REACH * (tool(t) - markers(t)) + noise * rng.normal()
        turns.append(Turn(t, gap, deviation, np.array((REACH * markers(t), 0.0, 0.0)) + 5e-6 * rng.normal(size=3)))
        if grown(turns):
            return t - STOP
    return None


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_tool_that_turns_on_at_2_rad_s_is_told_within_150_ms(sign: float) -> None:
    for seed in range(20):
        at = told(lambda t: 2.0 * sign * (t - STOP), lambda t: sign * stopped(t), seed=seed)
        assert at is not None
        assert 0.0 < at < 0.15


@pytest.mark.parametrize("late", [0.0, 1.0, 1.5])  # [images]
@pytest.mark.parametrize("gain", [0.8, 1.0, 1.2])
def test_depth_that_is_late_or_of_another_scale_tells_no_turn_as_tool_and_markers_stop(
    late: float, gain: float
) -> None:
    def seen(t: float) -> float:
        return gain * stopped(t - late * PERIOD)

    assert [told(seen, seed=seed) for seed in range(40)] == [None] * 40


def test_markers_that_go_on_say_that_the_tool_sticks() -> None:
    """Depth whose scale is wrong by a third turns further than the markers, and nothing slides."""
    assert [told(lambda t: 1.33 * t, lambda t: t, seed=seed) for seed in range(50)] == [None] * 50


@pytest.mark.parametrize(("share", "is_told"), [(0.3, True), (0.5, False)])
@pytest.mark.parametrize("axis", [0, 2])  # turn, along z
def test_markers_that_go_on_in_whatever_direction_do_not_rest(axis: int, share: float, is_told: bool) -> None:
    """Their way in the last images, as a share of what depth has seen of a turn."""
    turns, gone = [], 3.0 * GROWTH
    for i in range(12 + RESTING):
        markers = np.zeros(3)
        markers[axis] = share * gone * min(max(i - 12, 0) / (RESTING - 1), 1.0)
        turns.append(Turn(i * PERIOD, gone * (i >= 12), 1e-6, markers))
    assert bool(grown(turns)) == is_told


def test_noisy_depth_must_see_a_larger_turn() -> None:
    def tool(t: float) -> float:
        return 2.0 * GROWTH / REACH if t > STOP else 0.0

    def markers(_: float) -> float:
        return 0.0

    assert told(tool, markers, noise=1e-4, deviation=1e-4) is not None
    assert told(tool, markers, noise=1e-3, deviation=1e-4) is None
    assert told(tool, markers, noise=1e-4, deviation=2e-3) is None


@pytest.mark.parametrize(("share", "is_told"), [(0.95, False), (1.05, True)])
def test_less_than_three_degrees_are_not_told(share: float, is_told: bool) -> None:
    turns = [Turn(i * PERIOD, share * GROWTH * (i >= 12), 1e-6, np.zeros(3)) for i in range(12 + RESTING)]
    assert bool(grown(turns)) == is_told


@pytest.mark.parametrize(("count", "is_told"), [(FEWEST - 1, False), (FEWEST, True)])
def test_a_few_images_tell_nothing(count: int, is_told: bool) -> None:
    turns = [Turn(i * PERIOD, 0.001 * (i >= count), 1e-6, np.zeros(3)) for i in range(count + RESTING)]
    assert bool(grown(turns)) == is_told


class Watched:
    """Turning, told of a box: its depth sees the turn badly, and turns on by 10 degrees as the markers rest."""

    def __init__(self) -> None:
        self.turning, self.stamp = Turning([], [], REACH), 0.0

    def image(self, gap: float, markers: float = 0.001, incipient: float = 0.05, deviation: float = 5e-4) -> bool:
        """gap, markers: turns at REACH [m]; deviation: depth's [m]."""
        self.stamp += PERIOD
        displacement = np.array((markers, 0.0, 0.0))
        seen = Observation(self.stamp, displacement, abs(markers), UNSEEN, incipient, False, 0.0)
        fingers: list[Any] = [SimpleNamespace(seen=[seen], X_CT=np.eye(4))] * 2
        depth = Depth(displacement + np.array((gap, 0.0, 0.0)), np.array((deviation, 1e-4, 1e-3)))
        return self.turning.goes_on({}, np.eye(4), fingers, depth)

    def turns_on(self, **how: float) -> bool:
        for _ in range(12):
            assert not self.image(0.0, **how)
        return any(self.image(0.0017, **how) for _ in range(RESTING))


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Watched:
    monkeypatch.setattr(turning, "by_depth", lambda *_: None)
    return Watched()


def test_a_box_that_turns_on_is_told(watched: Watched) -> None:
    assert watched.turns_on()


def test_a_tool_that_turns_back_is_not_told(watched: Watched) -> None:
    assert not watched.turns_on(markers=-0.001)


def test_a_patch_that_sticks_to_its_edge_is_not_told(watched: Watched) -> None:
    assert not watched.turns_on(incipient=0.02)


def test_a_turn_that_depth_sees_well_is_left_to_the_other_signs(watched: Watched) -> None:
    assert not watched.turns_on(deviation=1e-4)


@pytest.mark.parametrize("by", [-0.1, 0.2])  # [s]
def test_images_of_another_time_do_not_count(watched: Watched, by: float) -> None:
    for _ in range(12):
        watched.image(0.0)
    watched.stamp += by
    assert not any(watched.image(0.0017) for _ in range(RESTING))


def test_markers_that_were_found_a_pitch_further_begin_anew(watched: Watched) -> None:
    for _ in range(12):
        watched.image(0.0, markers=0.003)
    assert not any(watched.image(0.0015, markers=0.0015) for _ in range(RESTING))


def ended(
    tool: Angle,
    markers: Angle = stopped,
    edge: float = 0.45,
    noise: float = NOISE,
    start: float = STOP - 0.08,
    ahead: float = 0.16,
    seed: int = 0,
) -> float | None:
    """When a turn that ends is told [s] after STOP; None: never within 0.2 s.

    tool, markers: turn [rad] by time; edge: share by which the patch's edge follows its middle; start: of the turn [s];
    ahead: turn of the markers at STOP [rad].
    """
    rng, turns = np.random.default_rng(seed), deque[Turn](maxlen=RESTING + BEFORE)
    for t in np.arange(0.0, STOP + 0.2, PERIOD).tolist():
        at, last = (ahead + markers(max(s, start)) for s in (t, t - PERIOD))
        gap = REACH * (tool(max(t, start)) - markers(max(t, start))) + noise * rng.normal()
        step = REACH * (at - last)
        displacement = np.array((REACH * at, 0.0, 0.0)) + 5e-6 * rng.normal(size=3)
        twist = np.array((step, edge * step)) if abs(step) > 1e-5 else None
        turns.append(Turn(t, gap, 2.5 * NOISE, displacement, twist))
        if slid_on(turns):
            return t - STOP
    return None


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_tool_that_turns_on_as_its_patch_has_let_go_is_told_within_100_ms(sign: float) -> None:
    for seed in range(20):
        at = ended(lambda t: 2.0 * sign * (t - STOP), lambda t: sign * stopped(t), ahead=0.16 * sign, seed=seed)
        assert at is not None
        assert 0.0 < at < 0.1


def test_a_tool_that_turns_on_under_a_patch_that_turned_as_one_is_left_to_the_longer_mean() -> None:
    assert ended(lambda t: 2.0 * (t - STOP), edge=0.75) is None


@pytest.mark.parametrize("late", [0.0, 1.5])  # [images]
@pytest.mark.parametrize("gain", [0.8, 1.0, 1.2])
def test_a_tool_that_is_stopped_as_its_patch_nearly_lets_go_is_no_slip(late: float, gain: float) -> None:
    start = STOP - 0.08

    def seen(t: float) -> float:
        return gain * (stopped(max(t - late * PERIOD, start)) - stopped(start)) + stopped(start)

    assert sum(ended(seen, seed=seed) is not None for seed in range(100)) <= 1


def test_markers_that_spring_back_have_held_nothing() -> None:
    assert ended(lambda t: 2.0 * (t - STOP), ahead=-0.02) is None


def test_a_tool_that_turned_all_the_while_shows_no_gap_to_compare_with() -> None:
    assert ended(lambda t: 2.0 * (t - STOP), start=0.0, ahead=1.0) is None


def test_a_turn_that_slows_down_is_no_slip() -> None:
    """The markers come to rest with the tool, over tenths of a second."""

    def slows(t: float) -> float:
        return -0.16 * (1.0 + float(np.cos(np.pi * min(max(t - 0.15, 0.0) / 0.35, 1.0)))) / 2.0

    assert [ended(slows, slows, start=0.0, seed=seed) for seed in range(20)] == [None] * 20

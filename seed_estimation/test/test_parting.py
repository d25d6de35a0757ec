# SPDX-License-Identifier: Apache-2.0
"""Markers of two fingers that go apart: a rigid tool sticks to one of them at most."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from seed_core.spatial import make_pose, so3_exp
from seed_estimation.slip.markers import UNSEEN, Observation
from seed_estimation.slip.parting import Gap, Parting, UsualGap

PERIOD = 1.0 / 45.0  # [s]
SIDE = 0.012  # [m] of each patch from the grasp's middle
NOISE, TURN_NOISE = 8e-6, 5e-4  # [m] of each finger's markers, [rad] of depth
BEGIN = 2.0  # [s] of a tool that is only handled

Motion = Callable[[float], float]


def handled(t: float) -> float:
    """[m] along z."""
    return 0.002 * float(np.sin(2.0 * t))


def dragged(t: float, bears: float) -> float:
    """[m] along z with 40 mm/s from BEGIN on, until friction bears no more."""
    return handled(min(t, BEGIN)) + min(0.04 * max(t - BEGIN, 0.0), bears)


def rings(
    left: Motion,
    right: Motion,
    held: Motion = np.zeros_like,
    by_depth: Motion | None = None,
    axis: int = 2,
    stated: float = TURN_NOISE,
) -> float | None:
    """When fingers part [s] whose markers are so far along an axis [m] at a time; None: never.

    axis: 0: turned about y, at the patch's reach; 2: along z.
    held: turn about x [rad] at which the images have the tool.
    by_depth: at which depth sees it; default: the same. stated: deviation of that [rad].
    """
    parting, rng = Parting(), np.random.default_rng(3)
    fingers: list[Any] = [SimpleNamespace(seen=[], side=side, X_CT=np.eye(4)) for side in (SIDE, -SIDE)]
    for t in np.arange(PERIOD, BEGIN + 1.0, PERIOD).tolist():
        for finger, way in zip(fingers, (left, right), strict=True):
            finger.X_CT = make_pose(so3_exp((held(t), 0.0, 0.0)))
            displacement = np.zeros(3)
            displacement[axis] = way(t) + NOISE * rng.normal()
            size = float(np.abs(displacement).max())
            finger.seen = [*finger.seen[-4:], Observation(t, displacement, size, UNSEEN, 0.0, False, 0.0)]
        seen = (by_depth or held)(t) + TURN_NOISE * rng.normal()
        if parting.parts(fingers, np.array((0.0, held(t))), np.array((0.0, seen)), np.full(2, stated)):
            return t
    return None


@pytest.mark.parametrize("less", [0.0004, 0.0015])
def test_fingers_of_which_one_stops_earlier_are_told(less: float) -> None:
    at = rings(lambda t: dragged(t, 0.0045 - less), lambda t: dragged(t, 0.0045))
    assert at is not None
    assert -0.001 < at - BEGIN - 0.0045 / 0.04 < 0.1


@pytest.mark.parametrize("less", [0.0006, 0.0015])
def test_fingers_of_which_one_turns_less_are_told(less: float) -> None:
    at = rings(lambda t: dragged(t, 0.0025 - less), lambda t: dragged(t, 0.0025), axis=0)
    assert at is not None
    assert -0.001 < at - BEGIN - 0.0025 / 0.04 < 0.1


def test_fingers_that_turn_nearly_alike_are_not_told() -> None:
    assert rings(lambda t: dragged(t, 0.0023), lambda t: dragged(t, 0.0025), axis=0) is None


def test_fingers_that_turn_apart_slowly_are_not_told() -> None:
    """At 7 mm/s a load may part them with a part of the patches sliding."""

    def slowly(bears: float) -> Motion:
        return lambda t: min(0.007 * max(t - BEGIN, 0.0), bears)

    assert rings(slowly(0.0015), slowly(0.0025), axis=0) is None


def test_fingers_are_told_that_would_rather_have_the_tool_turned() -> None:
    """The images explain 0.5 mm between the fingers by a turn of 1.2 degrees, which depth does not see."""
    slid = 0.0005 / (2.0 * SIDE)

    def true(t: float) -> float:
        return 0.03 * float(np.sin(1.5 * t))

    def turned(t: float) -> float:
        return true(t) + slid * min(max(t - BEGIN - 0.1, 0.0) / 0.05, 1.0)

    at = rings(lambda t: dragged(t, 0.004), lambda t: dragged(t, 0.004), turned, true)
    assert at is not None
    assert at < BEGIN + 0.3


def test_a_drag_that_both_bear_or_that_ends_parts_nothing() -> None:
    assert rings(lambda t: dragged(t, 0.004), lambda t: dragged(t, 0.004)) is None


@pytest.mark.parametrize(("stated", "is_told"), [(TURN_NOISE, True), (0.02, False)])
def test_a_turn_that_depth_sees_badly_parts_nothing(stated: float, is_told: bool) -> None:
    """0.8 degrees off."""
    both = [lambda t: dragged(t, 0.004)] * 2
    at = rings(*both, by_depth=lambda t: 0.014 * (t > BEGIN), stated=stated)
    assert (at is not None) is is_told


@pytest.mark.parametrize(("sides", "is_told"), [((1.0, 1.0), True), ((1.0, -1.0), False)])
def test_a_gap_that_changes_its_side_is_noise(sides: tuple[float, float], is_told: bool) -> None:
    usual, still = UsualGap(), np.array((1.0, 0.0, 0.0, 0.0))
    for i in range(20):
        assert not usual.unlike(Gap(i * PERIOD, 0.0, 4e-10, still, 0.0, 2e-4, stops=True))
    told = [
        usual.unlike(Gap((20 + i) * PERIOD, 1e-3 * side, 4e-10, still, 0.0, 2e-4, stops=True))
        for i, side in enumerate(sides)
    ]
    assert told == [False, is_told]


@pytest.mark.parametrize("skew", [-0.022, 0.022])
@pytest.mark.parametrize("speed", [0.02, 0.1])
def test_images_that_are_not_of_one_time_part_nothing(skew: float, speed: float) -> None:
    """There and back ever faster, stopping at both ends; and at a moment's notice."""

    def tool(t: float) -> float:
        return 0.004 * float(np.sin(speed / 0.004 * t * t / (t + 2.0)))

    assert rings(tool, lambda t: tool(t - skew)) is None
    assert rings(lambda t: dragged(t, 0.004), lambda t: dragged(t - skew, 0.004)) is None


def test_markers_that_are_found_a_pitch_further_are_not_apart() -> None:
    assert rings(handled, lambda t: handled(t) + (0.0035 if t > BEGIN else 0.0)) is None


def test_what_creeps_unevenly_while_it_sticks_is_not_apart() -> None:
    assert rings(handled, lambda t: handled(t) + 2e-5 * t) is None


@pytest.mark.parametrize("scale", [0.95, 1.05])
def test_a_tool_that_turns_parts_markers_by_what_is_mistaken_of_their_distance(scale: float) -> None:
    """A camera's depth that is 5 % off in scale, 80 mm from the patch, and that comes 15 ms late."""

    def turn(t: float) -> float:
        return 0.1 * float(np.sin(1.5 * t))

    off = 0.08 * (scale - 1.0)
    assert (
        rings(
            lambda t: handled(t) + off * turn(t), handled, turn, lambda t: turn(t) + scale * turn(t - 0.015) - turn(t)
        )
        is None
    )


@pytest.mark.parametrize("back", [0.5, 5.0, 200.0])
def test_a_clock_that_is_set_back_parts_nothing(back: float) -> None:
    """As where a bag is played again and again, or a simulation is reset."""
    parting = Parting()
    fingers: list[Any] = [SimpleNamespace(seen=[], side=side, X_CT=np.eye(4)) for side in (SIDE, -SIDE)]
    for start in (back, 0.0):
        for t in (start + np.arange(PERIOD, BEGIN, PERIOD)).tolist():
            for finger in fingers:
                seen = [s for s in finger.seen[-4:] if s.stamp < t]
                place = np.array((0.0, 0.0, handled(t)))
                finger.seen = [*seen, Observation(t, place, abs(handled(t)), UNSEEN, 0.0, False, 0.0)]
            assert not parting.parts(fingers, np.zeros(2), np.zeros(2), np.full(2, TURN_NOISE))

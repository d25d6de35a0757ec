# SPDX-License-Identifier: Apache-2.0
"""Markers of two fingers that go apart: a rigid tool sticks to one of them at most."""

from collections.abc import Callable

import numpy as np
import pytest

from seed_core.spatial import Array
from seed_estimation.slip.markers import UNSEEN, Observation
from seed_estimation.slip.parting import PARTED, Parting

PERIOD = 1.0 / 30.0  # [s]


def rings(
    left: Callable[[float], float], right: Callable[[float], float], until: float = 1.0, turned: float = 0.0
) -> float | None:
    """When the alarm is raised [s] for markers that are so far along z [m] at a time; None: never."""
    parting, seen = Parting(), ([], [])

    def observed(t: float, z: float) -> Observation:
        displacement: Array = np.array((0.0, 0.0, z))
        return Observation(t, displacement, abs(z), UNSEEN, 0.0, False, 0.0)

    for t in np.arange(PERIOD, until, PERIOD).tolist():
        for one, z in zip(seen, (left(t), right(t)), strict=True):
            one.append(observed(t, z))
        if parting.parts(seen[0][-5:], seen[1][-5:], turned):
            return t
    return None


def test_fingers_of_which_one_stops_earlier_are_told() -> None:
    """Dragged with 40 mm/s; the left one's friction bears 3 mm, the right one's 4.5 mm."""
    at = rings(lambda t: min(0.04 * t, 0.003), lambda t: min(0.04 * t, 0.0045))
    assert at is not None
    assert at < 0.0045 / 0.04 + 3 * PERIOD


@pytest.mark.parametrize("skew", [-0.022, 0.022])
@pytest.mark.parametrize("speed", [0.02, 0.1])
def test_images_that_are_not_of_one_time_part_nothing(skew: float, speed: float) -> None:
    """There and back, stopping at both ends."""

    def tool(t: float) -> float:
        return 0.004 * float(np.sin(speed / 0.004 * t))

    assert rings(tool, lambda t: tool(t - skew), 3.0) is None


def test_markers_that_are_found_a_pitch_further_are_not_apart() -> None:
    assert rings(lambda t: 0.002 * t, lambda t: 0.002 * t + (0.0025 if t > 0.5 else 0.0)) is None


def test_what_creeps_unevenly_while_it_sticks_is_not_apart() -> None:
    assert rings(lambda t: 0.006 * t, lambda t: 0.006 * t - 0.8 * PARTED * min(t, 1.0)) is None


@pytest.mark.parametrize("turned", [0.0, 0.2])
def test_a_tool_that_has_turned_parts_markers_by_what_is_mistaken_of_their_distance(turned: float) -> None:
    """5 % of 80 mm on either side."""
    assert (rings(lambda t: 0.0035 * t, lambda t: 0.0051 * t, turned=turned) is None) == (turned > 0.0)

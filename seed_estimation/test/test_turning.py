# SPDX-License-Identifier: Apache-2.0
"""Depth that goes on turning while markers rest is a slip, though each of its images knows the turn badly."""

from collections import deque
from collections.abc import Callable

import numpy as np
import pytest

from seed_estimation.slip.turning import BEFORE, GROWTH, RESTING, Turn, grown

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


def test_a_tool_that_stops_with_its_markers_is_not_told() -> None:
    assert [told(stopped, seed=seed) for seed in range(200)] == [None] * 200


def test_markers_that_go_on_say_that_the_tool_sticks() -> None:
    """Depth whose scale is wrong by a third turns further than the markers, and nothing slides."""
    assert [told(lambda t: 1.33 * t, lambda t: t, seed=seed) for seed in range(50)] == [None] * 50


def test_noisy_depth_must_see_a_larger_turn() -> None:
    grows = 2.0 * GROWTH / REACH  # [rad]

    def tool(t: float) -> float:
        return grows if t > STOP else 0.0

    def markers(_: float) -> float:
        return 0.0

    assert told(tool, markers, noise=1e-4, deviation=1e-4) is not None
    assert told(tool, markers, noise=1e-3, deviation=1e-4) is None
    assert told(tool, markers, noise=1e-4, deviation=2e-3) is None


def test_a_few_images_tell_nothing() -> None:
    assert grown([Turn(i * PERIOD, 0.001 * i, NOISE, np.zeros(3)) for i in range(RESTING + 2)]) == 0.0

# SPDX-License-Identifier: Apache-2.0
"""Material that stops under a patch that slides has been stretched; a tool that was stopped leaves it as it was."""

from collections.abc import Callable
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from seed_core.spatial import Array
from seed_estimation.slip.markers import UNSEEN, Observation
from seed_estimation.slip.stretching import LATELY, Drag, Stretching, stops_stretched

PERIOD, SPEED = 1.0 / 45.0, 0.06  # [s], [m/s]
STOP = 0.003  # [m] of way at which the material stops
Lag = Callable[[float], float]


def slides(way: float) -> float:
    """[m] that a patch's ends lag behind its middle after a way [m], as more and more of it slides."""
    return 0.07 * max(way - 0.001, 0.0) + 0.03 * min(way, 0.001)


def half_slides(way: float) -> float:
    return 0.04 * way


def sticks(way: float) -> float:
    return 0.005 * way


def dragged(t: float) -> float:
    return min(SPEED * max(t, 0.0), STOP)


def told(
    lag: Lag, way: Lag = dragged, other: Lag | None = None, axis: int = 1, along: float = 1.0, incipient: float = 0.05
) -> float | None:
    """When a slip is told [s] after the drag began; None: never.

    lag: of both patches' ends by way; way, other: of the fingers' material by time [m].
    """
    rng, noise, drags = np.random.default_rng(4), 5e-6, list[Drag]()
    for t in np.arange(-5 * PERIOD, 0.4, PERIOD).tolist():
        ways, lags = np.zeros((2, 2)), np.zeros((2, 2))
        ways[:, axis] = along * way(t), along * (other or way)(t)
        lags[:, axis] = [-along * lag(along * w) for w in ways[:, axis]]
        seen = Drag(t, ways + noise * rng.normal(size=(2, 2)), lags + 2.0 * noise * rng.normal(size=(2, 2)), incipient)
        drags = [d for d in drags if t - d.stamp <= LATELY] + [seen]
        if stops_stretched(drags, axis):
            return t
    return None


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("along", [-1.0, 1.0])
def test_a_patch_that_slid_nearly_everywhere_as_it_stopped_is_told_within_three_images(axis: int, along: float) -> None:
    at = told(slides, axis=axis, along=along)
    assert at is not None
    assert 0.0 <= at - STOP / SPEED < 3.0 * PERIOD


@pytest.mark.parametrize("lag", [sticks, half_slides])
def test_a_tool_that_is_stopped_is_no_slip(lag: Lag) -> None:
    assert told(lag) is None


def test_a_small_lag_is_no_slip() -> None:
    """A patch that slid everywhere, but under next to no friction, or so small a one that noise looks alike."""
    assert told(lambda way: 0.3 * slides(way)) is None


def test_a_soft_sheet_that_gives_way_under_a_load_it_bears_is_no_slip() -> None:
    assert told(lambda way: 3.0 * slides(way)) is None
    assert told(slides, incipient=0.01) is None


def test_a_finger_that_goes_on_or_goes_back_says_the_tool_does() -> None:
    assert told(slides, other=lambda t: SPEED * max(t, 0.0)) is None
    back = 0.5 * SPEED

    def returns(t: float) -> float:
        return dragged(t) - back * max(t - STOP / SPEED, 0.0)

    assert told(slides, way=returns) is None


def test_a_drag_that_slows_down_is_no_slip() -> None:
    """Ordinary manipulation comes to rest over tenths of a second."""
    ways = [STOP * (1.0 - np.cos(np.pi * min(max(t, 0.0) / 0.3, 1.0))) / 2.0 for t in np.arange(0.0, 0.4, PERIOD)]
    assert max(b - a for a, b in pairwise(ways)) > 0.015 * PERIOD  # it was fast
    assert told(slides, way=lambda t: STOP * (1.0 - float(np.cos(np.pi * min(max(t, 0.0) / 0.3, 1.0)))) / 2.0) is None


def test_without_the_lag_before_or_now_nothing_is_told() -> None:
    drags = [Drag(i * PERIOD, np.full((2, 2), 1e-3 * min(i, 3)), None, 0.05) for i in range(5)]
    assert not stops_stretched(drags, 1)
    drags[-1] = drags[-1]._replace(lag=np.full((2, 2), -3e-4))
    assert not stops_stretched(drags, 1)


@pytest.mark.parametrize(("unseen", "is_told"), [((False, True), True), ((True, False), False)])
@pytest.mark.parametrize("start", [0.0, 100.0])  # [s]; of a clock that was at 50
def test_images_tell_it_along_what_depth_does_not_see(
    start: float, unseen: tuple[bool, bool], is_told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tool that is held for a second, and then slides along z."""
    now = 0.0

    def lag(*_: object) -> Array:
        return np.tile((0.0, -slides(dragged(now))), (2, 1))

    stretching = Stretching([])
    monkeypatch.setattr(stretching, "_lag", lag)
    times = np.arange(-1.0, 0.2, PERIOD)
    told = []
    for t, stamp in [(-1.0, 50.0), *zip(times.tolist(), (start + 1.0 + times).tolist(), strict=True)]:
        now = t
        seen = Observation(stamp, np.array((0.0, 0.0, dragged(t))), dragged(t), UNSEEN, 0.05, False, 0.0)
        fingers: list[Any] = [SimpleNamespace(seen=[seen])] * 2
        told += [t] if stretching.slides({}, np.eye(4), fingers, np.array(unseen)) else []
    assert bool(told) is is_told
    assert not told or 0.0 <= told[0] - STOP / SPEED < 0.1

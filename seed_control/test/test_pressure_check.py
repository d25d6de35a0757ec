# SPDX-License-Identifier: Apache-2.0
"""Pressures that are not those of the identification, or no pressures at all: named, and the arm holds."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from quasi_static import Bench

from seed_control.controller import ControlRefusedError
from seed_control.monitor.pressure_check import PressureCheck
from seed_core.estimate import MembraneMotion, RelativePoseEstimate
from seed_core.spatial import make_pose

GRIPS = (1030.0, 1045.0)  # [hPa]
RNG = np.random.default_rng(2)


def estimate(t: float, left: float, right: float = 1036.0, depth: float = 2e-3) -> RelativePoseEstimate:
    fingers = (("left", left), ("right", right))
    membrane = tuple(MembraneMotion(f, make_pose(), pressure=p, indentation=depth) for f, p in fingers)
    return RelativePoseEstimate(t, make_pose(), membrane=membrane)


def told(left: Callable[[float], float], seconds: float = 4.0, needed: bool = False, breath: float = 5e-4) -> str:
    """Of a left sensor that reads left(t); the imprints breathe by a millimetre, twice `breath`."""
    check = PressureCheck(GRIPS, needed)
    for t in np.arange(0.0, seconds, 0.022):
        right = 1036.0 + 0.05 * RNG.standard_normal()
        check.update(estimate(t, left(t), right, 2e-3 + breath * np.sin(3.0 * t)))
    return check.reason


def noisy(t: float) -> float:
    return 1037.0 + np.sin(3.0 * t) + 0.05 * float(RNG.standard_normal())


@pytest.mark.parametrize(
    ("left", "words"),
    [
        (noisy, ""),
        (lambda t: round(noisy(t)), ""),  # a coarse sensor repeats itself
        (lambda t: noisy(t) + 30.0, ""),  # 3 % beyond the stiffest grip are of the same kind
        (lambda t: 0.1 * noisy(t), "it looks like kPa"),
        (lambda t: 100.0 * noisy(t), "it looks like Pa"),
        (lambda t: noisy(t) - 1013.25, "above the ambient"),
        (lambda t: noisy(t) + 80.0, "another membrane, another grip"),
        (lambda t: noisy(min(t, 0.0)) if t < 2.0 else np.nan, "left bubble is silent: none for 2"),
        (lambda t: noisy(t) if t < 2.0 else 1036.5, "left bubble is stuck at 1036.5 hPa"),
        (lambda _: 1036.5, "left bubble is stuck at 1036.5 hPa"),
    ],
)
def test_a_pressure_is_named_with_what_is_wrong(left: Callable[[float], float], words: str) -> None:
    reason = told(left)
    assert words in reason
    assert bool(reason) == bool(words)
    if "looks like" in words or "another" in words:
        assert "identified at 1030 hPa" in reason or "identified at 1045 hPa" in reason


@pytest.mark.parametrize(
    ("left", "words"),
    [
        (lambda t: noisy(t) if t < 7.0 else 1036.5, "left bubble is stuck at 1036.5 hPa"),
        (lambda _: 1036.5, ""),  # coarse, and nothing moves
        (lambda t: 1036.0 + int(min(t, 7.3) / 0.22) % 2, ""),  # ten readings are the same, then 33
    ],
)
def test_a_grasp_at_rest_has_a_stuck_pressure_only_where_the_sensor_was_lively(left, words: str) -> None:
    reason = told(left, 8.0, breath=0.0)
    assert words in reason
    assert bool(reason) == bool(words)


def test_a_missing_sensor_matters_where_the_wrench_needs_it() -> None:
    assert told(lambda _: np.nan) == ""
    assert "left bubble is silent: none for 4.0 s, at most 1 s" in told(lambda _: np.nan, 4.02, needed=True)


def test_what_was_wrong_with_a_pressure_is_over_once_the_estimator_tells_of_no_membrane() -> None:
    check = PressureCheck(GRIPS)
    check.update(estimate(0.0, 12.0))
    assert "left bubble" in check.reason
    check.update(RelativePoseEstimate(0.1, make_pose()))
    assert check.reason == ""


def test_nobody_asks_where_nothing_was_identified() -> None:
    check = PressureCheck()
    check.update(estimate(0.0, 12.0))
    assert check.reason == ""


def test_the_arm_holds_and_is_not_enabled_again() -> None:
    bench = Bench().enabled()
    bench.controller.supervisor.pressure = PressureCheck(GRIPS)
    bench.press(5.0)
    bench.run(0.2)
    assert bench.state.mode == "approach"
    bench.told = lambda e: replace(e, membrane=estimate(e.stamp, 103.6).membrane)
    bench.run(0.1)
    assert bench.state.mode == "holding"
    assert "it looks like kPa; hPa are needed" in bench.state.reason
    with pytest.raises(ControlRefusedError, match=r"103\.6 hPa"):
        bench.controller.enable(bench.t)
    bench.told = lambda e: e  # the estimator is started again, with a method that tells of no membrane
    bench.run(0.1)
    bench.controller.enable(bench.t)

# SPDX-License-Identifier: Apache-2.0
"""The offset between the clocks of cameras and robot."""

import numpy as np
import pytest

from seed_core.spatial import make_pose, pose_from_rpy, so3_exp
from seed_sysid.fit.clock_offset import ClockError, ClockOffset, ClockWatch


def watch(offset: float, *, travel: float = 1.0, seed: int = 3) -> ClockWatch:
    """A minute of moves with rests between, seen at 250 Hz and 30 Hz; the camera reads y 25 % low and roll biased."""
    rng = np.random.default_rng(seed)
    goals = travel * rng.normal(size=(13, 6)) * [0.05, 0.05, 0.05, 0.003, 0.002, 0.003]
    knots = np.sort(np.concatenate([np.arange(13) * 5.0, np.arange(13) * 5.0 + 3.5]))

    def pose(t: float) -> np.ndarray:
        v = np.array([np.interp(t, knots, np.repeat(g, 2)) for g in goals.T])
        return make_pose(so3_exp(v[:3]), v[3:])

    watch = ClockWatch()
    for t in np.arange(0.0, 60.0, 0.004):
        watch.robot(1e9 + t, pose(t))
    for t in np.arange(0.0, 60.0, 1.0 / 30.0):
        X = pose(t)
        X[1, 3] *= 0.75
        X = X @ pose_from_rpy(0.001 * rng.normal(size=3) + [0.02, 0.0, 0.0], 5e-5 * rng.normal(size=3))
        watch.camera(1e9 + t + offset, X)
    return watch


@pytest.mark.parametrize("offset", [-0.12, 0.0, 0.0137, 0.2])
def test_offset_is_found_within_two_milliseconds_whatever_the_estimates_gain_and_bias(offset: float) -> None:
    found = watch(offset).offset()
    assert found.value == pytest.approx(offset, abs=2e-3)
    assert abs(found.value - offset) < 4.0 * found.std + 2e-4
    assert ("ahead of the robot's" in found.advice) == (offset > 0.0)
    assert ("behind the robot's" in found.advice) == (offset < 0.0)


@pytest.mark.parametrize(
    ("value", "std", "told"),
    [
        (0.0019, 1e-4, ""),
        (-0.0021, 1e-4, "2.1 +- 0.1 ms behind"),
        (0.0079, 0.004, ""),
        (0.0081, 0.004, "8.1 +- 4.0 ms ahead"),
    ],
)
def test_an_offset_is_told_that_two_deviations_and_two_milliseconds_are_not_enough_for(value, std, told: str) -> None:
    advice = ClockOffset(value, std).advice
    assert bool(advice) is bool(told)
    assert told in advice


def test_the_standard_deviation_of_an_offset_is_what_it_is_off_by() -> None:
    """Of 15 runs of half a minute, whose images are off by a tenth of a millimetre."""
    off = []
    for seed in range(15):
        rng, watch = np.random.default_rng(seed), ClockWatch()
        rates, phases = rng.uniform(0.5, 1.5, 3), rng.uniform(0.0, 6.0, 3)
        for t in np.arange(0.0, 30.0, 0.02):
            watch.robot(t, make_pose(None, 0.003 * np.sin(rates * t + phases)))
        for t in np.arange(0.0, 30.0, 1.0 / 15.0):
            place = 0.003 * np.sin(rates * (t - 0.03) + phases) + 1e-4 * rng.standard_normal(3)
            watch.camera(t, make_pose(None, place))
        found = watch.offset()
        off.append((found.value - 0.03) / found.std)
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.6


def test_offset_beyond_reach_is_refused() -> None:
    with pytest.raises(ClockError, match="cannot be compared"):
        watch(0.5).offset()


def test_an_arm_that_stands_still_tells_nothing_of_the_clocks() -> None:
    with pytest.raises(ClockError, match="moved too little"):
        watch(0.02, travel=1e-3).offset()


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("seed", range(4))
def test_estimates_that_do_not_follow_the_tool_tell_nothing_of_the_clocks(noise: float, seed: int) -> None:
    """Constant, or noise about a constant, while the arm moves by millimetres."""
    rng, stuck = np.random.default_rng(seed), ClockWatch()
    for t in np.arange(0.0, 60.0, 0.02):
        stuck.robot(t, make_pose(None, (0.005 * np.sin(0.3 * t), 0.004 * np.sin(0.17 * t), 0.0)))
    for t in np.arange(0.0, 60.0, 1.0 / 15.0):
        stuck.camera(t, make_pose(None, noise * rng.normal(size=3)))
    with pytest.raises(ClockError, match="cannot be compared"):
        stuck.offset()


def test_estimates_that_do_not_move_are_named() -> None:
    stuck = ClockWatch()
    for t in np.arange(0.0, 60.0, 0.02):
        stuck.robot(t, make_pose(None, (0.005 * np.sin(0.3 * t), 0.0, 0.0)))
        stuck.camera(t, np.eye(4))
    with pytest.raises(ClockError, match=r"share 0\.000 mm or mrad of motion \(at least 0\.1\)"):
        stuck.offset()


def test_too_few_estimates_are_refused() -> None:
    few = ClockWatch()
    few.robot(0.0, np.eye(4))
    with pytest.raises(ClockError, match="0 estimates"):
        few.offset()

# SPDX-License-Identifier: Apache-2.0
"""A weight gives the stiffness of the axes that it loads, and says what it cannot give."""

import json

import numpy as np
import pytest
from scipy.stats import norm, t

from seed_bringup import identify
from seed_core.hand import DEFAULT_STIFFNESS
from seed_core.spatial import make_pose
from seed_sim.identification.weight import simulate_weight
from seed_sysid.fit.weight import WeightError, fit_weight

K = DEFAULT_STIFFNESS.vector()


def test_a_centred_weight_gives_the_forces_and_names_the_rest() -> None:
    fit = fit_weight(*simulate_weight(DEFAULT_STIFFNESS, 0.5, np.zeros(3), np.random.default_rng(1)))
    np.testing.assert_allclose(fit.stiffness[3:], K[3:], rtol=0.04)
    assert set(fit.undetermined) == {"roll", "pitch", "yaw"}


def test_a_weight_with_a_lever_gives_roll_and_pitch_too() -> None:
    fit = fit_weight(*simulate_weight(DEFAULT_STIFFNESS, 0.3, np.array([0.0, 0.0, 0.08]), np.random.default_rng(2)))
    np.testing.assert_allclose(fit.stiffness[:2], K[:2], rtol=0.08)
    assert set(fit.undetermined) == {"yaw"}


def test_intervals_of_few_orientations_contain_the_truth_as_often_as_they_say() -> None:
    rng, off = np.random.default_rng(3), []
    for _ in range(12):
        X_TC, wrench = simulate_weight(DEFAULT_STIFFNESS, 0.15, np.array([0.0, 0.0, 0.06]), rng)
        for few in (slice(0, 4), slice(1, 6), slice(4, 10)):
            fit = fit_weight(X_TC[few], wrench[few])
            given = np.isfinite(fit.stiffness)
            off += (np.abs(fit.stiffness - K) / fit.half_width)[given].tolist()
            np.testing.assert_allclose(fit.std[given], fit.half_width[given] / norm.ppf(0.975), rtol=1e-3)
    assert len(off) > 100
    assert np.mean(np.array(off) > 1.0) < 0.08
    assert max(off) < 2.0


def test_orientations_that_lie_on_a_line_by_chance_state_the_noise_of_a_mean_pose_all_the_same() -> None:
    """Of poses without noise: 0.03 mm over the lever of the loads, by Student's t."""
    force = np.array([-2.0, -1.0, 1.0, 2.0])
    X_TC = np.array([make_pose(None, (f / 800.0, 0.0, 0.0)) for f in force])
    fit = fit_weight(X_TC, np.outer(force, np.eye(6)[3]))
    assert fit.stiffness[3] == pytest.approx(800.0)
    half = t.ppf(0.975, 2) * 3e-5 / np.sqrt(force @ force)  # [m/N]
    assert fit.half_width[3] == pytest.approx(800.0**2 * half)


@pytest.mark.parametrize(("count", "carried", "most"), [(10, (), 3), (10, (3,), 3), (10, (0, 1, 4), 3), (4, (2,), 0)])
def test_orientations_in_which_something_else_bore_the_weight_are_left_out(count, carried, most: int) -> None:
    """At most three of ten, and never so many that too few are left."""
    X_TC, wrench = simulate_weight(DEFAULT_STIFFNESS, 0.5, np.zeros(3), np.random.default_rng(1))
    X_TC, wrench = X_TC[:count].copy(), wrench[:count]
    for i in carried:
        X_TC[i, :3, 3] *= 0.4
    fit = fit_weight(X_TC, wrench)
    assert sorted(fit.left_out) == list(carried[:most])
    if most:
        np.testing.assert_allclose(fit.stiffness[3:], K[3:], rtol=0.04)


@pytest.mark.parametrize("carried", [1, 2])
def test_where_nobody_knows_which_of_two_orientations_is_right_an_axis_gets_no_stiffness(carried: int) -> None:
    """Six orientations load each axis both ways: each of the two goes with the line of those that do not load it."""
    X_TC, wrench = simulate_weight(DEFAULT_STIFFNESS, 0.5, np.zeros(3), np.random.default_rng(1))
    X_TC, wrench = X_TC[:6].copy(), wrench[:6]
    X_TC[carried, :3, 3] *= 0.4
    fit = fit_weight(X_TC, wrench)
    assert np.isnan(fit.stiffness[4])
    assert "which of them is right nobody knows" in fit.undetermined["y"]
    np.testing.assert_allclose(fit.stiffness[[3, 5]], K[[3, 5]], rtol=0.04)


def test_no_more_orientations_are_left_out_than_three_of_ten() -> None:
    X_TC, wrench = simulate_weight(DEFAULT_STIFFNESS, 0.5, np.zeros(3), np.random.default_rng(1))
    X_TC[[0, 1, 2, 6], 0, 3] += 0.3, 0.08, 0.03, 0.01
    assert fit_weight(X_TC, wrench).left_out == (0, 1, 2)


def test_weight_from_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert identify.main(["--procedure", "weight", "--seed", "7", "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    assert out["stiffness"]["rotation"] == [None, None, None]
    assert out["max_relative_error"] < 0.05


def test_too_few_orientations_and_a_weight_of_nothing_are_refused() -> None:
    X_TC, wrench = simulate_weight(DEFAULT_STIFFNESS, 0.5, np.zeros(3), np.random.default_rng(3))
    with pytest.raises(WeightError, match="3 orientations are too few: hold the weight in at least 4"):
        fit_weight(X_TC[:3], wrench[:3])
    with pytest.raises(WeightError, match="determines no axis"):
        fit_weight(X_TC, np.zeros_like(wrench))


def test_an_axis_that_stands_still_under_its_load_is_told() -> None:
    X_TC, wrench = simulate_weight(DEFAULT_STIFFNESS, 0.5, np.zeros(3), np.random.default_rng(5))
    X_TC[:, :3, :3], X_TC[:, 1, 3] = np.eye(3), 0.0  # as an estimator that does not see y tells
    fit = fit_weight(X_TC, wrench)
    assert "N only: too little for the noise of the poses" in fit.undetermined["y"]
    assert np.isfinite(fit.stiffness[[3, 5]]).all()


def test_a_light_weight_is_told_to_be_too_little_for_the_noise() -> None:
    X_TC, wrench = simulate_weight(DEFAULT_STIFFNESS, 0.018, np.zeros(3), np.random.default_rng(4))
    fit = fit_weight(X_TC, wrench)
    assert "N only: too little for the noise of the poses" in fit.undetermined["y"]
    assert "puts no torque on it" in fit.undetermined["yaw"]
    assert np.isnan(fit.stiffness[[2, 4]]).all()


def test_lists_of_poses_and_wrenches_are_taken_as_arrays() -> None:
    X_TC, wrench = simulate_weight(DEFAULT_STIFFNESS, 0.5, np.zeros(3), np.random.default_rng(1))
    fit = fit_weight(list(X_TC), wrench.tolist())
    np.testing.assert_array_equal(fit.stiffness, fit_weight(X_TC, wrench).stiffness)

# SPDX-License-Identifier: Apache-2.0
"""The identification fit on synthetic wrenches: the map, the load model, and what the fit says of its own result."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, t
from synthetic_problem import GRIPS, NOISE, POSES, TRUTH, made, random_poses

from seed_core.bushing import Bushing
from seed_core.hand import DEFAULT_STIFFNESS
from seed_core.spatial import make_pose, so3_exp
from seed_sysid.fit.identification_fit import Solution, fit_stiffness
from seed_sysid.fit.load_model import LoadModel, Problem, Unknowns, left_jacobian
from seed_sysid.parameters import ExcitationParameters, FitParameters, LimitParameters
from seed_sysid.run.excitation import design
from seed_sysid.stiffness_map import stiffness_map


def assert_found(solution: Solution, truth: Unknowns, rtol: float = 1e-9) -> None:
    for name, got, true in zip(Unknowns._fields, solution.value, truth, strict=True):
        np.testing.assert_allclose(got, true, rtol=rtol, atol=rtol, err_msg=name)


@pytest.mark.parametrize("model", ["midpoint", "plain"])
def test_the_map_over_many_poses_is_the_bushing(model: str) -> None:
    X = np.concatenate([random_poses(np.random.default_rng(1), 30), [np.eye(4)], [make_pose(so3_exp([1e-8, 0, 0]))]])
    m = stiffness_map(X, model)  # type: ignore[arg-type]
    bushing = Bushing(DEFAULT_STIFFNESS, model)  # type: ignore[arg-type]
    got = np.einsum("nij,nj->ni", m.B, DEFAULT_STIFFNESS.vector() * m.xi)
    np.testing.assert_allclose(got, [bushing.wrench(x).vector() for x in X], atol=1e-12)  # [N m, N] rounding


def test_the_load_model_predicts_what_the_bushing_and_a_moved_sensor_measure() -> None:
    problem, truth = made(friction=1.0)
    model = LoadModel(problem, np.ones(len(problem.X_TC), dtype=bool))
    np.testing.assert_allclose(model.predict(truth), problem.wrench, atol=1e-12)  # [N m, N] rounding


@pytest.mark.parametrize("turn", [0.0, 1e-7, 0.05, 1.0])
def test_the_jacobian_is_the_derivative_of_the_prediction(turn: float) -> None:
    problem, truth = made(friction=1.0)
    direction = np.array([0.6, -0.7, 0.39])
    truth = truth._replace(offset=np.concatenate([turn * direction / np.linalg.norm(direction), [0.02, -0.01, 0.03]]))
    model = LoadModel(problem, np.ones(len(problem.X_TC), dtype=bool))
    vector, step = truth.vector(), 1e-5

    def predicted(v: np.ndarray) -> np.ndarray:
        return model.predict(Unknowns.from_vector(v)).ravel()

    J = model.jacobian(truth)
    assert J.shape == (problem.wrench.size, len(vector))
    for i, column in enumerate(J.T):
        d = step * np.eye(len(vector))[i]
        numeric = (predicted(vector + d) - predicted(vector - d)) / (2 * step)
        np.testing.assert_allclose(column, numeric, atol=1e-7 * max(1.0, np.abs(numeric).max()), err_msg=str(i))


@pytest.mark.parametrize("angle", [1e-7, 0.9e-4, 1.1e-4, 0.3, 2.0])
def test_the_left_jacobian_moves_a_rotation_vector(angle: float) -> None:
    v, d = angle * np.array([0.36, -0.48, 0.8]), np.array([0.3, 0.5, -0.2])
    for step in (d * 1e-6, -d * 1e-6):
        np.testing.assert_allclose(
            so3_exp(left_jacobian(v) @ step) @ so3_exp(v), so3_exp(v + step), atol=1e-12
        )  # second order


@pytest.mark.parametrize("friction", [0.0, 1.0])
def test_without_noise_the_fit_is_exact(friction: float) -> None:
    problem, truth = made(friction=friction)
    solution = fit_stiffness(problem)
    assert_found(solution, truth)
    np.testing.assert_allclose(solution.residuals, 0.0, atol=1e-9)  # [N m, N]
    np.testing.assert_allclose(solution.r_squared, 1.0, atol=1e-12)
    assert solution.inlier.all()
    assert solution.likely.all()


def test_offset_and_drift_stay_zero_where_they_are_not_asked_for() -> None:
    problem, _ = made()
    solution = fit_stiffness(replace(problem, parameters=FitParameters(offset=False, drift=False)))
    for part in (solution.value.offset, solution.std.offset, solution.value.drift, solution.std.drift):
        np.testing.assert_array_equal(part, 0.0)
    assert (solution.std.stiffness > 0.0).all()
    assert (solution.std.bias > 0.0).all()
    assert solution.noise.max() > 0.05  # [N] of the drift that is not explained


def test_friction_counts_on_hysteretic_axes_alone() -> None:
    problem, truth = made(friction=1.0)
    solution = fit_stiffness(replace(problem, hysteretic=(4,)))
    np.testing.assert_array_equal(solution.value.friction[[0, 1, 2, 3, 5]], 0.0)
    np.testing.assert_array_equal(solution.std.friction[[0, 1, 2, 3, 5]], 0.0)
    np.testing.assert_allclose(solution.value.friction[4], truth.friction[4], rtol=0.02)


def test_noise_is_told_for_each_channel_and_group() -> None:
    problem, _ = made(noise=1.0, poses=600, combined=3.0)
    solution = fit_stiffness(problem)
    for group, factor in ((0, 1.0), (1, 3.0)):
        got = solution.sample_noise[problem.group == group]
        assert (got == got[0]).all()
        np.testing.assert_allclose(got[0], factor * NOISE, rtol=0.1)  # 600 samples: 3 % standard deviation
    degrees = len(problem.X_TC) - (12 * GRIPS + 12) / 6.0
    expected = np.sqrt((solution.residuals[solution.inlier] ** 2).sum(axis=0) / degrees)
    np.testing.assert_allclose(solution.noise, expected, rtol=2e-3)  # but for single outliers


def test_the_noise_of_one_grip_is_neither_understated_nor_its_intervals_too_narrow() -> None:
    """The torques of the 20 combinations tell the offset of the sensor's frame: it takes 3 of their 20 degrees."""
    targets = design(ExcitationParameters(), LimitParameters())
    X_TC, n = np.array([target.X_TC for target in targets]), len(targets)
    group = np.array([int(target.kind in ("combination", "work")) for target in targets])
    still = np.zeros((n, 6)), np.zeros(n, int), np.linspace(0.0, 600.0, n), group, X_TC, np.arange(n), np.zeros((n, 6))
    problem = Problem(X_TC, *still)
    truth = TRUTH._replace(stiffness=TRUTH.stiffness[:1], bias=TRUTH.bias[:1])
    wrench = LoadModel(problem, np.ones(n, bool)).predict(truth)
    rng, power, covered = np.random.default_rng(3), [], []
    for _ in range(200):
        s = fit_stiffness(replace(problem, wrench=wrench + NOISE * rng.normal(size=(n, 6))))
        power.append((s.sample_noise[group == 1][0] / NOISE)[:3] ** 2)
        covered.append(np.abs(s.value.stiffness - truth.stiffness) <= s.half_width)
    assert np.mean(power) == pytest.approx(1.0, abs=0.05)  # three deviations of 600 of 17 degrees: 0.04
    assert np.mean(covered) == pytest.approx(0.95, abs=0.013)  # two deviations of 1200


def test_a_group_of_few_samples_shares_the_noise_of_all() -> None:
    problem, _ = made(noise=1.0)
    for few, shared in ((11, True), (12, False)):
        solution = fit_stiffness(replace(problem, group=(np.arange(len(problem.X_TC)) < few).astype(int)))
        assert solution.inlier.all()
        assert np.allclose(solution.sample_noise[0], solution.noise) == shared


def test_noiseless_data_are_given_the_noise_of_rounding() -> None:
    solution = fit_stiffness(made()[0])
    np.testing.assert_array_equal(solution.noise, [1e-5] * 3 + [1e-4] * 3)  # [N m, N]
    np.testing.assert_array_equal(solution.sample_noise, np.tile(solution.noise, (GRIPS * POSES, 1)))


def test_standard_deviations_and_intervals_are_those_of_the_weighted_least_squares() -> None:
    problem, _ = made(noise=1.0, friction=1.0)
    solution = fit_stiffness(problem)
    model = LoadModel(problem, np.ones(len(problem.X_TC), dtype=bool))
    weight = solution.inlier[:, None] / solution.sample_noise
    J = weight.ravel()[:, None] * model.jacobian(solution.value)
    J = J[:, np.abs(solution.std.vector()) > 0.0]
    assert J.shape[1] == 12 * GRIPS + 14
    covariance = np.linalg.inv(J.T @ J)
    std = solution.std.vector()
    np.testing.assert_allclose(std[std > 0.0], np.sqrt(np.diag(covariance)), rtol=1e-6)
    np.testing.assert_allclose(solution.condition, np.linalg.cond(J / np.linalg.norm(J, axis=0)), rtol=1e-6)
    Q, _ = np.linalg.qr(J)
    leverage = (Q**2).sum(axis=1).reshape(-1, 6)
    assert leverage.sum() == pytest.approx(J.shape[1])
    degrees = np.array([(solution.inlier & (problem.group == g)).sum() - leverage[problem.group == g].sum(axis=0)
                        for g in (0, 1)])  # fmt: skip
    half = t.ppf(0.975, degrees.min()) * solution.std.stiffness
    np.testing.assert_allclose(solution.half_width, half, rtol=1e-9)


def test_forces_of_the_plain_model_are_ordinary_least_squares() -> None:
    """There every force channel stands alone and its weight cancels: k x + bias + drift s, worked by NumPy's lstsq."""
    problem, _ = made(noise=1.0)
    parameters = FitParameters(model="plain", offset=False)
    solution = fit_stiffness(replace(problem, group=np.zeros_like(problem.group), parameters=parameters))
    assert solution.inlier.all()
    own, s = np.eye(GRIPS)[problem.grip], (problem.time - 1300.0) / 600.0
    for axis in (3, 4, 5):
        A = np.column_stack([own * problem.X_TC[:, axis - 3, 3, None], own, s])
        found = np.linalg.lstsq(A, problem.wrench[:, axis], rcond=None)[0]
        np.testing.assert_allclose(solution.value.stiffness[:, axis], found[:2], rtol=1e-9)
        np.testing.assert_allclose(solution.value.bias[:, axis], found[2:4], rtol=1e-8)
        np.testing.assert_allclose(solution.value.drift[axis], found[4], rtol=1e-8)


def test_r_squared_is_the_explained_share_of_the_inliers_variance() -> None:
    problem, _ = made(noise=20.0)
    problem.wrench[3] += [0.0, 0.0, 0.0, 300.0, 0.0, 0.0]
    solution = fit_stiffness(problem)
    assert not solution.inlier[3]
    r, w = solution.residuals[solution.inlier], problem.wrench[solution.inlier]
    np.testing.assert_allclose(solution.r_squared, 1.0 - (r**2).mean(axis=0) / w.var(axis=0), rtol=1e-9)


def test_outliers_are_named_and_do_no_harm() -> None:
    problem, truth = made(noise=1.0)
    spoiled = [5, 17, 40, 41, 66]
    rng = np.random.default_rng(7)
    problem.wrench[spoiled] += rng.choice((-1.0, 1.0), (5, 6)) * [0.3, 0.3, 0.3, 5.0, 5.0, 5.0]
    solution = fit_stiffness(problem)
    assert np.flatnonzero(~solution.inlier).tolist() == spoiled
    np.testing.assert_array_equal(solution.likely, solution.inlier)
    assert (np.abs(solution.value.stiffness - truth.stiffness) < 4.0 * solution.std.stiffness).all()
    error = (solution.residuals[spoiled] + problem.wrench[spoiled]) - made()[0].wrench[spoiled]
    assert (np.abs(error) < 4.0 * solution.noise).all()  # they are predicted all the same


def test_a_fifth_of_wild_samples_neither_pulls_the_fit_nor_hides_behind_its_own_noise() -> None:
    problem, truth = made(noise=1.0)
    rng = np.random.default_rng(8)
    wild = np.sort(rng.choice(len(problem.X_TC), len(problem.X_TC) // 5, replace=False))
    problem.wrench[wild] += 100.0 * NOISE * rng.choice((-1.0, 1.0), (len(wild), 6))
    solution = fit_stiffness(problem)
    np.testing.assert_array_equal(np.flatnonzero(~solution.inlier), wild)
    assert (np.abs(solution.value.stiffness - truth.stiffness) < 4.0 * solution.std.stiffness).all()


def test_a_sample_is_likely_by_its_squared_mahalanobis_distance() -> None:
    problem, _ = made(noise=1.0, poses=300)
    solution = fit_stiffness(replace(problem, parameters=FitParameters(outlier=0.05)))
    distance = ((solution.residuals / solution.sample_noise) ** 2).sum(axis=1)
    np.testing.assert_array_equal(solution.likely, distance < chi2.isf(0.05, 6))
    assert 0.02 < np.mean(~solution.likely) < 0.12


@pytest.mark.parametrize(("factor", "kept"), [(0.9, True), (1.6, False)])
def test_a_sample_is_an_outlier_beyond_the_probability_asked_for(factor: float, kept: bool) -> None:
    """One channel off by this much of the bound, sqrt(chi2), in standard deviations of a fit without it."""
    problem, _ = made(noise=1.0, poses=300)
    problem = replace(problem, parameters=FitParameters(outlier=1e-9))
    bound = float(np.sqrt(chi2.isf(1e-9, 6)))
    clean = fit_stiffness(problem)
    sample = int(np.argmin(((clean.residuals / clean.sample_noise) ** 2).sum(axis=1)))
    problem.wrench[sample, 3] += factor * bound * clean.sample_noise[sample, 3]
    solution = fit_stiffness(problem)
    assert solution.inlier[sample] == kept
    assert solution.likely[sample] == kept


def test_poses_left_out_of_the_fit_are_predicted_and_change_nothing() -> None:
    problem, truth = made()
    train = np.arange(len(problem.X_TC)) % 5 != 0
    problem.wrench[~train] += 1000.0
    solution = fit_stiffness(problem, train)
    time = problem.time[train]
    shift, span = time.mean() - 1300.0, float(np.ptp(time))
    moved = truth._replace(bias=truth.bias + shift / 600.0 * truth.drift, drift=truth.drift * span / 600.0)
    assert_found(solution, moved)
    np.testing.assert_allclose(solution.residuals[train], 0.0, atol=1e-9)
    np.testing.assert_allclose(solution.residuals[~train], -1000.0, atol=1e-9)
    np.testing.assert_array_equal(solution.inlier, train)
    np.testing.assert_array_equal(solution.likely, train)


@pytest.mark.filterwarnings("ignore:overflow")
def test_samples_taken_at_one_time_have_no_drift() -> None:
    problem, truth = made()
    still = replace(problem, wrench=problem.wrench - np.outer((problem.time - 1300.0) / 600.0, truth.drift))
    solution = fit_stiffness(replace(still, time=np.full(len(problem.time), 5.0)))
    assert_found(solution, truth._replace(drift=np.zeros(6)), rtol=1e-6)
    assert np.isinf(solution.std.drift).all()


def test_unknowns_come_back_from_their_vector() -> None:
    vector = np.arange(12 * GRIPS + 18.0)
    unknowns = Unknowns.from_vector(vector)
    np.testing.assert_array_equal(unknowns.vector(), vector)
    np.testing.assert_array_equal(unknowns.stiffness, np.arange(12.0).reshape(2, 6))
    np.testing.assert_array_equal(unknowns.bias, np.arange(18.0, 30.0).reshape(2, 6))
    np.testing.assert_array_equal(unknowns.friction, np.arange(36.0, 42.0))


@pytest.mark.parametrize("confidence", [0.5, 0.95])
def test_intervals_contain_the_truth_as_often_as_they_say(confidence: float) -> None:
    """12 stiffnesses of 20 seeds; four standard deviations of a share of 240."""
    covered = []
    for seed in range(20):
        problem, truth = made(seed=100 + seed, noise=1.0, poses=100)
        s = fit_stiffness(replace(problem, parameters=FitParameters(confidence=confidence)))
        covered.append(np.abs(s.value.stiffness - truth.stiffness) <= s.half_width)
    assert abs(np.mean(covered) - confidence) < 4.0 * np.sqrt(confidence * (1.0 - confidence) / 240.0)

# SPDX-License-Identifier: Apache-2.0
"""The wrench of the grasp's map, and how well it is known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.bushing import MODELS, Bushing, Stiffness
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import inverse_pose, make_pose, so3_exp
from seed_core.wrench_model import BushingModel, MapUncertainty

STIFFNESS = Stiffness((4.0, 3.0, 4.0), (800.0, 1200.0, 900.0))
CERTAIN = MapUncertainty(residual=0.0, coupling=0.0, lever=0.0, unidentified=0.0)
DEVIATIONS = np.array((0.01, 0.01, 0.01, 2e-4, 2e-4, 2e-4))  # [rad], [m]


def displaced(rng: np.random.Generator, angle: float) -> np.ndarray:
    return make_pose(so3_exp(angle * rng.uniform(-1.0, 1.0, 3)), 0.01 * rng.uniform(-1.0, 1.0, 3))


@pytest.mark.parametrize("model", MODELS)
def test_covariance_of_the_pose_goes_through_the_map(model: str) -> None:
    """Against a thousand wrenches of poses drawn with that very covariance."""
    rng = np.random.default_rng(4)
    bushing = Bushing(STIFFNESS, model)
    for _ in range(3):
        X_CT = displaced(rng, 0.1)
        M = np.diag(DEVIATIONS) @ (np.eye(6) + 0.4 * rng.uniform(-1.0, 1.0, (6, 6)))
        C = M @ M.T
        told = BushingModel(bushing, CERTAIN).spring(RelativePoseEstimate(0.0, X_CT, C))
        draws = rng.multivariate_normal(np.zeros(6), C, 1000)
        poses = (make_pose(so3_exp(d[:3]) @ X_CT[:3, :3], X_CT[:3, 3] + d[3:]) for d in draws)
        wrenches = np.array([bushing.wrench(inverse_pose(X)).vector() for X in poses])
        assert_allclose(told.wrench.vector(), bushing.wrench(inverse_pose(X_CT)).vector(), atol=0.0)
        assert_allclose(np.sqrt(told.covariance.diagonal()), wrenches.std(axis=0), rtol=0.25)
        whitened = np.linalg.solve(np.linalg.cholesky(told.covariance), (wrenches - wrenches.mean(axis=0)).T)
        assert 4.0 < float((whitened**2).sum(axis=0).mean()) < 9.0  # six components, each of variance one


@pytest.mark.parametrize("model", MODELS)
def test_each_component_of_the_pose_goes_through_the_maps_derivative(model: str) -> None:
    rng, step = np.random.default_rng(5), 1e-6  # [rad], [m]
    bushing = Bushing(STIFFNESS, model)
    for _ in range(3):
        X_CT = displaced(rng, 0.1)
        rest = bushing.wrench(inverse_pose(X_CT))
        for d in step * np.eye(6):
            X = make_pose(so3_exp(d[:3]) @ X_CT[:3, :3], X_CT[:3, 3] + d[3:])
            change = np.abs(bushing.wrench(inverse_pose(X)).vector() - rest.vector())
            by_pose, _ = BushingModel(bushing).covariances(inverse_pose(X_CT), rest, np.outer(d, d))
            told = np.sqrt(by_pose.diagonal())
            assert_allclose(told[:3], change[:3], atol=0.1 * change[:3].max() + 1e-12)
            assert_allclose(told[3:], change[3:], atol=0.02 * change[3:].max() + 1e-12)


def test_force_is_as_uncertain_as_its_stiffness() -> None:
    """10 N through 4 % of stiffness, 3 % of residual and no noise are 0.5 N."""
    u = MapUncertainty(residual=0.03, coupling=0.0, lever=0.0)
    model = BushingModel(Bushing(STIFFNESS), u, np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.04)))
    exact = 1e-12 * np.eye(6)
    told = model.spring(RelativePoseEstimate(0.0, make_pose(None, (0.0, 0.0, -10.0 / 900.0)), exact))
    assert_allclose(told.wrench.force, (0.0, 0.0, 10.0), atol=1e-12)
    assert_allclose(np.sqrt(told.covariance[5, 5]), 0.5, rtol=1e-3)


def test_an_old_identification_is_known_less() -> None:
    estimate = RelativePoseEstimate(0.0, make_pose(None, (0.0, 0.0, -0.01)), 1e-12 * np.eye(6))
    model = BushingModel(Bushing(STIFFNESS), CERTAIN)
    size = []
    for age in (-1.0, 0.0, 4.0, 16.0, 1e5):  # [days]; the clock may be behind the file's date
        model.identified(np.zeros(6), age)
        size.append(float(np.sqrt(model.spring(estimate).covariance[5, 5])))
    assert_allclose(
        size, (9e-4, 9e-4, 0.18, 0.36, 1.8), rtol=0.01
    )  # of 9 N: 1 % times the root of the days, 20 % at most


def test_an_axis_that_nobody_sees_is_told_with_a_wide_covariance() -> None:
    seen = (True, True, True, False, True, True)
    X_CT = make_pose(so3_exp((0.1, 0.0, 0.0)), np.zeros(3))
    told = BushingModel(Bushing(STIFFNESS), CERTAIN).spring(
        RelativePoseEstimate(0.0, X_CT, np.diag(DEVIATIONS**2), observed=seen)
    )
    assert_allclose(told.wrench.torque, 0.0, atol=1e-15)
    assert np.sqrt(told.covariance[0, 0]) > 4.0 * 0.1  # wider than what was hidden
    assert np.isfinite(told.covariance).all()

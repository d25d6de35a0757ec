# SPDX-License-Identifier: Apache-2.0
"""The wrench of a spring that stiffens and has hysteresis."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.bushing import Bushing, Stiffness
from seed_core.config import ConfigError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hysteretic.spring import HystereticSpring, HystereticStiffness
from seed_core.spatial import inverse_pose, make_pose, pose_from_rpy, so3_exp

K = np.array((4.0, 3.0, 4.0, 800.0, 1200.0, 800.0))
FULL = np.array((0.2,) * 3 + (0.01,) * 3)


def spring_of(rise: float = 0.0, friction: float = 0.0, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)):
    """rise, friction: shares of the load at FULL."""
    yields = np.outer((0.1, 0.3), FULL)
    return HystereticStiffness(
        stiffness=K,
        rise=rise * K / FULL,
        yields=yields,
        friction=0.5 * friction * np.vstack([K * FULL] * 2),
        covariance=np.zeros((6, 4, 4)),
        residual=np.zeros(6),
        largest=FULL,
        centre=np.array(centre),
    )


def seen(X_TC: np.ndarray, std: float = 0.0) -> RelativePoseEstimate:
    return RelativePoseEstimate(0.0, inverse_pose(X_TC), covariance=np.eye(6) * max(std, 1e-12) ** 2)


def test_without_rise_friction_and_centre_it_is_the_bushing() -> None:
    rng, model = np.random.default_rng(2), HystereticSpring(spring_of())
    for _ in range(10):
        X = make_pose(so3_exp(rng.normal(0.0, 0.1, 3)), rng.normal(0.0, 0.004, 3))
        expected = Bushing(Stiffness.from_vector(K)).wrench(X).vector()
        assert_allclose(model.spring(seen(X)).wrench.vector(), expected, atol=1e-9)


def test_load_at_full_deflection_has_rise_and_friction_and_the_way_back_less() -> None:
    model = HystereticSpring(spring_of(rise=0.2, friction=0.06))

    def force(z: float) -> float:
        return float(model.spring(seen(make_pose(None, (0.0, 0.0, z)))).wrench.force[2])

    assert force(0.005) == pytest.approx(4.0 * 1.1 + 0.06 * 8.0)  # both elements slide
    assert force(0.01) == pytest.approx(8.0 * 1.2 + 0.06 * 8.0)
    assert force(0.005) == pytest.approx(4.0 * 1.1 - 0.06 * 8.0 * (0.5 + 0.5 * (0.005 / 0.003 - 1.0)), abs=0.17)
    assert force(0.0) == pytest.approx(-0.06 * 8.0)
    model.reset()
    assert force(0.0) == 0.0


def test_a_force_beside_the_centre_turns() -> None:
    model = HystereticSpring(spring_of(centre=(0.0, 0.002, 0.0)))
    wrench = model.spring(seen(make_pose(None, (0.0, 0.0, 0.01)))).wrench
    assert_allclose(wrench.force, (0.0, 0.0, 8.0), atol=1e-9)
    assert_allclose(wrench.torque, (0.016, 0.0, 0.0), atol=1e-9)


def test_its_covariance_comes_from_the_pose_from_what_is_identified_and_from_what_is_left() -> None:
    X = make_pose(None, (0.0, 0.0, 0.01))
    of_pose = HystereticSpring(spring_of()).spring(seen(X, 1e-4)).covariance
    assert np.sqrt(of_pose[5, 5]) == pytest.approx(800.0 * 1e-4, rel=0.01)
    uncertain = np.zeros((6, 4, 4))
    uncertain[5, 0, 0] = 40.0**2  # [N/m]
    known = replace(spring_of(), covariance=uncertain, residual=np.array((0.0,) * 5 + (0.3,)))
    total = HystereticSpring(known).spring(seen(X)).covariance
    assert np.sqrt(total[5, 5]) == pytest.approx(np.hypot(40.0 * 0.01, 0.3), rel=1e-3)


@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (0.0, 0.0, 0.03), (0.02, -0.01, -0.05)])
def test_its_covariance_is_the_spread_over_uncertain_poses_wherever_the_centre_is(
    centre: tuple[float, float, float],
) -> None:
    rng, model = np.random.default_rng(4), HystereticSpring(spring_of(centre=centre))
    X_CT = inverse_pose(pose_from_rpy((0.02, 0.05, 0.01), (0.001, 0.0, 0.004)))
    root = np.diag([np.deg2rad(0.5)] * 3 + [2e-5] * 3)
    root[3, 1] = 1e-4  # [m] turn and shift go together
    errors = rng.normal(size=(2000, 6)) @ root.T
    wrenches = []
    for e in errors:
        X = make_pose(so3_exp(e[:3]) @ X_CT[:3, :3], X_CT[:3, 3] + e[3:])
        model.reset()
        wrenches.append(model.spring(RelativePoseEstimate(0.0, X, covariance=root @ root.T)).wrench.vector())
    model.reset()
    stated = model.spring(RelativePoseEstimate(0.0, X_CT, covariance=root @ root.T)).covariance
    assert_allclose(np.sqrt(np.diag(stated)), np.std(wrenches, axis=0), rtol=0.1)
    correlation = np.corrcoef(np.array(wrenches).T)
    deviations = np.sqrt(np.diag(stated))
    assert_allclose(stated / np.outer(deviations, deviations), correlation, atol=0.1)


def test_what_was_not_identified_is_named_with_value_and_bound() -> None:
    model = HystereticSpring(spring_of())
    assert not model.spring(seen(make_pose(None, (0.0, 0.0, 0.012)))).reason
    reason = model.spring(seen(make_pose(None, (0.0, 0.0, 0.018)))).reason
    assert "z is 18.0 mm, identified up to 10.0 mm" in reason
    assert "roll is 20.0 deg" in model.spring(seen(pose_from_rpy((np.deg2rad(20.0), 0.0, 0.0), (0.0, 0.0, 0.0)))).reason


def test_values_that_cannot_be_are_refused() -> None:
    for broken, words in (
        ({"stiffness": -K}, "stiffness.*must be > 0"),
        ({"friction": -spring_of(friction=0.1).friction}, "friction.*must be >= 0"),
        ({"residual": np.full(6, np.nan)}, "residual must be"),
        ({"centre": np.zeros(2)}, "centre must be"),
    ):
        with pytest.raises(ConfigError, match=words):
            replace(spring_of(), **broken)

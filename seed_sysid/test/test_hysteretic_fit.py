# SPDX-License-Identifier: Apache-2.0
"""The fit of stiffening and hysteresis, on springs of another kind than it assumes."""

import numpy as np
import pytest

from seed_core.estimate import RelativePoseEstimate
from seed_core.hysteretic.spring import HystereticSpring
from seed_core.spatial import inverse_pose, make_pose
from seed_sim.scenario import load_scenario
from seed_sim.world.parameters import SpringWorld, World
from seed_sim.world.procedures.identify import identify
from seed_sim.world.spring import WorldSpring
from seed_sysid.fit.hysteretic_fit import HystereticFit, fit_hysteretic

NOMINAL = load_scenario("nominal")
FULL = SpringWorld(
    scale=(1.03, 0.97, 1.0, 1.04, 0.96, 1.02), stiffening=0.15, hysteresis=0.06, centre_mm=(2.0, -1.5, 2.5)
)


def fitted(world: SpringWorld, seed: int) -> HystereticFit:
    return fit_hysteretic(identify(NOMINAL, World(spring=world), seed).analysis)


@pytest.fixture(scope="module")
def full() -> HystereticFit:
    return fitted(FULL, 1)


def test_a_press_that_the_identification_did_not_make_is_predicted_along_and_back(full: HystereticFit) -> None:
    """Elements of the world yield elsewhere than those of the fit; the load all the same is right to 0.2 N of 10."""
    true, model = WorldSpring(NOMINAL.grasp.stiffness, FULL), HystereticSpring(full.identified)
    way = [0.0, -0.0024, *np.linspace(-0.0024, 0.0105, 30), *np.linspace(0.0105, 0.004, 10)]
    for z in way:
        X_TC = make_pose(None, (0.0, 0.0, z))
        expected = true.static(X_TC).force[2]
        found = model.spring(RelativePoseEstimate(0.0, inverse_pose(X_TC), covariance=1e-12 * np.eye(6)))
        assert found.wrench.force[2] == pytest.approx(expected, abs=0.3)
        assert np.sqrt(found.covariance[5, 5]) < 0.25


def test_stiffening_friction_and_centre_are_told_apart(full: HystereticFit) -> None:
    s, share = full.identified, 0.15 / 0.012  # of the world's stiffness, per metre
    assert s.rise[5] / s.stiffness[5] == pytest.approx(share, rel=0.5)
    assert s.friction[:, 5].sum() == pytest.approx(0.06 * 800.0 * 1.02 * 0.012, rel=0.3)
    np.testing.assert_allclose(1e3 * s.centre, FULL.centre_mm, atol=1.0)
    assert full.shown["z"] == ("rise", "friction")


def test_it_leaves_less_than_the_linear_fit_with_friction(full: HystereticFit) -> None:
    assert (full.left < 0.7 * full.left_linear).all()


def test_its_own_poses_lie_within_its_range_wherever_the_centre_is() -> None:
    a = identify(NOMINAL, World(spring=SpringWorld(centre_mm=(0.0, 0.0, 30.0))), 3).analysis
    model = HystereticSpring(fit_hysteretic(a).identified)
    assert 1e3 * model.identified.centre[2] == pytest.approx(30.0, abs=3.0)
    mine = a.problem.X_TC[a.problem.grip == a.nominal]
    reasons = [model.spring(RelativePoseEstimate(0.0, inverse_pose(X))).reason for X in mine]
    assert not any(reasons)


def test_a_linear_spring_shows_neither_rise_nor_friction() -> None:
    fit = fitted(SpringWorld(), 2)
    assert sum(len(names) for names in fit.shown.values()) <= 1  # of twelve, at three deviations
    error = fit.identified.stiffness - NOMINAL.grasp.stiffness.vector()
    assert (np.abs(error) < 3.5 * fit.std[:, 0]).all()
    assert (fit.std[:, 0] < 0.03 * fit.identified.stiffness).all()

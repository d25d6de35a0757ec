# SPDX-License-Identifier: Apache-2.0
"""Payload identification from hanging samples."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_control.payload.identify import PayloadError, PayloadFit
from seed_control.payload.motion import LIFT, payload_task
from seed_control.state import ControllerState
from seed_control.tasks import TaskPlayer
from seed_control.wrench.estimate import WrenchEstimator
from seed_core.bushing import Bushing
from seed_core.config import ConfigError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Hand, Tool, weight_about_T
from seed_core.spatial import Wrench, inverse_pose, make_pose, pose_from_rpy, rotation_from_rpy

RNG = np.random.default_rng(9)


def hanging(R_WT: np.ndarray, mass: float, com: np.ndarray, bushing: Bushing) -> tuple[np.ndarray, np.ndarray]:
    """X_WT and X_CT of a tool at rest."""
    X_TC = bushing.pose(Wrench.zero().minus(weight_about_T(mass, com, R_WT)))  # the spring alone carries the weight
    return make_pose(R_WT), inverse_pose(X_TC)


ORIENTATIONS = [(np.pi, 0.0, 0.0), (np.pi - 0.5, 0.0, 0.0), (np.pi, 0.5, 0.0), (np.pi + 0.5, -0.4, 0.3)]


def test_weighing_finds_mass_and_centre_of_mass_through_the_noise() -> None:
    bushing, com = Bushing(DEFAULT_STIFFNESS), np.array((0.005, -0.01, 0.06))
    weighing = PayloadFit(bushing)
    for rpy in ORIENTATIONS:
        X_WT, X_CT = hanging(rotation_from_rpy(rpy), 0.2, com, bushing)
        for _ in range(45):
            noise = pose_from_rpy(np.deg2rad(0.5) * RNG.normal(size=3), 3e-4 * RNG.normal(size=3))
            weighing.add(X_WT, X_CT @ noise)
    result = weighing.result(known_mass=0.2)
    assert abs(result.mass - 0.2) < 4 * result.mass_std < 0.02
    assert np.all(np.abs(result.center_of_mass - com) < 4 * result.center_of_mass_std + 1e-4)
    assert np.all(result.center_of_mass_std < 0.01)
    assert result.stiffness_ratio is not None
    assert_allclose(result.stiffness_ratio, 1.0, atol=0.03)


def test_known_mass_shows_a_wrong_stiffness() -> None:
    bushing, com = Bushing(DEFAULT_STIFFNESS), np.array((0.0, 0.0, 0.06))
    weighing = PayloadFit(Bushing(DEFAULT_STIFFNESS.scaled(1.3)))
    for rpy in ORIENTATIONS:
        for _ in range(5):
            weighing.add(*hanging(rotation_from_rpy(rpy), 0.2, com, bushing))
    ratio = weighing.result(known_mass=0.2).stiffness_ratio
    assert ratio is not None
    assert_allclose(ratio, 1.0 / 1.3, atol=1e-3)


def test_one_orientation_leaves_the_centre_of_mass_open_along_gravity() -> None:
    bushing, com = Bushing(DEFAULT_STIFFNESS), np.array((0.005, -0.01, 0.06))
    weighing = PayloadFit(bushing)
    for _ in range(20):
        weighing.add(*hanging(rotation_from_rpy((np.pi, 0.0, 0.0)), 0.2, com, bushing))
    result = weighing.result()
    assert_allclose(result.center_of_mass[:2], com[:2], atol=1e-4)
    assert np.isinf(result.center_of_mass_std[2])


def test_weighing_nothing_or_too_little_is_refused() -> None:
    weighing = PayloadFit(Bushing(DEFAULT_STIFFNESS))
    with pytest.raises(PayloadError, match=r"0 samples are too few"):
        weighing.result()
    for _ in range(50):
        weighing.add(np.eye(4), make_pose(p=1e-4 * RNG.normal(size=3)))
    with pytest.raises(PayloadError, match=r"not distinguishable from nothing"):
        weighing.result()


def test_an_arm_on_a_wall_weighs_the_same_and_tells_the_same_wrench() -> None:
    """All that is turned with the base: the force in it turns along, and the weight stays where gravity has it."""
    R = rotation_from_rpy((0.4, -1.2, 2.0))
    turned, up = make_pose(R), tuple((R @ (0.0, 0.0, 1.0)).tolist())
    tool, bushing = Tool(), Bushing(DEFAULT_STIFFNESS)
    on_stand = WrenchEstimator(tool, bushing, True, 1e-4)
    on_wall = WrenchEstimator(tool, bushing, True, 1e-4, up=up)
    stand, wall = PayloadFit(bushing), PayloadFit(bushing, up)
    rng = np.random.default_rng(4)
    for _ in range(20):
        X_WT = make_pose(rotation_from_rpy(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-0.5, 0.5, 3))
        X_CT = hanging(X_WT[:3, :3], tool.mass, np.array(tool.center_of_mass), bushing)[1]
        estimate, X_WC = RelativePoseEstimate(0.0, X_CT), X_WT @ inverse_pose(X_CT)
        a, b = on_stand.measure(estimate, X_WC), on_wall.measure(estimate, turned @ X_WC)
        assert_allclose(b.on_environment.force, R @ a.on_environment.force, atol=1e-9)
        assert np.abs(b.on_environment.force).max() < 1e-6  # it hangs
        stand.add(X_WT, X_CT)
        wall.add(turned @ X_WT, X_CT)
    assert wall.result().mass == pytest.approx(tool.mass, abs=1e-6)
    assert wall.result().mass == pytest.approx(stand.result().mass)
    with pytest.raises(ConfigError, match=r"up = \(0.0, 0.0, 0.5\) has length 0.5; give a unit vector"):
        Hand(up=(0.0, 0.0, 0.5))


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, -0.6, 0.8)])
def test_a_tool_is_lifted_against_gravity_as_it_is_before_it_is_turned(up: tuple[float, float, float]) -> None:
    X_W_tip = pose_from_rpy((0.3, -0.2, 1.0), (0.4, 0.1, 0.3))
    player = TaskPlayer(payload_task(X_W_tip, up), waits=False)
    state = ControllerState(0.0, "position", True, X_W_tip=X_W_tip)
    lift = X_W_tip
    for i in range(10000):
        status = player.step(0.004 * i, state)
        if status.phase != "lift":
            break
        assert status.setpoint is not None
        lift = status.setpoint.X_W_tip
    assert_allclose(lift[:3, 3] - X_W_tip[:3, 3], LIFT * np.array(up), atol=1e-6)
    assert_allclose(lift[:3, :3], X_W_tip[:3, :3], atol=1e-9)

# SPDX-License-Identifier: Apache-2.0
"""The controller's parts on their own: history, limits, lag, gravity, weighing, the one-dimensional case."""

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_control.algorithm1 import loop_gain, motor_position
from seed_control.command.flange_command import LagEstimate
from seed_control.command.limiter import PoseLimiter, VectorLimiter
from seed_control.payload.identify import PayloadError, PayloadFit
from seed_control.wrench.estimate import observed_part
from seed_control.wrench.history import PoseHistory
from seed_core.bushing import Bushing
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, GRAVITY, weight_about_T
from seed_core.quaternion import as_quaternion
from seed_core.spatial import Wrench, inverse_pose, make_pose, pose_from_rpy, rotation_from_rpy, so3_exp, so3_log
from seed_core.vector3 import as_vector3
from seed_testing.bench.control import growth

RNG = np.random.default_rng(9)


def test_history_interpolates_between_neighbours_round_the_ring() -> None:
    history = PoseHistory(16)
    for i in range(40):
        assert history.add(0.1 * i, pose_from_rpy((0.0, 0.0, 0.01 * i), (float(i), 0.0, 0.0)))
    assert len(history) == 16
    X = history.at(3.05)
    assert X is not None
    assert_allclose(X, pose_from_rpy((0.0, 0.0, 0.305), (30.5, 0.0, 0.0)), atol=1e-12)
    assert history.at(2.3) is None  # overwritten
    assert history.at(3.93) is None  # too far ahead
    assert history.at(3.91) is not None
    assert_allclose(history.newest()[0, 3], 39.0)


def test_history_refuses_stamps_that_do_not_rise() -> None:
    history = PoseHistory()
    assert history.at(0.0) is None
    assert history.add(1.0, np.eye(4))
    assert not history.add(1.0, make_pose(p=(1.0, 0.0, 0.0)))
    assert_allclose(history.newest(), np.eye(4))


def test_history_keeps_copies_of_its_newest_poses_alone() -> None:
    history, X = PoseHistory(8), np.eye(4)
    for i in range(1000):
        X[0, 3] = i
        history.add(float(i), X)
    assert len(history) == 8
    assert history.oldest_stamp == 992.0
    assert_allclose(history.at(992.0)[0, 3], 992.0)


def limiter() -> VectorLimiter:
    return VectorLimiter(speed=0.25, acceleration=2.0, jerk=200.0, bandwidth=80.0)


@pytest.mark.parametrize("distance", [1e-5, 1e-3, 0.02, 0.5])
def test_limiter_arrives_without_overshoot_and_within_its_bounds(distance: float) -> None:
    follower, x, dt = limiter(), np.zeros(3), 0.004
    target = distance * np.array((0.6, 0.0, -0.8))
    path = [x]
    for _ in range(1500):
        x = x + np.array(follower.advance(as_vector3(target - x), dt, 1.0))
        path.append(x)
    v = np.diff(path, axis=0) / dt
    a = np.diff(v, axis=0) / dt
    assert_allclose(x, target, atol=1e-9)
    along = np.array(path) @ target / distance
    assert along.max() < 1.02 * distance + 1e-7
    assert np.linalg.norm(v, axis=1).max() <= 0.25 + 1e-9
    assert np.linalg.norm(a, axis=1).max() <= 2.0 + 1e-9
    assert np.linalg.norm(np.diff(a, axis=0) / dt, axis=1).max() <= 200.0 + 1e-6


def test_limiter_trails_a_moving_target_by_two_over_its_bandwidth() -> None:
    follower, x, dt, v = limiter(), 0.0, 0.004, 0.05
    for i in range(1000):
        x += follower.advance((v * i * dt - x, 0.0, 0.0), dt, 1.0)[0]
    assert_allclose((v * 999 * dt - x) / v, 2.0 / 80.0, atol=dt)


def test_stop_comes_to_rest_within_the_braking_distance() -> None:
    follower, dt, way = limiter(), 0.004, 0.0
    for _ in range(500):
        follower.advance((1.0, 0.0, 0.0), dt, 1.0)
    for _ in range(500):
        way += follower.stop(dt)[0]
    assert np.linalg.norm(follower.v) < 1e-9
    assert way < 0.25**2 / (2 * 2.0) + 0.25 * 0.03  # v^2 / 2 a, and the jerk's and filter's share


def test_pose_limiter_stays_a_pose_over_an_hour_of_turning() -> None:
    body = PoseLimiter(limiter(), VectorLimiter(0.5, 6.0, 600.0, 80.0))
    body.reset(np.eye(4))
    for i in range(20_000):
        goal = rotation_from_rpy((0.3 * np.sin(0.01 * i), 0.2, 0.3))
        body.advance((0.0, 0.0, 0.0), as_quaternion(goal), 0.004, 0.25)
    R = body.pose[:3, :3]
    assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
    assert np.linalg.norm(so3_log(R.T @ goal)) < 0.05


def test_body_turns_about_its_limited_point() -> None:
    """The point's speed is what is limited, so a pure turn leaves it where it is and swings the body's origin."""
    arm = (0.0, 0.0, 0.15)
    body = PoseLimiter(VectorLimiter(0.25, 2.0, 200.0, 80.0), VectorLimiter(0.5, 6.0, 600.0, 80.0), arm)
    body.reset(make_pose(None, (0.4, 0.0, 0.3)))
    goal = as_quaternion(so3_exp((0.0, 0.4, 0.0)))
    for _ in range(500):
        body.advance(body.p, goal, 0.004, 0.25)
    assert_allclose((body.pose @ (*arm, 1.0))[:3], (0.4, 0.0, 0.45), atol=1e-12)
    assert_allclose(body.pose[0, 3], 0.4 - 0.15 * np.sin(0.4), atol=1e-6)


def test_lag_is_learnt_from_motion_and_kept_at_rest() -> None:
    lag = LagEstimate(0.015)
    for _ in range(3000):
        lag.update(np.array((0.05 * 0.08, 0.0, 0.0)), np.zeros(3), (0.05, 0.0, 0.0), 0.004)
    assert_allclose(lag.lag, 0.08, atol=2e-3)
    for _ in range(1000):
        lag.update(np.array((0.01, 0.0, 0.0)), np.zeros(3), (0.0, 0.0, 0.0), 0.004)
    assert_allclose(lag.lag, 0.08, atol=2e-3)


def test_weight_acts_downwards_in_any_orientation() -> None:
    com = np.array((0.01, -0.02, 0.06))
    for _ in range(20):
        R_WT = rotation_from_rpy(RNG.uniform(-1.5, 1.5, 3))
        load = weight_about_T(0.2, com, R_WT).rotated(R_WT)
        assert_allclose(load.force, (0.0, 0.0, -0.2 * GRAVITY), atol=1e-15)
        assert_allclose(load.torque, np.cross(R_WT @ com, load.force), atol=1e-15)


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


def test_algorithm_one_settles_at_the_force_asked_for_at_any_delay() -> None:
    """A motor on a spring of 800 N/m against a wall of 3 kN/m, its load seen `delay` steps late."""
    k, wall, force = 800.0, 3000.0, 5.0
    for delay in (1, 5, 25):
        motors, loads = [0.0] * (delay + 1), [0.0] * (delay + 1)
        for _ in range(60 * delay):
            motors.append(motor_position(force, k, loads[-delay]))
            loads.append(motors[-1] * loop_gain(k, wall))
        assert_allclose(k * (motors[-1] - loads[-1]), force, atol=1e-9)


def test_algorithm_one_refuses_a_stiffness_of_nothing() -> None:
    with pytest.raises(SeedError, match=r"stiffness = 0.0 N/m must be > 0"):
        motor_position(1.0, 0.0, 0.0)


def test_what_an_estimate_does_not_observe_counts_as_undeflected() -> None:
    """The published estimator reports a roll of the wrong sign: fed forward it would run away."""
    X_CT = pose_from_rpy((-0.2, 0.01, 0.1), (1e-3, -2e-3, 5e-3))
    whole = so3_log(X_CT[:3, :3])
    for seen in product((False, True), repeat=6):  # x, y, z, roll, pitch, yaw
        kept = observed_part(RelativePoseEstimate(0.0, X_CT, observed=seen))
        assert_allclose(kept[:3, 3], np.where(seen[:3], (1e-3, -2e-3, 5e-3), 0.0), atol=1e-15)
        assert_allclose(so3_log(kept[:3, :3]), np.where(seen[3:], whole, 0.0), atol=1e-15)
    assert_allclose(observed_part(RelativePoseEstimate(0.0, X_CT)), X_CT, atol=0.0)


def test_memory_does_not_grow_with_steps() -> None:
    """An hour is 900 000 steps: a list or reference kept per step would show as tens of bytes each or more."""
    assert growth(1200) < 1500.0  # bytes per 1000 steps; an array kept per step would make 100 000

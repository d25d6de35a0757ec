# SPDX-License-Identifier: Apache-2.0
"""The motion limiter: bounds, arrival, braking, turning."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_control.command.limiter import PoseLimiter, VectorLimiter
from seed_core.arm.quaternion import as_quaternion
from seed_core.spatial import make_pose, rotation_from_rpy, so3_exp, so3_log
from seed_core.vector3 import as_vector3


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


def test_far_away_the_speed_wanted_is_the_bound_or_what_can_be_braked() -> None:
    """By hand: w / 2 times the distance near by; then the least of both speed bounds and sqrt(1.4 a d)."""
    wide = {"acceleration": 1e9, "jerk": 1e15, "bandwidth": 80.0}  # which shape nothing here
    for way, dt, speed, expected, limited in (
        ((0.001, 0.0, 0.0), 0.01, 1.0, 0.04, False),  # 40 / s times 1 mm
        ((0.0, 0.1, 0.0), 0.01, 1.0, 0.25, True),
        ((0.0, 0.0, -0.1), 0.01, 0.1, -0.1, True),
    ):
        follower = VectorLimiter(speed=0.25, **wide)
        step = follower.advance(way, dt, speed)
        assert_allclose(sum(step) / dt, expected, rtol=1e-12)  # at a rate of 1 / dt below 2 w: in one step
        assert follower.limited == limited
        assert_allclose(follower.v, np.array(step) / dt, rtol=1e-12)
    braking = VectorLimiter(speed=1.0, acceleration=2.0, jerk=1e15, bandwidth=1e4)
    braking.v = (0.5, 0.0, 0.0)
    braking.advance((0.05, 0.0, 0.0), 0.001, 1.0)
    assert_allclose(braking.v[0], 0.5 - 2.0 * 0.001, rtol=1e-12)  # sqrt(1.4 2.0 0.05) = 0.374 m/s is wanted


def test_velocity_follows_at_twice_the_bandwidth() -> None:
    follower = VectorLimiter(speed=1.0, acceleration=1e9, jerk=1e15, bandwidth=10.0)
    step = follower.advance((0.01, 0.0, 0.0), 0.004, 1.0)
    assert_allclose(follower.a, (20.0 * 5.0 * 0.01, 0.0, 0.0), rtol=1e-12)  # 2 w (w / 2) d
    assert_allclose(follower.v, (0.004, 0.0, 0.0), rtol=1e-12)
    assert_allclose(step, (1.6e-5, 0.0, 0.0), rtol=1e-12)
    follower.stop(0.004)
    assert_allclose(follower.a, (-20.0 * 0.004, 0.0, 0.0), rtol=1e-12)


def test_jerk_and_acceleration_bound_the_first_steps_exactly() -> None:
    follower, dt = limiter(), 0.004
    follower.advance((1.0, 0.0, 0.0), dt, 1.0)
    assert_allclose(follower.a, (200.0 * dt, 0.0, 0.0), rtol=1e-12)
    for _ in range(3):
        follower.advance((1.0, 0.0, 0.0), dt, 1.0)
    assert_allclose(follower.a, (2.0, 0.0, 0.0), rtol=1e-12)  # 0.8, 1.6, 2.0
    assert_allclose(follower.v, ((0.8 + 1.6 + 2.0 + 2.0) * dt, 0.0, 0.0), rtol=1e-12)


def test_reset_is_at_rest_and_new_limiters_are() -> None:
    follower = limiter()
    assert (follower.v, follower.a, follower.limited) == ((0.0,) * 3, (0.0,) * 3, False)
    follower.advance((1.0, 1.0, 0.0), 0.004, 1.0)
    assert follower.limited
    follower.reset()
    assert (follower.v, follower.a, follower.limited) == ((0.0,) * 3, (0.0,) * 3, False)


def test_pose_limiter_starts_where_it_is_reset_with_its_own_point_there() -> None:
    body = PoseLimiter(limiter(), VectorLimiter(0.5, 6.0, 600.0, 80.0), (0.0, 0.1, 0.2))
    assert_allclose(body.pose, np.eye(4), atol=1e-15)
    X = make_pose(rotation_from_rpy((0.3, -0.2, 1.0)), (0.4, 0.1, 0.3))
    body.advance((0.5, 0.0, 0.0), as_quaternion(X[:3, :3]), 0.004, 0.25)
    body.reset(X)
    assert_allclose(body.pose, X, atol=1e-15)
    assert_allclose(body.p, (X @ (0.0, 0.1, 0.2, 1.0))[:3], atol=1e-15)
    assert body.linear.v == body.angular.v == (0.0, 0.0, 0.0)


def test_pose_limiter_moves_on_while_it_stops_and_keeps_each_bound() -> None:
    """Both kinds of motion keep their own speed bound, the linear one also that of the step."""
    body, dt = PoseLimiter(limiter(), VectorLimiter(0.5, 6.0, 600.0, 80.0)), 0.004
    goal = as_quaternion(so3_exp((0.0, 0.0, 2.0)))
    for _ in range(300):
        body.advance((1.0, 0.0, 0.0), goal, dt, 0.1)
    assert_allclose(body.linear.v, (0.1, 0.0, 0.0), atol=1e-9)
    assert_allclose(body.angular.v, (0.0, 0.0, 0.5), atol=1e-9)
    before = body.pose
    body.stop(dt)
    turn = so3_log(before[:3, :3].T @ body.pose[:3, :3])
    assert 0.09 * dt < body.pose[0, 3] - before[0, 3] < 0.1 * dt
    assert 0.49 * dt < turn[2] < 0.5 * dt
    for _ in range(200):
        body.stop(dt)
    assert_allclose(body.linear.v + body.angular.v, np.zeros(6), atol=1e-9)

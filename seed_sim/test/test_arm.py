# SPDX-License-Identifier: Apache-2.0
"""The simulated arm lags, errs a little, and follows the same commands with joints or without."""

from math import exp

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.spatial import make_pose, pose_from_rpy, so3_log
from seed_sim.plant.arm import Arm, Repeatability
from seed_sim.scenario import ServoSection

START = pose_from_rpy((np.pi, 0.0, 0.0), (0.5, 0.0, 0.3))


def moved(X: np.ndarray, dx: float) -> np.ndarray:
    return make_pose(X[:3, :3], X[:3, 3] + np.array((dx, 0.0, 0.0)))


def after(servo: ServoSection, target: np.ndarray, seconds: float) -> Arm:
    """An arm that was sent to target at time 0."""
    arm = Arm(servo, START, np.random.default_rng(0))
    arm.command(0.0, target)
    for k in range(1, round(seconds / 1e-3) + 1):
        arm.advance(k * 1e-3, 1e-3)
    return arm


@pytest.mark.parametrize("lag", [0.015, 0.06])
def test_step_response_is_a_first_order_lag(lag):
    arm = after(ServoSection(lag=lag), moved(START, 0.01), lag)
    assert_allclose(arm.reported[0, 3] - 0.5, 0.01 * (1.0 - exp(-1.0)), rtol=1e-6)


def test_rotation_lags_like_position():
    target = START @ pose_from_rpy((0.1, -0.2, 0.3), (0.0, 0.0, 0.0))
    arm = after(ServoSection(lag=0.02), target, 0.02)
    done = so3_log(START[:3, :3].T @ arm.reported[:3, :3])
    assert_allclose(done, so3_log(START[:3, :3].T @ target[:3, :3]) * (1.0 - exp(-1.0)), atol=1e-9)


def test_nothing_moves_during_the_dead_time():
    servo = ServoSection(lag=0.01, dead_time=0.02)
    assert_allclose(after(servo, moved(START, 0.01), 0.019).reported, START)
    assert after(servo, moved(START, 0.01), 0.022).reported[0, 3] > 0.5


@pytest.mark.parametrize("kind", ["ur5e", "ur10e"])
def test_joints_reach_the_commanded_pose(kind):
    target = START @ pose_from_rpy((0.05, 0.03, -0.1), (0.02, -0.01, 0.03))
    arm = after(ServoSection(arm=kind), target, 0.3)
    assert len(arm.q) == 6
    assert_allclose(arm.reported, target, atol=1e-6)


def test_target_out_of_reach_is_counted_and_not_followed():
    arm = after(ServoSection(arm="ur5e"), moved(START, 2.0), 0.1)
    assert arm.unreachable == 1
    assert_allclose(arm.reported, START, atol=1e-9)


def test_repeatability_error_stays_within_its_bound_and_is_smooth():
    error = Repeatability(1e-4, np.random.default_rng(3))
    samples = np.array([error.at(1e-3 * k) for k in range(20000)])
    assert np.abs(samples).max() <= 1e-4
    assert np.ptp(samples, axis=0).min() > 2e-5  # it does wander, on every axis
    assert np.abs(np.diff(samples, axis=0)).max() < 1e-4 * 2 * np.pi * 0.5 * 1e-3  # no faster than its fastest sine

# SPDX-License-Identifier: Apache-2.0
"""Pose of the tool from rendered images by the rigid fit: all axes, micro-slip, one finger."""

from dataclasses import replace

import numpy as np
import pytest
from rendered import PERIOD, held

from seed_core.config import ConfigError
from seed_core.hand import Hand
from seed_core.spatial import make_pose, rotation_error, so3_exp
from seed_estimation import Estimator, EstimatorError, EstimatorParameters, TactileImages
from seed_sim.tactile.parameters import TactileParameters, ToolShape
from seed_sim.tactile.renderer import TactileRenderer


def errors(p: TactileParameters, seed: int, seconds: float, size: float = 1.0) -> tuple[np.ndarray, float]:
    """RMSE (6,) of rotation vector [deg] and translation [mm] over a motion in all axes, share of valid ones."""
    estimator, bubbles = held(p, seed)
    out, valid, frames = [], 0, int(seconds / PERIOD)
    for i in range(1, frames):
        t = i * PERIOD
        q = size * min(t, 1.0) * np.sin(2 * np.pi * t * np.array((0.31, 0.4, 0.23, 0.37, 0.29, 0.43)))
        X = make_pose(so3_exp(q[:3] * np.deg2rad((10, 8, 8))), q[3:] * (0.006, 0.0028, 0.004))
        estimate = estimator.update(bubbles.render(X, t), t)
        valid += estimate.valid
        if estimate.valid:
            turn = np.rad2deg(rotation_error(estimate.X_CT[:3, :3], X[:3, :3]))
            out.append(np.concatenate([turn, 1e3 * (estimate.X_CT[:3, 3] - X[:3, 3])]))
    return np.sqrt(np.mean(np.square(out), axis=0)), valid / (frames - 1)


@pytest.mark.parametrize(
    "p",
    [
        TactileParameters(),
        TactileParameters(tool=ToolShape("short_handle", length=0.03)),
        TactileParameters(tool=ToolShape("box", length=0.04)),
        TactileParameters(brightness_change=0.3),
    ],
    ids=["long_cylinder", "short_handle", "box", "bright30"],
)
def test_all_six_axes_are_seen(p: TactileParameters) -> None:
    rmse, valid = errors(p, 11, 1.6)
    assert valid == 1.0
    assert (rmse < (0.35, 0.25, 0.45, 0.10, 0.12, 0.10)).all(), rmse


def test_a_small_micro_slip_is_corrected() -> None:
    """5 % of this motion would be 0.25 degrees and 0.18 mm."""
    rmse, valid = errors(TactileParameters(slip=0.05), 11, 3.0)
    assert valid == 1.0
    assert (rmse < (0.12, 0.12, 0.12, 0.08, 0.04, 0.08)).all(), rmse


def test_a_finger_that_is_behind_the_other_by_more_than_a_period_is_followed_from_the_grasp_on() -> None:
    """The right camera exposes 20 ms after the left one, at 60 Hz; an image's time is that of the older finger."""
    period, behind = 1.0 / 60.0, 0.02  # [s]
    bubbles = TactileRenderer(TactileParameters(), Hand(), 15)
    estimator = Estimator(EstimatorParameters(), Hand(), bubbles.cameras)

    def seen(t: float) -> dict[str, TactileImages]:
        images = bubbles.no_contact(t) if t < 0.0 else bubbles.render(np.eye(4), t)
        return {**images, "right": replace(images["right"], stamp=t + behind)}

    estimator.capture_reference([seen(i * period - 1.0) for i in range(4)])
    estimator.initialize_grasp([seen(i * period) for i in range(3)])
    estimate = estimator.update(seen(3 * period), 3 * period)
    assert estimate.valid, estimate.reason
    assert "out of order" in estimator.update(seen(3 * period), 3 * period).reason


def test_one_finger_gives_a_reduced_estimate() -> None:
    estimator, bubbles = held(TactileParameters(fingers="left"), 13)
    X = make_pose(so3_exp((0.0, 0.05, 0.0)), (0.001, 0.0005, 0.001))
    estimate = estimator.update(bubbles.render(X, 0.1), 0.1)
    assert estimate.valid
    assert "left finger only" in estimate.reason
    np.testing.assert_allclose(estimate.X_CT[:3, 3], X[:3, 3], atol=0.6e-3)


def test_what_the_cameras_may_get_wrong_counts_from_the_next_images_on() -> None:
    estimator, bubbles = held(TactileParameters(), 14)
    before = estimator.parameters
    for i in range(1, 11):
        X = make_pose(p=(0.0, 0.0, 0.0004 * i))
        small = estimator.update(bubbles.render(X, i * PERIOD), i * PERIOD)
    estimator.reconfigure(replace(before, focal_std=0.2))
    large = estimator.update(bubbles.render(X, 11 * PERIOD), 11 * PERIOD)
    assert large.valid, large.reason
    assert large.covariance[5, 5] > 2.0 * small.covariance[5, 5]  # 20 % of 4 mm, by two cameras
    with pytest.raises(ConfigError, match=r"calibration = 'another.yaml' cannot be changed while the estimator runs"):
        estimator.reconfigure(replace(before, calibration="another.yaml"))
    assert estimator.parameters.focal_std == 0.2


def test_slip_of_a_fifth_is_learnt() -> None:
    estimator, bubbles = held(TactileParameters(slip=0.2), 14)
    for i in range(1, 90):
        t = i * PERIOD
        q = min(t, 1.0) * np.sin(2 * np.pi * t * np.array((0.31, 0.4, 0.23, 0.37, 0.29, 0.43)))
        X = make_pose(so3_exp(q[:3] * np.deg2rad((10, 8, 8))), q[3:] * (0.006, 0.0028, 0.004))
        estimate = estimator.update(bubbles.render(X, t), t)
    assert estimate.slip == pytest.approx(0.2, abs=0.06)
    estimator.reconfigure(replace(estimator.parameters, max_slip=0.1))
    assert estimator.update(bubbles.render(X, t + PERIOD), t + PERIOD).slip <= 0.1


@pytest.mark.parametrize("method", ["rigid_fit", "published"])
def test_what_is_held_after_the_gripper_was_empty_has_no_pose_of_the_grasp_before(method: str) -> None:
    """A round handle that is gripped anew further along shows the very same images."""
    estimator, bubbles = held(TactileParameters(), 14, method)
    assert estimator.update(bubbles.render(np.eye(4), 0.1), 0.1).valid
    for t in np.arange(0.2, 1.4, 0.1).tolist():
        estimate = estimator.update(bubbles.no_contact(t), t)
        assert not estimate.valid
        assert "touches no" in estimate.reason
    estimate = estimator.update(bubbles.render(np.eye(4), 1.5), 1.5)
    assert not estimate.valid
    assert "initialize the grasp again" in estimate.reason
    estimator.initialize_grasp([bubbles.render(np.eye(4), 2.0 + i * PERIOD) for i in range(4)])
    assert estimator.update(bubbles.render(np.eye(4), 2.5), 2.5).valid


def test_a_touch_that_is_missed_for_a_moment_ends_no_grasp() -> None:
    estimator, bubbles = held(TactileParameters(), 14)
    for t in (0.1, 0.2, 0.3, 0.4):
        estimator.update(bubbles.no_contact(t), t)
    estimates = [estimator.update(bubbles.render(np.eye(4), t), t) for t in (0.5, 0.52, 0.54, 0.56, 0.58, 0.6)]
    assert estimates[-1].valid, estimates[-1].reason


def test_a_grasp_that_is_refused_leaves_none() -> None:
    estimator, bubbles = held(TactileParameters(), 14)
    with pytest.raises(EstimatorError):
        estimator.initialize_grasp([bubbles.no_contact(0.1 + i * PERIOD) for i in range(4)])
    estimate = estimator.update(bubbles.render(np.eye(4), 0.5), 0.5)
    assert not estimate.valid
    assert "the last one was refused" in estimate.reason

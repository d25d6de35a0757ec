# SPDX-License-Identifier: Apache-2.0
"""The wrench estimator's parts: what is observed, and the weight."""

from itertools import product

import numpy as np
from numpy.testing import assert_allclose

from seed_control.wrench.estimate import WrenchEstimator, observed_part
from seed_control.wrench.uncertainty import WrenchUncertainty
from seed_core.bushing import Bushing
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, GRAVITY, Tool, weight_about_T
from seed_core.spatial import make_pose, pose_from_rpy, rotation_from_rpy, so3_log

RNG = np.random.default_rng(9)


def test_weight_acts_downwards_in_any_orientation() -> None:
    com = np.array((0.01, -0.02, 0.06))
    for _ in range(20):
        R_WT = rotation_from_rpy(RNG.uniform(-1.5, 1.5, 3))
        load = weight_about_T(0.2, com, R_WT).rotated(R_WT)
        assert_allclose(load.force, (0.0, 0.0, -0.2 * GRAVITY), atol=1e-15)
        assert_allclose(load.torque, np.cross(R_WT @ com, load.force), atol=1e-15)


def test_what_an_estimate_does_not_observe_counts_as_undeflected() -> None:
    """The published estimator reports a roll of the wrong sign: fed forward it would run away."""
    X_CT = pose_from_rpy((-0.2, 0.01, 0.1), (1e-3, -2e-3, 5e-3))
    whole = so3_log(X_CT[:3, :3])
    for seen in product((False, True), repeat=6):  # x, y, z, roll, pitch, yaw
        kept = observed_part(RelativePoseEstimate(0.0, X_CT, observed=seen))
        assert_allclose(kept[:3, 3], np.where(seen[:3], (1e-3, -2e-3, 5e-3), 0.0), atol=1e-15)
        assert_allclose(so3_log(kept[:3, :3]), np.where(seen[3:], whole, 0.0), atol=1e-15)
    assert_allclose(observed_part(RelativePoseEstimate(0.0, X_CT)), X_CT, atol=0.0)


def test_how_well_the_force_is_known_is_told_in_the_task_frame_ten_times_a_second() -> None:
    """A pose that is known to 1, 2 and 3 mm along x, y and z of an undeflected grasp; the tool is turned about z."""
    k, tool = np.array(DEFAULT_STIFFNESS.translation), Tool(mass=0.0)
    estimator = WrenchEstimator(tool, Bushing(DEFAULT_STIFFNESS), True, 3e-4)
    told, R = WrenchUncertainty(estimator), rotation_from_rpy((0.0, 0.0, 0.5 * np.pi))
    C = np.diag(np.array((1e-6, 1e-6, 1e-6, 1e-3, 2e-3, 3e-3)) ** 2)

    def image(stamp: float, scale: float = 1.0) -> bool:
        estimate = RelativePoseEstimate(stamp, np.eye(4), scale**2 * C)
        return told.update(estimator.measure(estimate, make_pose(R)), np.eye(3)[:, [2, 0, 1]])

    assert told.too_large(np.eye(3), 0.1) == ""  # nothing is known before an image
    assert image(0.0)
    along = k * (1e-3, 2e-3, 3e-3)  # of T
    assert told.deviation is not None
    assert_allclose(told.deviation.force, (along[2], along[1], along[0]), rtol=1e-3)  # z, x and y of W
    assert_allclose(np.sqrt(told.by_pose.diagonal()[3:]), along, rtol=1e-3)
    assert told.too_large(np.eye(3)[[1]], along[0] + 0.01) == ""
    assert "known to 0.8 N only" in told.too_large(np.eye(3)[[1]], along[0] - 0.01)
    assert "known to 2.4 N only" in told.too_large(np.eye(3)[[1, 2]], 1.0)
    assert told.too_large(np.zeros((0, 3)), 0.1) == ""
    assert [image(t, 2.0) for t in (0.02, 0.09, 0.1, 0.15, -5.0, -4.95)] == [False, False, True, False, True, False]
    assert_allclose(told.deviation.force[0], 2.0 * along[2], rtol=1e-3)

# SPDX-License-Identifier: Apache-2.0
"""The wrench estimator's parts: what is observed, and the weight."""

from itertools import product

import numpy as np
from numpy.testing import assert_allclose

from seed_control.wrench.estimate import observed_part
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import GRAVITY, weight_about_T
from seed_core.spatial import pose_from_rpy, rotation_from_rpy, so3_log

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

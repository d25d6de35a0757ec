# SPDX-License-Identifier: Apache-2.0
"""The history of poses: interpolation, order and size."""

import numpy as np
from numpy.testing import assert_allclose

from seed_control.wrench.history import PoseHistory
from seed_core.spatial import make_pose, pose_from_rpy


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


def test_history_extrapolates_with_a_slope_over_some_milliseconds() -> None:
    history = PoseHistory()
    for i in range(4):  # at 500 Hz, 100 mm/s
        history.add(1.0 + 0.002 * i, make_pose(p=(2e-4 * i, 0.0, 0.0)))
    assert_allclose(history.at(1.016)[0, 3], 1.6e-3, atol=1e-12)
    history.add(1.00601, make_pose(p=(7e-4, 0.0, 0.0)))  # 10 us and 0.1 mm further
    assert_allclose(history.at(1.021)[0, 3], 2.1e-3, atol=6e-4)
    assert_allclose(history.at(1.00601)[0, 3], 7e-4)


def test_history_too_short_for_a_slope_extrapolates_nothing() -> None:
    history = PoseHistory()
    history.add(1.0, np.eye(4))
    history.add(1.00001, make_pose(p=(1e-4, 0.0, 0.0)))
    assert_allclose(history.at(1.015)[0, 3], 1e-4)


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

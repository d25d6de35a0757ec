# SPDX-License-Identifier: Apache-2.0
"""A track that is lost is not valid until it is right, and is found again."""

from dataclasses import replace

import numpy as np
import pytest
from rendered import PERIOD, held

from seed_core.spatial import make_pose, rotation_error, so3_exp
from seed_sim.tactile.parameters import TactileParameters, ToolShape


def test_a_lost_track_is_invalid_until_it_is_right() -> None:
    """The tool jumps by 3 mm and 7 degrees at once: whatever is called valid afterwards is within a millimetre."""
    estimator, bubbles = held(TactileParameters(tool=ToolShape("box", length=0.04)), 15)
    X = make_pose(so3_exp((0.0, 0.12, 0.0)), (0.003, 0.0, 0.0))
    found = [estimator.update(bubbles.render(X, i * PERIOD), i * PERIOD) for i in range(1, 26)]
    assert all(np.linalg.norm(e.X_CT[:3, 3] - X[:3, 3]) < 1e-3 for e in found if e.valid)
    assert found[-1].valid


@pytest.mark.parametrize("way", [0.003, 0.012])
def test_a_tool_that_moved_while_a_camera_was_covered_is_found_again(way: float) -> None:
    """A cloth before both cameras is no slip; near and far, the first estimate after it is right."""
    estimator, bubbles = held(TactileParameters(), 21)
    X = make_pose(so3_exp(np.deg2rad((6.0, 20.0, -5.0))), (way, 0.001, -0.4 * way))
    cloth = np.random.default_rng(21).normal(600.0, 100.0, (171, 224)).astype(np.float32)
    for i in range(1, 12):
        images = {f: replace(image, ir=cloth) for f, image in bubbles.render(X, i * PERIOD).items()}
        estimate = estimator.update(images, i * PERIOD)
        assert not estimate.valid
        assert not estimate.gross_slip
    found = [estimator.update(bubbles.render(X, i * PERIOD), i * PERIOD) for i in range(12, 22)]
    good = [e for e in found if e.valid]
    assert len(good) >= 5
    assert all(np.linalg.norm(e.X_CT[:3, 3] - X[:3, 3]) < 0.5e-3 for e in good)
    assert all(np.linalg.norm(rotation_error(e.X_CT[:3, :3], X[:3, :3])) < np.deg2rad(1.0) for e in good)


def test_a_tool_that_rolls_at_once_is_not_followed_by_one_image_alone() -> None:
    """One camera may find dots that fit; the other's image and depth must not contradict it."""
    estimator, bubbles = held(TactileParameters(), 22)
    X = make_pose(so3_exp(np.deg2rad((20.0, 0.0, 0.0))))
    for i in range(1, 20):
        estimate = estimator.update(bubbles.render(X, i * PERIOD), i * PERIOD)
        assert not estimate.valid or np.linalg.norm(rotation_error(estimate.X_CT[:3, :3], X[:3, :3])) < np.deg2rad(1.5)
    assert estimate.valid


def test_one_finger_says_nothing_about_a_tool_that_left_it() -> None:
    estimator, bubbles = held(TactileParameters(fingers="left"), 13)
    for i in range(1, 30):
        estimate = estimator.update(bubbles.render(make_pose(p=(0.0, -2.5e-4 * i, 0.0)), i * PERIOD), i * PERIOD)
        assert not estimate.valid or abs(estimate.X_CT[1, 3] + 2.5e-4 * i) < 0.6e-3
    assert not estimate.valid
    assert "touches no" in estimate.reason

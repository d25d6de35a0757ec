# SPDX-License-Identifier: Apache-2.0
"""A track that is lost is not valid until it is right, and is found again."""

from dataclasses import replace

import numpy as np
import pytest
from rendered import PERIOD, held

from seed_core.hand import Hand
from seed_core.spatial import make_pose, rotation_error, so3_exp
from seed_sim.tactile.parameters import TactileParameters, ToolShape

LEFT = float(np.sign(Hand().X_CL[1, 3]))  # side of the left camera along y of C


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


@pytest.mark.parametrize("closed", [0.0012, -0.0004])
@pytest.mark.parametrize("kind", ["cylinder", "box"])
def test_a_gripper_that_closes_further_moves_no_tool(kind: str, closed: float) -> None:
    """Cameras ride on the fingers: in 0.4 s both come nearer, while the tool moves in the grasp."""
    estimator, bubbles = held(TactileParameters(tool=ToolShape(kind, length=0.12)), 16)
    for i in range(1, 45):
        t = i * PERIOD
        X = make_pose(
            so3_exp((0.02 * np.sin(4.0 * t), 0.05 * np.sin(3.0 * t), 0.0)), (0.001 * np.sin(5.0 * t), 0.0, 0.0)
        )
        nearer = closed * min(max((t - 0.2) / 0.4, 0.0), 1.0)
        images = {
            f: bubbles.finger(f, make_pose(p=(0.0, side * nearer, 0.0)) @ X, t)
            for f, side in (("left", LEFT), ("right", -LEFT))
        }
        estimate = estimator.update(images, t)
        assert estimate.valid
        assert abs(estimate.X_CT[1, 3]) < 6e-5
        assert (
            estimate.covariance[4, 4] > (0.4 * max(abs(nearer) - 1e-4, 0.0)) ** 2
        )  # cameras may have come nearer differently
        for m in estimate.membrane:  # the band goes along in part, between the tool and the rim
            inward = (-LEFT if m.finger == "left" else LEFT) * m.X_CM[1, 3]
            assert min(nearer, 0.0) - 1.5e-4 < inward < max(nearer, 0.0) + 1.5e-4
    assert estimator.closing == pytest.approx(closed, abs=6e-5)


@pytest.mark.parametrize("drifts", [("left", "right"), ("left",)])
def test_depth_that_drifts_is_not_followed_surely(drifts: tuple[str, ...]) -> None:
    """As it does while a time of flight camera warms up; of one alone nothing tells whether it is the tool."""
    estimator, bubbles = held(TactileParameters(), 17)
    for i in range(1, 60):
        images = bubbles.render(np.eye(4), i * PERIOD)
        images |= {f: replace(images[f], depth=images[f].depth - np.float32(1e-5 * i)) for f in drifts}
        estimate = estimator.update(images, i * PERIOD)
        assert estimate.valid
        off = abs(estimate.X_CT[1, 3])
        assert off < (5e-5 if len(drifts) == 2 else max(3.0 * estimate.covariance[4, 4] ** 0.5, 1e-4))


@pytest.mark.parametrize("missing", [0.05, 0.3])
def test_depth_with_holes_tells_as_much(missing: float) -> None:
    rng = np.random.default_rng(18)
    estimator, bubbles = held(TactileParameters(), 18)
    for i in range(1, 30):
        X = make_pose(so3_exp((0.0, 0.003 * i, 0.0)), (5e-5 * i, 0.0, 0.0))
        images = bubbles.render(X, i * PERIOD)
        holes = {
            f: np.where(rng.random(a.depth.shape) < missing, np.float32(np.nan), a.depth) for f, a in images.items()
        }
        estimate = estimator.update({f: replace(images[f], depth=d) for f, d in holes.items()}, i * PERIOD)
        assert estimate.valid
        assert np.linalg.norm(estimate.X_CT[:3, 3] - X[:3, 3]) < 1e-4

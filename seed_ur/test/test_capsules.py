# SPDX-License-Identifier: Apache-2.0
"""Capsules enclose the arms, and their distances are those that a minimisation finds."""

from math import pi

import numpy as np
import pytest
from scipy.optimize import lsq_linear, minimize_scalar

from seed_core.errors import SeedError
from seed_core.spatial import rotation_from_rpy
from seed_ur import MODELS, URKinematics
from seed_ur.capsules import ARMS, HAND, Capsule, Skeleton, arm_capsules
from seed_ur.distances import between_segments, from_boxes, from_planes

# Lowest and highest corner [m] of each collision mesh of Universal_Robots_ROS2_Description 2.4.5 in its frame.
MESHES = {
    "ur5e": (
        ((-0.0755, -0.0755, 0.0), (0.0755, 0.0755, 0.0991)),
        ((-0.0601, -0.0639, -0.0601), (0.0601, 0.0715, 0.0744)),
        ((-0.0596, -0.0601, 0.0602), (0.4856, 0.0601, 0.2099)),
        ((-0.0389, -0.058, -0.0495), (0.4506, 0.0578, 0.0604)),
        ((-0.0393, -0.0736, -0.0563), (0.0394, 0.0386, 0.0536)),
        ((-0.0393, -0.0391, -0.0567), (0.0394, 0.0461, 0.0531)),
        ((-0.0375, -0.0435, -0.0458), (0.0376, 0.038, 0.0001)),
    ),
    "ur10e": (
        ((-0.095, -0.0949, 0.0), (0.0949, 0.0949, 0.0993)),
        ((-0.0764, -0.0817, -0.0764), (0.0764, 0.0939, 0.0946)),
        ((-0.0597, -0.0764, 0.0948), (0.6894, 0.0764, 0.2694)),
        ((-0.0461, -0.058, -0.0188), (0.6303, 0.058, 0.106)),
        ((-0.047, -0.0683, -0.0575), (0.047, 0.0472, 0.0666)),
        ((-0.047, -0.0465, -0.057), (0.047, 0.0534, 0.0679)),
        ((-0.0445, -0.0516, -0.0489), (0.0443, 0.0458, -0.0001)),
    ),
}


@pytest.mark.parametrize("name", MODELS)
def test_capsules_enclose_the_extent_of_every_link_and_not_much_more(name: str) -> None:
    for frame, (low, high) in enumerate(MESHES[name]):
        mine = [c for c in arm_capsules(name) if c.frame == frame]
        lowest = np.min([np.minimum(c.start, c.end) - c.radius for c in mine], axis=0)
        highest = np.max([np.maximum(c.start, c.end) + c.radius for c in mine], axis=0)
        room = np.concatenate((np.subtract(low, lowest), np.subtract(highest, high)))
        assert room.min() >= -1e-4, (frame, room)
        # The base is a cylinder, which a capsule's ends stand out of.
        assert room.max() <= (0.07 if frame else 0.1), (frame, room)


def test_the_tubes_of_the_arm_are_as_long_as_its_lengths() -> None:
    """Over joint 2 and joint 3 the upper arm's capsules end around both axes, whichever way the arm points."""
    for name, capsules in ARMS.items():
        arm = URKinematics.for_model(name)
        skeleton = Skeleton(capsules)
        q = (0.4, -1.1, 0.9, -0.2, 0.3, 1.0)
        frames = np.concatenate((np.eye(4)[None], arm.frames(q), arm.forward(q)[None]))
        start, end = skeleton.segments(frames)
        upper = [i for i, c in enumerate(capsules) if c.body == "upper arm"]
        for joint in (1, 2):  # the axes of joints 2 and 3 are z of frames 1 and 2
            point = frames[joint, :3, 3] + 0.138 * frames[joint, :3, 2]
            reached = [_to_point(point, start[i], end[i]) - capsules[i].radius for i in upper]
            assert min(reached) < -0.03


def _to_point(point, start, end) -> float:
    along = np.clip((point - start) @ (end - start) / max(1e-12, (end - start) @ (end - start)), 0.0, 1.0)
    return float(np.linalg.norm(point - start - along * (end - start)))


def test_what_is_on_the_flange_goes_with_it() -> None:
    q = (0.1, -1.2, 1.4, -0.3, 0.7, -2.0)
    X = URKinematics.for_model("ur5e").forward(q)
    frames = np.stack([np.eye(4)] * 7 + [X])
    start, end = Skeleton([Capsule("hand", HAND, (0.0, 0.0, 0.05), (0.1, 0.0, 0.2), 0.04)]).segments(frames)
    assert start[0] == pytest.approx(X[:3, 3] + 0.05 * X[:3, 2])
    assert end[0] == pytest.approx((X @ (0.1, 0.0, 0.2, 1.0))[:3])


def test_an_unknown_arm_is_refused() -> None:
    with pytest.raises(SeedError, match="no capsules of 'ur3'; choose one of ur5e, ur10e"):
        arm_capsules("ur3")


def test_distances_of_segments_are_those_of_a_bounded_least_squares_solution() -> None:
    rng = np.random.default_rng(3)
    ends = rng.normal(size=(4, 300, 3))
    ends[3, :60] = ends[2, :60] + rng.normal(size=(60, 1)) * (ends[1, :60] - ends[0, :60])  # parallel
    ends[1, 60:80] = ends[0, 60:80]  # points
    ends[3, 70:90] = ends[2, 70:90]
    crossing = ends[0, 90:120] + rng.uniform(size=(30, 1)) * (ends[1, 90:120] - ends[0, 90:120])
    way = rng.normal(size=(30, 3))
    ends[2, 90:120], ends[3, 90:120] = crossing - way, crossing + 0.7 * way
    found = between_segments(*ends)
    assert found[90:120] == pytest.approx(0.0, abs=1e-9)
    for a, b, c, d, distance in zip(*ends, found, strict=True):
        best = lsq_linear(np.stack((b - a, c - d), axis=1), c - a, (0.0, 1.0), method="bvls", tol=1e-14)
        assert distance == pytest.approx(np.sqrt(2.0 * best.cost), abs=1e-6)


def test_distances_from_boxes_are_those_of_a_search_along_the_segment() -> None:
    rng = np.random.default_rng(4)
    n = 200
    R = np.array([rotation_from_rpy(rng.uniform(-pi, pi, 3)) for _ in range(n)])
    centres, halves = 0.5 * rng.normal(size=(n, 3)), rng.uniform(0.05, 0.6, (n, 3))
    start, end = rng.normal(size=(2, n, 3))
    R[:20] = np.eye(3)
    end[:10, :2] = start[:10, :2]  # along an edge
    end[10:20] = start[10:20]  # points
    for i, distance in enumerate(from_boxes(start, end, R, centres, halves)):

        def squared(t: float, i: int = i) -> float:
            p = R[i].T @ (start[i] + t * (end[i] - start[i]) - centres[i])
            gap = np.maximum(np.abs(p) - halves[i], 0.0)
            return float(gap @ gap)

        best = minimize_scalar(squared, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-9})
        assert distance == pytest.approx(np.sqrt(min(best.fun, squared(0.0), squared(1.0))), abs=2e-5)


def test_distances_from_planes_are_signed() -> None:
    start, end = np.array(((0.0, 0.0, 0.3), (0.0, 0.0, 0.3))), np.array(((1.0, 0.0, 0.5), (1.0, 0.0, -0.2)))
    up = np.array(((0.0, 0.0, 1.0),) * 2)
    assert from_planes(start, end, up, np.array((0.1, 0.1))) == pytest.approx((0.2, -0.3))

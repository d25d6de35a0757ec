# SPDX-License-Identifier: Apache-2.0
"""An estimator over a bag that holds the images of the bubbles and the true pose of the tool.

The truth says when nothing is held (not valid) and when the grasp begins (valid from there on): images before it are
the reference, those right after it the grasp. The score ends where the truth is not valid any more.
"""

from bisect import bisect_left
from itertools import dropwhile, takewhile
from pathlib import Path
from typing import Any

import cv2

from seed_bringup.bags.files import read_messages
from seed_core.errors import SeedError
from seed_core.hand import FINGERS
from seed_core.spatial import Array, interpolate_pose, inverse_pose
from seed_estimation import Estimator, PinholeCamera, TactileImages
from seed_estimation.images.tactile_images import Image
from seed_ros.conversions import pose_to_matrix, seconds
from seed_ros.images import Pairing, depth_from_message, gray_from_message, intrinsics
from seed_sim import Scenario
from seed_sim.closed_loop.relative_poses import estimator_parameters, refuse_calibrate
from seed_testing.validation.run import GRASP_FRAMES, REFERENCE_FRAMES
from seed_testing.validation.scores import Series

TRUTH = "ground_truth/relative_pose"
_READERS = {"depth": depth_from_message, "ir": gray_from_message}
_PAIRED = 0.004  # [s]; images further apart than this are not of one time


class BagDataError(SeedError):
    """A bag without what a validation needs."""


class _Content:
    """Images with stamp [s] and stream ("left/depth"), cameras by finger, true poses (None where nothing is held)."""

    def __init__(self) -> None:
        self.images: list[tuple[float, str, Image]] = []
        self.cameras: dict[str, PinholeCamera] = {}
        self.truth: list[tuple[float, Array | None]] = []

    def take(self, topic: str, message: Any) -> None:
        """Keep one message when its topic is of use."""
        finger = next((f for f in FINGERS if f"bubble_{f}/" in topic), "")
        if topic.endswith(TRUTH):
            X = pose_to_matrix(message.pose.pose, topic) if message.valid else None
            self.truth.append((seconds(message.header.stamp), X))
        elif finger and topic.endswith("depth/camera_info"):
            self.cameras[finger] = PinholeCamera.from_info(*intrinsics(message, rectified=False))
        elif finger and topic.endswith("/image_rect_raw"):
            kind = "depth" if "/depth/" in topic else "ir"
            self.images.append((seconds(message.header.stamp), f"{finger}/{kind}", _READERS[kind](message, topic)))

    def frames(self) -> list[dict[str, TactileImages]]:
        """Images of all streams that were taken at one time, of the fingers that lack no stream."""
        there = {stream for _, stream, _ in self.images}
        self.cameras = {f: c for f, c in self.cameras.items() if all(f"{f}/{kind}" in there for kind in _READERS)}
        streams = tuple(f"{f}/{kind}" for f in self.cameras for kind in _READERS)
        pairing: Pairing[tuple[float, Image]] = Pairing(streams, _PAIRED)
        out = []
        for stamp, stream, image in sorted(self.images, key=lambda taken: taken[0]):
            if stream in streams and (done := pairing.add(stream, stamp, (stamp, image))) is not None:
                frame = {}
                for f in self.cameras:
                    (taken, depth), (_, ir) = done[1][f"{f}/depth"], done[1][f"{f}/ir"]
                    frame[f] = TactileImages(depth, ir, taken)
                out.append(frame)
        return out


def run_bag(path: Path, method: str, scenario: Scenario) -> Series:
    """Truth and estimates over the bag; hand and settings of the estimator are the scenario's.

    Raises:
        SeedError: no readable bag, or images, camera_info, truth or the grasp are missing in it; or the scenario
            wants a calibration.
    """
    refuse_calibrate(scenario, "a bag")
    cv2.setNumThreads(1)
    content = _Content()
    for topic, _, message in read_messages(path, lambda topic: "bubble_" in topic or topic.endswith(TRUTH)):
        content.take(topic, message)
    frames = content.frames()
    if not (content.cameras and content.truth):
        raise BagDataError(
            f"{path}: needs bubble_left or bubble_right with depth/image_rect_raw, ir/image_rect_raw and "
            f"depth/camera_info, and {TRUTH}; record with all topics"
        )
    truth = _grasp(content.truth)
    if not truth:
        raise BagDataError(f"{path}: the true pose is never valid: no tool was held while this was recorded")
    times, poses = zip(*truth, strict=True)
    stamps = [next(iter(f.values())).stamp for f in frames]
    still = [f for f, t in zip(frames, stamps, strict=True) if t < times[0]][-REFERENCE_FRAMES:]
    held = [f for f, t in zip(frames, stamps, strict=True) if times[0] <= t <= times[-1] + _PAIRED]
    if not still or len(held) <= GRASP_FRAMES:
        raise BagDataError(
            f"{path}: {len(still)} pairs of images before the grasp and {len(held)} after it; a reference without "
            f"contact and more than {GRASP_FRAMES} pairs of a grasped tool are needed"
        )
    estimator = Estimator(estimator_parameters(scenario, method), scenario.hand, content.cameras)
    estimator.capture_reference(still)
    estimator.initialize_grasp(held[:GRASP_FRAMES])
    series = Series()
    X_grasp = _pose_at(next(iter(held[GRASP_FRAMES - 1].values())).stamp, times, poses)
    for images in held[GRASP_FRAMES:]:
        stamp = max(i.stamp for i in images.values())
        series.estimate(estimator, images, stamp, _pose_at(stamp, times, poses) @ inverse_pose(X_grasp))
    return series


def _grasp(truth: list[tuple[float, Array | None]]) -> list[tuple[float, Array]]:
    """Times and poses of the first grasp: what is held later is another one, with poses from its own beginning."""
    later = dropwhile(lambda told: told[1] is None, truth)
    return [(t, X) for t, X in takewhile(lambda told: told[1] is not None, later) if X is not None]


def _pose_at(t: float, times: tuple[float, ...], poses: tuple[Array, ...]) -> Array:
    """The truth at time t, interpolated."""
    i = bisect_left(times, t)
    if i == 0 or i == len(times):
        return poses[min(i, len(poses) - 1)]
    share = (t - times[i - 1]) / max(times[i] - times[i - 1], 1e-9)
    return interpolate_pose(poses[i - 1], poses[i], share)

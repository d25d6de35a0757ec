# SPDX-License-Identifier: Apache-2.0
"""An estimator over a bag that holds the images of the bubbles and the true pose of the tool; needs no ROS.

The truth says when nothing is held (not valid) and when the grasp begins (valid from there on): images before it are
the reference, those right after it the grasp.
"""

from bisect import bisect_left
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from seed_core.config import from_mapping
from seed_core.errors import SeedError
from seed_core.spatial import Array, interpolate_pose, inverse_pose, pose_from_quaternion
from seed_estimation import Estimator, EstimatorParameters, PinholeCamera, TactileImages
from seed_sim import Scenario
from seed_testing.validation.scores import Series

FINGERS = ("left", "right")
TRUTH = "ground_truth/relative_pose"
REFERENCE_FRAMES, GRASP_FRAMES = 20, 8
_PAIRED = 0.004  # [s]; images further apart than this are not of one time
# as seed_ros.images.arrays reads them live, which needs ROS: number and unit of depth [m], of brightness [counts]
_ENCODINGS = {
    "depth": {"32FC1": ("f4", 1.0), "16UC1": ("u2", 1e-3), "mono16": ("u2", 1e-3)},
    "ir": {
        k: (v, 1.0) for k, v in (("mono16", "u2"), ("16UC1", "u2"), ("mono8", "u1"), ("8UC1", "u1"), ("32FC1", "f4"))
    },
}
Pair = dict[str, TactileImages]


class BagDataError(SeedError):
    """A bag without what a validation needs."""


class _Content:
    """Images by finger and kind and stamp, cameras by finger, and the true poses (None where nothing is held)."""

    def __init__(self) -> None:
        self.images: dict[tuple[str, str], dict[float, Any]] = defaultdict(dict)
        self.cameras: dict[str, PinholeCamera] = {}
        self.truth: list[tuple[float, Array | None]] = []

    def take(self, topic: str, deserialize: Any) -> None:
        """Keep one message when its topic is of use."""
        finger = next((f for f in FINGERS if f"bubble_{f}/" in topic), "")
        if topic.endswith(TRUTH):
            m = deserialize()
            p, q = m.pose.pose.position, m.pose.pose.orientation
            X = pose_from_quaternion((q.x, q.y, q.z, q.w), (p.x, p.y, p.z), topic) if m.valid else None
            self.truth.append((_stamp(m), X))
        elif finger and topic.endswith("depth/camera_info"):
            m = deserialize()
            self.cameras[finger] = PinholeCamera.from_info(m.width, m.height, list(m.k), list(m.d), m.distortion_model)
        elif finger and topic.endswith("/image_rect_raw"):
            m = deserialize()
            self.images[finger, "depth" if "/depth/" in topic else "ir"][_stamp(m)] = image_of(m, topic)

    def keep_complete_fingers(self) -> bool:
        """Leave fingers out that lack a stream; False if nothing is left, or there is no truth."""
        kinds = _ENCODINGS.keys()
        self.cameras = {f: c for f, c in self.cameras.items() if all((f, kind) in self.images for kind in kinds)}
        self.images = {(f, kind): self.images[f, kind] for f in FINGERS if f in self.cameras for kind in kinds}
        return bool(self.cameras and self.truth)

    def pairs(self) -> list[Pair]:
        """Images of all streams that were taken at one time."""
        stamps = {stream: sorted(images) for stream, images in self.images.items()}
        out = []
        for t in stamps[next(iter(self.cameras)), "depth"]:
            near = {stream: _nearest(s, t) for stream, s in stamps.items()}
            if all(abs(found - t) <= _PAIRED for found in near.values()):
                taken = {stream: self.images[stream][found] for stream, found in near.items()}
                out.append(
                    {f: TactileImages(taken[f, "depth"], taken[f, "ir"], near[f, "depth"]) for f in self.cameras}
                )
        return out


def run_bag(path: Path, method: str, scenario: Scenario) -> Series:
    """Truth and estimates over the bag; hand and settings of the estimator are the scenario's.

    Raises:
        BagDataError: no readable bag, or images, camera_info, truth or the grasp are missing in it.
    """
    cv2.setNumThreads(1)
    content = _read(path)
    times, poses = [], []
    for t, X in content.truth:
        if X is not None:
            times.append(t)
            poses.append(X)
    if not times:
        raise BagDataError(f"{path}: the true pose is never valid: no tool was held while this was recorded")
    frames = content.pairs()
    begun = [next(iter(f.values())).stamp >= times[0] for f in frames]
    still = [f for f, held in zip(frames, begun, strict=True) if not held][-REFERENCE_FRAMES:]
    held = [f for f, held in zip(frames, begun, strict=True) if held]
    if not still or len(held) <= GRASP_FRAMES:
        raise BagDataError(
            f"{path}: {len(still)} pairs of images before the grasp and {len(held)} after it; a reference without "
            f"contact and more than {GRASP_FRAMES} pairs of a grasped tool are needed"
        )
    given = {**scenario.estimator, "method": method}
    estimator = Estimator(from_mapping(given, EstimatorParameters), scenario.hand, content.cameras)
    estimator.capture_reference(still)
    estimator.initialize_grasp(held[:GRASP_FRAMES])
    series = Series()
    X_grasp = _pose_at(next(iter(held[GRASP_FRAMES - 1].values())).stamp, times, poses)
    for images in held[GRASP_FRAMES:]:
        stamp = max(i.stamp for i in images.values())
        series.estimate(estimator, images, stamp, _pose_at(stamp, times, poses) @ inverse_pose(X_grasp))
    return series


def _read(path: Path) -> _Content:
    from rosbags.highlevel import AnyReader, AnyReaderError

    content = _Content()
    try:
        with AnyReader([path]) as reader:
            for connection, _, data in reader.messages():
                content.take(connection.topic, lambda c=connection, d=data: reader.deserialize(d, c.msgtype))
    except (AnyReaderError, OSError) as error:
        raise BagDataError(f"{path}: not a readable bag: {error}") from error
    if not content.keep_complete_fingers():
        raise BagDataError(
            f"{path}: needs bubble_left or bubble_right with depth/image_rect_raw, ir/image_rect_raw and "
            f"depth/camera_info, and {TRUTH}; record with all topics"
        )
    return content


def image_of(message: Any, topic: str) -> np.ndarray:
    """(H, W) float32 of a sensor_msgs/Image: depth in metres with NaN where there is none, or counts.

    Raises:
        BagDataError: an encoding that is not read.
    """
    known = _ENCODINGS["depth" if "/depth/" in topic else "ir"]
    if message.encoding not in known:
        raise BagDataError(f"{topic}: encoding '{message.encoding}' is not read; known: {', '.join(known)}")
    kind, scale = known[message.encoding]
    number = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
    pixels = np.ascontiguousarray(rows[:, : message.width * number.itemsize]).view(number)
    values = np.ascontiguousarray(pixels.astype(np.float32) * np.float32(scale))
    if known is _ENCODINGS["depth"]:
        values[~((values > 0.0) & (values < np.inf))] = np.nan
    return values


def _stamp(message: Any) -> float:
    return float(message.header.stamp.sec) + 1e-9 * float(message.header.stamp.nanosec)


def _nearest(stamps: list[float], t: float) -> float:
    i = bisect_left(stamps, t)
    return min(stamps[max(0, i - 1) : i + 1], key=lambda s: abs(s - t))


def _pose_at(t: float, times: list[float], poses: list[Array]) -> Array:
    """The truth at time t, interpolated."""
    i = bisect_left(times, t)
    if i == 0 or i == len(times):
        return poses[min(i, len(poses) - 1)]
    share = (t - times[i - 1]) / max(times[i] - times[i - 1], 1e-9)
    return interpolate_pose(poses[i - 1], poses[i], share)

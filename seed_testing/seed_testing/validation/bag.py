# SPDX-License-Identifier: Apache-2.0
"""An estimator over a bag that holds the images of the bubbles and the true pose of the tool; needs no ROS.

The truth says when nothing is held (not valid) and when the grasp begins (valid from there on): images before it are
the reference, those right after it the grasp.
"""

from __future__ import annotations

import time
from bisect import bisect_left
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from seed_core.config import from_mapping
from seed_core.errors import SeedError
from seed_core.spatial import Array, interpolate_pose, inverse_pose, make_pose
from seed_estimation import Estimator, EstimatorParameters, PinholeCamera, TactileImages
from seed_sim.scenario import Scenario
from seed_testing.validation.scores import Series

FINGERS = ("left", "right")
TRUTH = "ground_truth/relative_pose"
REFERENCE_FRAMES, GRASP_FRAMES = 20, 8
_PAIRED = 0.004  # [s]; images further apart than this are not of one time
# as seed_ros.images.arrays reads them live, which needs ROS: number and unit of depth [m], of brightness [counts]
_DEPTH = {"32FC1": ("f4", 1.0), "16UC1": ("u2", 1e-3), "mono16": ("u2", 1e-3)}
_GREY = {"mono16": ("u2", 1.0), "16UC1": ("u2", 1.0), "mono8": ("u1", 1.0), "8UC1": ("u1", 1.0), "32FC1": ("f4", 1.0)}


class BagDataError(SeedError):
    """A bag without what a validation needs."""


@dataclass
class _Content:
    """What was read: images by stream and stamp, cameras, and the truth (None where nothing is held)."""

    images: dict[str, dict[float, Any]] = field(default_factory=dict)
    cameras: dict[str, PinholeCamera] = field(default_factory=dict)
    truth: list[tuple[float, Array | None]] = field(default_factory=list)


def run_bag(path: Path, method: str, scenario: Scenario) -> Series:
    """Truth and estimates over the bag; hand and settings of the estimator are the scenario's.

    Raises:
        BagDataError: no readable bag, or images, camera_info, truth or the grasp are missing in it.
    """
    cv2.setNumThreads(1)
    content = _read(path)
    frames = _paired(content)
    grasp = next((t for t, X in content.truth if X is not None), None)
    if grasp is None:
        raise BagDataError(f"{path}: the true pose is never valid: no tool was held while this was recorded")
    still = [f for f in frames if next(iter(f.values())).stamp < grasp][-REFERENCE_FRAMES:]
    held = [f for f in frames if next(iter(f.values())).stamp >= grasp]
    if not still or len(held) <= GRASP_FRAMES:
        raise BagDataError(
            f"{path}: {len(still)} pairs of images before the grasp and {len(held)} after it; a reference without "
            f"contact and more than {GRASP_FRAMES} pairs of a grasped tool are needed"
        )
    given = {**scenario.estimator, "method": method}
    estimator = Estimator(from_mapping(given, EstimatorParameters), scenario.hand, content.cameras)
    estimator.capture_reference(still)
    estimator.initialize_grasp(held[:GRASP_FRAMES])
    return _follow(estimator, held[GRASP_FRAMES:], content.truth, next(iter(held[GRASP_FRAMES - 1].values())).stamp)


def _follow(estimator: Estimator, frames: list[dict[str, TactileImages]], truth: Any, start: float) -> Series:
    series = Series()
    times = [t for t, X in truth if X is not None]
    held = [X for _, X in truth if X is not None]
    X_grasp = _at(start, times, held)
    for images in frames:
        stamp = max(i.stamp for i in images.values())
        before = time.process_time()
        estimate = estimator.update(images, stamp)
        cpu = 1e3 * (time.process_time() - before)
        series.add(_at(stamp, times, held) @ inverse_pose(X_grasp), estimate, cpu)
    return series


def _at(t: float, times: list[float], poses: list[Array]) -> Array:
    """The truth at time t, interpolated."""
    i = bisect_left(times, t)
    if i == 0 or i == len(times):
        return poses[min(i, len(poses) - 1)]
    share = (t - times[i - 1]) / max(times[i] - times[i - 1], 1e-9)
    return interpolate_pose(poses[i - 1], poses[i], share)


def _paired(content: _Content) -> list[dict[str, TactileImages]]:
    """Images of all streams that were taken at one time."""
    out = []
    first = f"{next(iter(content.cameras))}/depth"
    others = {k: sorted(v) for k, v in content.images.items()}
    for stamp in others[first]:
        pair = {k: _nearest(v, stamp) for k, v in others.items()}
        if any(t is None for t in pair.values()):
            continue
        images = {k: content.images[k][t] for k, t in pair.items() if t is not None}
        out.append({
            f: TactileImages(images[f"{f}/depth"], images[f"{f}/ir"], float(pair[f"{f}/depth"] or 0.0))
            for f in content.cameras
        })  # fmt: skip
    return out


def _nearest(stamps: list[float], t: float) -> float | None:
    i = bisect_left(stamps, t)
    near = min(stamps[max(0, i - 1) : i + 1], key=lambda s: abs(s - t), default=None)
    return near if near is not None and abs(near - t) <= _PAIRED else None


def _read(path: Path) -> _Content:
    from rosbags.highlevel import AnyReader, AnyReaderError

    content = _Content()
    try:
        with AnyReader([path]) as reader:
            for connection, _, data in reader.messages():
                _take(content, connection.topic, lambda c=connection, d=data: reader.deserialize(d, c.msgtype))
    except (AnyReaderError, OSError) as error:
        raise BagDataError(f"{path}: not a readable bag: {error}") from error
    whole = [f for f in FINGERS if {f"{f}/depth", f"{f}/ir"} <= content.images.keys()]
    fingers = [f for f in whole if f in content.cameras]
    if not fingers or not content.truth:
        raise BagDataError(
            f"{path}: needs bubble_left or bubble_right with depth/image_rect_raw, ir/image_rect_raw and "
            f"depth/camera_info, and {TRUTH}; record with all topics"
        )
    content.cameras = {f: content.cameras[f] for f in fingers}
    content.images = {k: v for k, v in content.images.items() if k.split("/")[0] in fingers}
    return content


def _take(content: _Content, topic: str, message: Any) -> None:
    """Keeps one message when its topic is of use."""
    if topic.endswith(TRUTH):
        m = message()
        p, q = m.pose.pose.position, m.pose.pose.orientation
        X = make_pose(Rotation.from_quat((q.x, q.y, q.z, q.w)).as_matrix(), (p.x, p.y, p.z)) if m.valid else None
        content.truth.append((_stamp(m), X))
        return
    finger = next((f for f in FINGERS if f"bubble_{f}/" in topic), None)
    if finger is None:
        return
    if topic.endswith("depth/camera_info"):
        m = message()
        content.cameras[finger] = PinholeCamera.from_info(m.width, m.height, list(m.k), list(m.d), m.distortion_model)
    elif topic.endswith("/image_rect_raw"):
        kind = "depth" if "/depth/" in topic else "ir"
        m = message()
        content.images.setdefault(f"{finger}/{kind}", {})[_stamp(m)] = _image(m, topic)


def _stamp(message: Any) -> float:
    return float(message.header.stamp.sec) + 1e-9 * float(message.header.stamp.nanosec)


def _image(message: Any, topic: str) -> np.ndarray:
    """(H, W) float32: depth in metres with NaN where there is none, or counts."""
    depth = "/depth/" in topic
    known = _DEPTH if depth else _GREY
    if message.encoding not in known:
        raise BagDataError(f"{topic}: encoding '{message.encoding}' is not read; known: {', '.join(known)}")
    kind, scale = known[message.encoding]
    order = ">" if message.is_bigendian else "<"
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
    width = message.width * np.dtype(kind).itemsize
    values = np.ascontiguousarray(rows[:, :width]).view(order + kind).astype(np.float32) * np.float32(scale)
    if depth:
        values[~((values > 0.0) & (values < np.inf))] = np.nan
    return np.ascontiguousarray(values)

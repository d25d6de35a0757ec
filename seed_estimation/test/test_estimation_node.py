# SPDX-License-Identifier: Apache-2.0
"""The estimator as a real node on rendered images: poses that are true, and a reason for whatever is not good."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from seed_msgs.msg import ContactPatches, RelativePose
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from seed_core.hand import Hand
from seed_core.spatial import pose_from_rpy, rotation_error
from seed_estimation.images import TactileImages
from seed_estimation.node import EstimatorNode
from seed_ros.cameras import Intrinsics, camera_info
from seed_ros.conversions import pose_to_matrix
from seed_ros.images import image_message
from seed_ros.qos import COMMAND, SENSOR
from seed_ros.testing import Bench

pytestmark = pytest.mark.ros
tactile = pytest.importorskip("seed_sim.tactile", reason="needs the renderer of seed_sim")

PERIOD = 0.04  # [s] between two pictures: leaves time to a busy test machine


@pytest.fixture(scope="module")
def renderer() -> Any:
    return tactile.TactileRenderer(tactile.TactileParameters(), Hand(), seed=4)


class Rig:
    """Two cameras, the estimator and its listeners."""

    def __init__(self, bench: Bench, renderer: Any, **parameters: Any) -> None:
        self.bench, self.renderer = bench, renderer
        self.node = bench.add(EstimatorNode, **parameters)
        self.poses: list[RelativePose] = []
        self.patches: list[ContactPatches] = []
        client = bench.client
        client.create_subscription(RelativePose, "relative_pose", self.poses.append, COMMAND)
        client.create_subscription(ContactPatches, "contact_patches", self.patches.append, COMMAND)
        topics = {"depth": Image, "ir": Image}
        self.streams = {
            (f, k): client.create_publisher(kind, f"bubble_{f}/{k}/image_rect_raw", SENSOR)
            for f in ("left", "right")
            for k, kind in topics.items()
        }
        self.infos = {
            f: client.create_publisher(CameraInfo, f"bubble_{f}/depth/camera_info", SENSOR) for f in ("left", "right")
        }
        self.X_CT: np.ndarray | None = None
        self.hooks: list[Any] = []  # each may change or drop (return None) a message (finger, kind, message)
        self.with_info = True
        self._next = 0.0
        bench.every.append(self._shoot)
        assert bench.until(lambda: all(s.get_subscription_count() for s in self.streams.values() if self._used(s)))

    def _used(self, stream: Any) -> bool:
        fingers = self.node.inputs.fingers
        return any(f"bubble_{f}" in stream.topic_name for f in fingers)

    def now(self) -> float:
        return self.bench.client.get_clock().now().nanoseconds * 1e-9

    def _shoot(self) -> None:
        t = self.now()
        if t < self._next:
            return
        self._next = t + PERIOD
        images = self.renderer.no_contact(t) if self.X_CT is None else self.renderer.render(self.X_CT, t)
        for finger, pair in images.items():
            self._send(finger, pair, t)

    def _send(self, finger: str, pair: TactileImages, t: float) -> None:
        camera = self.renderer.cameras[finger]
        values = Intrinsics(camera.width, camera.height, list(camera.K.ravel()), list(camera.D), camera.model)
        if self.with_info:
            self.infos[finger].publish(camera_info(values, t, f"bubble_{finger}_optical"))
        for kind, data, encoding in (("depth", pair.depth, "32FC1"), ("ir", pair.ir, "mono16")):
            array = data if kind == "depth" else np.clip(np.rint(data), 0, 65535).astype(np.uint16)
            message: Any = image_message(array, encoding, t, f"bubble_{finger}_optical")
            for hook in self.hooks:
                message = hook(finger, kind, message) if message is not None else None
            if message is not None:
                self.streams[finger, kind].publish(message)

    def call(self, name: str) -> Any:
        return self.bench.call(Trigger, f"estimator/{name}", Trigger.Request())

    def grasped(self) -> Rig:
        reference = self.call("capture_reference")
        assert reference.success, reference.message
        self.X_CT = np.eye(4)
        self.bench.spin(0.3)
        grasp = self.call("initialize_grasp")
        assert grasp.success, grasp.message
        assert self.bench.until(lambda: self.poses and self.poses[-1].valid)
        return self

    def reason(self, words: str) -> bool:
        """Whether an invalid estimate with these words comes."""
        self.poses.clear()
        return self.bench.until(lambda: any(not p.valid and words in p.reason for p in self.poses), 20.0)


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    try:
        yield bench
    finally:
        bench.close()


QUICK = {"reference_frames": 6, "grasp_frames": 4, "max_gap": 5.0}


def test_a_moved_tool_is_found_where_it_is_with_the_stamp_of_its_images(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, **QUICK).grasped()
    X = pose_from_rpy(np.deg2rad([2.0, 4.0, -2.0]), [0.0005, 0.0003, 0.002])
    for share in np.linspace(0.1, 1.0, 10):
        rig.X_CT = pose_from_rpy(share * np.deg2rad([2.0, 4.0, -2.0]), share * X[:3, 3])
        bench.spin(2.5 * PERIOD)
    rig.poses.clear()
    assert bench.until(lambda: len(rig.poses) > 5)
    last = rig.poses[-1]
    assert last.valid, last.reason
    error = pose_to_matrix(last.pose.pose)
    assert np.abs(error[:3, 3] - X[:3, 3]).max() < 4e-4  # [m]
    assert np.rad2deg(np.linalg.norm(rotation_error(error[:3, :3], X[:3, :3]))) < 1.5
    assert (last.header.frame_id, last.child_frame_id) == ("compliance", "tool")
    assert 0.0 < rig.now() - (last.header.stamp.sec + 1e-9 * last.header.stamp.nanosec) < 5.0
    assert all(p.in_contact for p in rig.patches[-1].patches)


def test_without_a_reference_or_a_grasp_it_says_so(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, **QUICK)
    assert rig.reason("no reference")
    early = rig.call("initialize_grasp")
    assert not early.success
    assert "no reference" in early.message
    assert rig.call("capture_reference").success
    assert rig.reason("no grasp")
    empty = rig.call("initialize_grasp")  # the bubbles touch nothing
    assert not empty.success
    assert "touches nothing" in empty.message


def test_without_camera_info_it_says_what_is_missing(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, **QUICK)
    rig.with_info = False
    assert rig.reason("no message on bubble_left/depth/camera_info yet")


def cropped(finger: str, kind: str, message: Image) -> Image:
    if (finger, kind) == ("left", "depth"):
        message.height -= 10
        message.data = message.data[: message.height * message.step]
    return message


def coloured(finger: str, kind: str, message: Image) -> Image:
    if (finger, kind) != ("right", "depth"):
        return message
    picture = np.zeros((message.height, message.width, 3), dtype=np.uint8)
    out = image_message(picture, "rgb8", 0.0, "x")
    out.header = message.header
    return out


def blank(finger: str, kind: str, message: Image) -> Image:
    if (finger, kind) == ("left", "depth"):
        message.data = np.full(message.height * message.width, np.nan, np.float32).tobytes()
    return message


def saturated(finger: str, kind: str, message: Image) -> Image:
    if (finger, kind) == ("right", "ir"):
        message.data = b"\xff" * len(message.data)
    return message


def truncated(finger: str, kind: str, message: Image) -> Image:
    if (finger, kind) == ("left", "ir"):
        message.data = message.data[:-7]
    return message


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (cropped, "image of 224 x 161 pixels; camera_info says 224 x 171"),
        (coloured, "switch the colorizer of the camera driver off"),
        (blank, "only 0% of the depth image"),
        (saturated, "saturated"),
        (truncated, "contradict 224 x 171 mono16"),
    ],
    ids=lambda v: getattr(v, "__name__", ""),
)
def test_bad_images_give_a_reason_and_are_counted_and_good_ones_go_on(
    bench: Bench, renderer: Any, spoil: Any, words: str
) -> None:
    rig = Rig(bench, renderer, **QUICK).grasped()
    rig.hooks.append(spoil)
    assert rig.reason(words), [p.reason for p in rig.poses[-3:]]
    assert rig.node.complaints.total() > 0
    rig.hooks.clear()
    assert bench.until(lambda: rig.poses[-1].valid)


def test_a_silent_camera_is_named_and_the_rest_goes_on_when_it_is_back(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, **QUICK).grasped()
    rig.hooks.append(lambda finger, _, message: None if finger == "right" else message)
    assert rig.reason("no image of the right finger")
    rig.hooks.clear()
    assert bench.until(lambda: rig.poses[-1].valid)


def test_one_finger_alone_works_when_it_is_configured(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, fingers="left", **QUICK).grasped()
    assert rig.poses[-1].valid
    assert [p.finger for p in rig.patches[-1].patches] == ["left"]


def test_the_method_changes_live_and_nonsense_is_refused(bench: Bench, renderer: Any) -> None:
    from rclpy.parameter import Parameter

    rig = Rig(bench, renderer, **QUICK).grasped()
    refused = rig.node.set_parameters([Parameter("threshold", value=5.0)])[0]
    assert not refused.successful
    assert "threshold = 5 m must be within" in refused.reason
    assert rig.node.set_parameters([Parameter("method", value="published")])[0].successful
    assert rig.reason("no grasp")
    assert rig.call("initialize_grasp").success
    assert bench.until(lambda: rig.poses[-1].valid and rig.poses[-1].method == "published")

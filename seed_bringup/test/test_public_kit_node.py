# SPDX-License-Identifier: Apache-2.0
"""The topics of the public soft-bubble kit reach the estimator by launch arguments alone."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("seed_sim.tactile", reason="needs the renderer of seed_sim")

from seed_msgs.msg import ContactPatches, RelativePose
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from seed_core.hand import Hand
from seed_ros.conversions import stamp_from_seconds
from seed_ros.images import Intrinsics, camera_info
from seed_ros.images.arrays import image_message
from seed_ros.qos import COMMAND, SENSOR
from seed_ros.testing import Bench
from seed_sim import tactile

pytestmark = pytest.mark.ros

BUBBLES = {"left": "/bubble_1", "right": "/bubble_2"}
CAMERA = Path(__file__).resolve().parents[1] / "config" / "camera_d405.yaml"
PERIOD = 0.1  # [s]: two images of 640 x 480 each, on a busy machine


@pytest.fixture
def launched() -> Iterator[subprocess.Popen[bytes]]:
    prefixes = [f"{finger}_bubble:={prefix}" for finger, prefix in BUBBLES.items()]
    command = [sys.executable, "-P", "-m", "seed_bringup.commands.dispatch", "launch", "perception", *prefixes]
    process = subprocess.Popen([*command, "brightness:=infra1", f"camera_file:={CAMERA}"])
    try:
        yield process
    finally:
        process.terminate()
        process.wait(20.0)


class Kit:
    """The kit's cameras by realsense2_camera: depth in whole millimetres, left imager, camera_info; the kit's names."""

    def __init__(self, bench: Bench) -> None:
        renderer = tactile.TactileRenderer(tactile.TactileParameters(camera="d405"), Hand(), seed=5)
        self.bench = bench
        self.free = [messages(renderer, renderer.no_contact(0.0)) for _ in range(3)]
        self.held = [messages(renderer, renderer.render(np.eye(4), 0.0)) for _ in range(3)]
        self.images, self.shots, self._next = self.free, 0, 0.0
        self.streams = {
            (finger, kind): bench.client.create_publisher(message, f"{prefix}/{topic}", SENSOR)
            for finger, prefix in BUBBLES.items()
            for kind, message, topic in (
                ("depth", Image, "depth/image_rect_raw"),
                ("infra1", Image, "infra1/image_rect_raw"),
                ("info", CameraInfo, "depth/camera_info"),
            )
        }
        bench.every.append(self._shoot)

    def _shoot(self) -> None:
        t = self.bench.client.get_clock().now().nanoseconds * 1e-9
        if t < self._next:
            return
        self._next, self.shots = t + PERIOD, self.shots + 1
        for stream, message in self.images[self.shots % len(self.images)].items():
            message.header.stamp = stamp_from_seconds(t)
            self.streams[stream].publish(message)


def messages(renderer: Any, images: Any) -> dict[tuple[str, str], Any]:
    """What comes from its cameras at one time."""
    out: dict[tuple[str, str], Any] = {}
    for finger, pair in images.items():
        c = renderer.cameras[finger]
        intrinsics = Intrinsics(c.width, c.height, list(c.K.ravel()), list(c.D), c.model)
        depth = np.nan_to_num(1e3 * pair.depth, nan=0.0, posinf=0.0).clip(0, 65535).astype(np.uint16)
        grey = np.clip(0.18 * pair.ir, 0, 255).astype(np.uint8)
        out[finger, "info"] = camera_info(intrinsics, 0.0, "camera")
        out[finger, "depth"] = image_message(depth, "16UC1", 0.0, "camera")
        out[finger, "infra1"] = image_message(grey, "mono8", 0.0, "camera")
    return out


def test_the_kits_topics_give_a_pose_by_launch_arguments_alone(bench: Bench, launched: subprocess.Popen[bytes]) -> None:
    poses: list[RelativePose] = []
    patches: list[ContactPatches] = []
    bench.client.create_subscription(RelativePose, "relative_pose", poses.append, COMMAND)
    bench.client.create_subscription(ContactPatches, "contact_patches", patches.append, COMMAND)
    kit = Kit(bench)
    assert bench.until(lambda: poses, 60.0), f"no answer; the launch ended with {launched.poll()}"
    reference = bench.call(Trigger, "estimator/capture_reference", Trigger.Request())
    assert reference.success, reference.message
    kit.images = kit.held
    bench.spin(3 * PERIOD)
    grasp = bench.call(Trigger, "estimator/initialize_grasp", Trigger.Request())
    assert grasp.success, grasp.message
    assert bench.until(lambda: poses[-1].valid), poses[-1].reason
    assert [p.in_contact for p in patches[-1].patches] == [True, True]
    assert np.abs((poses[-1].pose.pose.position.x, poses[-1].pose.pose.position.z)).max() < 1e-3
    assert "unverified" in poses[-1].reason  # the kit's frame_ids tell nothing

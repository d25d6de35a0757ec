# SPDX-License-Identifier: Apache-2.0
"""The node of the RealSense cameras, on the library's own software devices."""

import time
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import CameraInfo, Image

from seed_core.errors import SeedError
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.realsense import library
from seed_estimation.ros.cameras import CamerasNode
from seed_ros.conversions import seconds
from seed_ros.images import depth_from_message, gray_from_message
from seed_ros.qos import SENSOR
from seed_ros.testing import Bench

try:
    library()
except SeedError as missing:
    pytest.skip(str(missing), allow_module_level=True)

from seed_estimation.realsense.software import SoftwareCamera

pytestmark = pytest.mark.ros
LENS = PinholeCamera(64, 64, np.array(((60.0, 0.0, 32.0), (0.0, 61.0, 31.0), (0.0, 0.0, 1.0))))


def test_images_of_both_cameras_arrive_as_exposed_and_a_lost_camera_is_told_and_comes_back() -> None:
    shelf = {"left": SoftwareCamera("100", LENS), "right": SoftwareCamera("200", LENS)}
    there = dict(shelf)
    bench = Bench()
    try:
        bench.add(
            lambda **how: CamerasNode(find=lambda: [c.device for c in there.values()], **how),
            left="100",
            width=64,
            height=64,
            silence=0.4,
        )
        got: dict[str, Any] = {}
        health: list[Any] = []
        for finger in shelf:
            for name, kind, topic in (
                ("depth", Image, "depth/image_rect_raw"),
                ("ir", Image, "ir/image_rect_raw"),
                ("info", CameraInfo, "depth/camera_info"),
            ):
                key = f"{finger}_{name}"
                bench.client.create_subscription(
                    kind, f"bubble_{finger}/{topic}", lambda m, key=key: got.update({key: m}), SENSOR
                )
        bench.client.create_subscription(DiagnosticArray, "/diagnostics", lambda m: health.append(m.status[0]), 10)
        shown = {"left": np.full((64, 64), 0.0801), "right": np.full((64, 64), 0.0902)}
        due = 0.0

        def expose() -> None:
            nonlocal due
            if time.monotonic() > due:
                due = time.monotonic() + 0.03
                for finger, camera in there.items():
                    camera.show(shown[finger], np.full((64, 64), 90), time.time())

        bench.every.append(expose)
        assert bench.until(lambda: len(got) == 6, 10.0)
        for finger, depth in shown.items():
            image = got[f"{finger}_depth"]
            assert image.header.frame_id == f"bubble_{finger}_optical"
            assert np.abs(depth_from_message(image) - depth).max() < 1e-6  # [m]
            assert np.all(gray_from_message(got[f"{finger}_ir"]) == 90)
            assert abs(seconds(image.header.stamp) - time.time()) < 5.0
            assert list(got[f"{finger}_info"].k) == list(LENS.K.ravel())

        def told() -> dict[str, str]:
            return {v.key: v.value for v in health[-1].values} if health else {}

        assert bench.until(lambda: bool(health), 10.0)
        before = int(told()["right_reconnections"])
        del there["right"]
        assert bench.until(lambda: "camera 200 is not there; connected: 100" in told().get("reason", ""), 10.0)
        there["right"] = shelf["right"]
        got.clear()
        assert bench.until(lambda: len(got) == 6, 10.0)
        assert bench.until(lambda: int(told()["right_reconnections"]) > before and not told()["reason"], 10.0)
        assert told()["left_depth_unit_mm"] == "0.1"
        assert told()["left_clock"] == "global_time"
    finally:
        bench.close()

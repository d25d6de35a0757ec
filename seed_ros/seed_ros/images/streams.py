# SPDX-License-Identifier: Apache-2.0
"""The image streams of one finger's camera: their topics, and publishers for a camera of our own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image

from seed_ros.conversions import stamp_from_seconds
from seed_ros.images.camera_info import Intrinsics, camera_info
from seed_ros.images.serialized import ImageWriter
from seed_ros.node import SeedNode
from seed_ros.qos import SENSOR

IMAGES = {"depth": "depth/image_rect_raw", "ir": "ir/image_rect_raw"}  # topics below bubble_left/ and bubble_right/
INFO = "depth/camera_info"


class CameraPublisher:
    """Publishes depth and infrared images of a finger, and the calibration of both."""

    def __init__(self, node: SeedNode, finger: str, frame_id: str, intrinsics: Intrinsics) -> None:
        """finger: 'left' or 'right'; frame_id: of the optical frame."""
        depth, ir = (node.publisher(Image, f"bubble_{finger}/{topic}", SENSOR) for topic in IMAGES.values())
        self._depth, self._ir = ImageWriter(depth, "32FC1", frame_id), ImageWriter(ir, "mono16", frame_id)
        self._info = node.publisher(CameraInfo, f"bubble_{finger}/{INFO}", SENSOR)
        self._calibration = camera_info(intrinsics, 0.0, frame_id)

    def publish(self, depth: NDArray[np.float32], ir: NDArray[np.floating], t: float) -> None:
        """Publish depth (H, W) [m] and infrared (H, W) [counts], whole numbers, taken at t [s]."""
        self._calibration.header.stamp = stamp_from_seconds(t)
        self._info.publish(self._calibration)
        self._depth.publish(depth, t)
        self._ir.publish(ir.astype(np.uint16), t)

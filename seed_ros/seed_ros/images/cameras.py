# SPDX-License-Identifier: Apache-2.0
"""A finger's camera: topics of its streams, calibration from and to what cores know, a publisher for one of our own."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image

from seed_ros.conversions import stamp_from_seconds, stamped
from seed_ros.images.serialized import ImageWriter
from seed_ros.node import SeedNode
from seed_ros.qos import SENSOR

IMAGES = {"depth": "depth/image_rect_raw", "ir": "ir/image_rect_raw"}  # topics below bubble_left/ and bubble_right/
INFO = "depth/camera_info"
# Names of the stream that tells brightness. infra1 is realsense2_camera's left imager, rectified and on depth's pixels;
# its colour is neither, and on color/image_raw since 4.57.4 (realsense-ros, pull request 3437; librealsense 13721).
BRIGHTNESS = ("ir", "infra1", "color")


class Intrinsics(NamedTuple):
    """Arguments of a camera model's constructor."""

    width: int
    height: int
    k: Sequence[float]
    d: Sequence[float]
    model: str


def intrinsics(message: CameraInfo, rectified: bool) -> Intrinsics:
    """Of the stream that goes with the message.

    A rectified stream has no distortion, whatever D says of the raw one, and P's left block for K (REP-104).
    """
    if not rectified:
        return Intrinsics(message.width, message.height, list(message.k), list(message.d), message.distortion_model)
    p = list(message.p)
    k = [*p[0:3], *p[4:7], *p[8:11]] if p[0] > 0.0 else list(message.k)
    return Intrinsics(message.width, message.height, k, [], "plumb_bob")


def camera_info(values: Intrinsics, t: float, frame_id: str) -> CameraInfo:
    """CameraInfo at t [s] of a camera without rectification of its own: P is K, R the identity."""
    k = [float(v) for v in values.k]
    message = stamped(CameraInfo, t, frame_id)
    message.width, message.height, message.distortion_model = values.width, values.height, values.model or "plumb_bob"
    message.k = k
    message.d = [float(v) for v in values.d]
    message.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    message.p = [*k[0:3], 0.0, *k[3:6], 0.0, *k[6:9], 0.0]
    return message


class CameraPublisher:
    """Publishes depth and infrared images of a finger, and the calibration of both."""

    def __init__(
        self, node: SeedNode, finger: str, frame_id: str, intrinsics: Intrinsics | None = None, ir: str = "mono16"
    ) -> None:
        """A publisher of one finger.

        Args:
            finger: 'left' or 'right'.
            frame_id: of the optical frame.
            intrinsics: of both images; where they are not known yet, `calibrate` comes before the first images.
            ir: encoding of infrared images, mono16 or mono8.
        """
        depth, gray = (node.publisher(Image, f"bubble_{finger}/{topic}", SENSOR) for topic in IMAGES.values())
        self._depth, self._ir = ImageWriter(depth, "32FC1", frame_id), ImageWriter(gray, ir, frame_id)
        self._kind = np.uint16 if ir == "mono16" else np.uint8
        self._info = node.publisher(CameraInfo, f"bubble_{finger}/{INFO}", SENSOR)
        self._frame_id = frame_id
        if intrinsics is not None:
            self.calibrate(intrinsics)

    def calibrate(self, intrinsics: Intrinsics) -> None:
        """The intrinsics of both images from now on."""
        self._calibration = camera_info(intrinsics, 0.0, self._frame_id)

    def publish(
        self, depth: NDArray[np.float32], ir: NDArray[np.floating] | NDArray[np.unsignedinteger], t: float
    ) -> None:
        """Publish depth (H, W) [m] and infrared (H, W) [counts], whole numbers, taken at t [s]."""
        self._calibration.header.stamp = stamp_from_seconds(t)
        self._info.publish(self._calibration)
        self._depth.publish(depth, t)
        self._ir.publish(ir.astype(self._kind, copy=False), t)

# SPDX-License-Identifier: Apache-2.0
"""Image streams: messages to arrays and back, calibration, pairing by stamp."""

from seed_ros.images.arrays import depth_from_message, full_pixel, gray_from_message, image_message, pixels_from_message
from seed_ros.images.cameras import BRIGHTNESS, IMAGES, INFO, CameraPublisher, Intrinsics, camera_info, intrinsics
from seed_ros.images.pairing import Pairing
from seed_ros.images.serialized import ImageWriter, SerializedImage, read_image

__all__ = [
    "BRIGHTNESS",
    "IMAGES",
    "INFO",
    "CameraPublisher",
    "ImageWriter",
    "Intrinsics",
    "Pairing",
    "SerializedImage",
    "camera_info",
    "depth_from_message",
    "full_pixel",
    "gray_from_message",
    "image_message",
    "intrinsics",
    "pixels_from_message",
    "read_image",
]

# SPDX-License-Identifier: Apache-2.0
"""The images of both bubbles as a client of a running cell takes them: paired by stamp, with their calibration."""

from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

from seed_core.errors import SeedError
from seed_estimation import PinholeCamera, TactileImages
from seed_ros.images import (
    IMAGES,
    INFO,
    Pairing,
    depth_from_message,
    full_pixel,
    gray_from_message,
    intrinsics,
    read_image,
)
from seed_ros.qos import SENSOR

ONE_FINGER, BOTH_FINGERS = 0.005, 0.025  # [s] between depth and brightness; between the fingers
LIVE = 8  # frames that are kept for a look

Frame = dict[str, TactileImages]  # images of one moment by finger


class TactileStreams:
    """Frames as they come.

    Attributes:
        cameras: by finger, once their calibration has come.
        recent: the newest frames.
        full: of a full pixel of brightness [counts], by the encoding; the larger one where the fingers' differ.
        problem: why the newest images were of no use, or ''.
        use: called with every frame.
    """

    def __init__(self, node: Node, prefixes: Mapping[str, str], brightness: str, rectified: bool) -> None:
        """Subscribe.

        Args:
            prefixes: of the topics, by finger.
            brightness: one of BRIGHTNESS.
            rectified: as the estimator's parameter.
        """
        self.cameras: dict[str, PinholeCamera] = {}
        self.recent: deque[Frame] = deque(maxlen=LIVE)
        self.full = 0.0
        self.use: Callable[[Frame], None] = lambda _: None
        self.problem, self._rectified = "", rectified
        self._one = {f: Pairing[Any](tuple(IMAGES), ONE_FINGER) for f in prefixes}
        self._both = Pairing[TactileImages](tuple(prefixes), BOTH_FINGERS)
        self.missing: dict[tuple[str, str], str] = {}  # topics on which nothing has come yet
        for finger, prefix in prefixes.items():
            topics = {
                "depth": f"{prefix}/{IMAGES['depth']}",
                "ir": f"{prefix}/{brightness}/image_rect_raw",
                "info": f"{prefix}/{INFO}",
            }
            self.missing |= {(finger, kind): topic for kind, topic in topics.items()}
            for kind in IMAGES:
                take = partial(self._on_image, finger, kind)
                node.create_subscription(Image, topics[kind], take, SENSOR, raw=True)
            node.create_subscription(CameraInfo, topics["info"], partial(self._on_info, finger), SENSOR)

    def _on_info(self, finger: str, message: CameraInfo) -> None:
        try:
            self.cameras[finger] = PinholeCamera.from_info(*intrinsics(message, self._rectified))
            self.missing.pop((finger, "info"), None)
        except SeedError as error:
            self.problem = f"{finger}: {error}"

    def _on_image(self, finger: str, kind: str, serialized: bytes) -> None:
        self.missing.pop((finger, kind), None)
        try:
            message = read_image(serialized)
            pair = self._one[finger].add(kind, message.stamp, message)
            if pair is None:
                return
            stamp, images = pair
            depth, ir = depth_from_message(images["depth"], finger), gray_from_message(images["ir"], finger)
            self.full = max(self.full, full_pixel(images["ir"].encoding))
        except SeedError as error:
            self.problem = f"{finger}: {error}"
            return
        self.problem = ""
        whole = self._both.add(finger, stamp, TactileImages(depth, ir, stamp))
        if whole is not None:
            self.recent.append(whole[1])
            self.use(whole[1])

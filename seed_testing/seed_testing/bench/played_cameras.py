# SPDX-License-Identifier: Apache-2.0
"""Cameras for ./seed bench node: pictures drawn beforehand, stamped and sent like those of real cameras.

Sending them costs what a camera's driver costs; drawing them, which real cameras do not need, is done before.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from seed_core.hand import Hand
from seed_core.spatial import Array, pose_from_rpy
from seed_estimation import TactileImages
from seed_ros.conversions import stamp_from_seconds
from seed_ros.frames import FrameNames
from seed_ros.images.camera_info import Intrinsics, camera_info
from seed_ros.images.serialized import ImageWriter
from seed_ros.loop import FixedRateLoop
from seed_ros.node import QUIET, run
from seed_ros.qos import SENSOR
from seed_sim.tactile import TactileParameters, TactileRenderer

RATE = 30.0  # [Hz]
LENGTH = 90  # pictures, played over and over
TURNS = np.array((1, 2, 3, 2, 1, 3))  # swings of roll, pitch, yaw, x, y, z within that
SWINGS = np.array((0.06, 0.06, 0.06, 0.002, 0.001, 0.002))  # [rad], [m]

Pictures = list[dict[str, TactileImages]]


def motion(i: int) -> Array:
    """The tool's pose (4, 4) in picture i; the last is followed by the first."""
    swing = SWINGS * np.sin(2.0 * np.pi * TURNS * i / LENGTH)
    return pose_from_rpy(swing[:3], swing[3:])


class PlayedCamerasNode(Node):
    """Shows untouched bubbles (~/release), a tool at rest (~/grasp), or one that moves (~/move)."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("cameras", **arguments)
        renderer = TactileRenderer(TactileParameters(), Hand(), 0)
        self._untouched = [renderer.no_contact(0.0) for _ in range(15)]
        self._still = [renderer.render(np.eye(4), 0.0) for _ in range(15)]
        self._moving = [renderer.render(motion(i), 0.0) for i in range(LENGTH)]
        self._shown, self._next = self._untouched, 0
        self._streams = {f: self._camera(f, renderer) for f in renderer.cameras}
        self.create_service(Trigger, "~/release", lambda _, response: self._show(self._untouched, response))
        self.create_service(Trigger, "~/grasp", lambda _, response: self._show(self._still, response))
        self.create_service(Trigger, "~/move", lambda _, response: self._show(self._moving, response))
        self.loop = FixedRateLoop(self, RATE, self._send)

    def _camera(self, finger: str, renderer: TactileRenderer) -> tuple[ImageWriter, ImageWriter, Any, CameraInfo]:
        frame, c = FrameNames().camera(finger), renderer.cameras[finger]
        depth, ir, info = (
            self.create_publisher(kind, f"bubble_{finger}/{name}", SENSOR, event_callbacks=QUIET)
            for kind, name in (
                (Image, "depth/image_rect_raw"),
                (Image, "ir/image_rect_raw"),
                (CameraInfo, "depth/camera_info"),
            )
        )
        message = camera_info(Intrinsics(c.width, c.height, list(c.K.ravel()), list(c.D), c.model), 0.0, frame)
        return ImageWriter(depth, "32FC1", frame), ImageWriter(ir, "mono16", frame), info, message

    def _show(self, pictures: Pictures, response: Trigger.Response) -> Trigger.Response:
        self._shown, self._next = pictures, 0
        response.success = True
        return response

    def _send(self) -> None:
        images = self._shown[self._next]
        self._next = (self._next + 1) % len(self._shown)
        for finger, (depth, ir, info, says) in self._streams.items():
            now = self.get_clock().now().nanoseconds * 1e-9
            says.header.stamp = stamp_from_seconds(now)
            info.publish(says)
            depth.publish(images[finger].depth, now)
            ir.publish(images[finger].ir.astype(np.uint16), now)


def main() -> None:
    """Run the node until it is interrupted."""
    sys.exit(run(PlayedCamerasNode))


if __name__ == "__main__":
    main()

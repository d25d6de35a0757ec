# SPDX-License-Identifier: Apache-2.0
"""Cameras for ./seed bench node: pictures drawn beforehand, stamped and sent like those of real cameras.

Sending them costs what a camera's driver costs; drawing them, which real cameras do not need, is done before.
"""

import sys
from typing import Any

import numpy as np
from std_srvs.srv import Trigger

from seed_core.hand import Hand
from seed_core.spatial import Array, pose_from_rpy
from seed_estimation import TactileImages
from seed_ros import FixedRateLoop, FrameNames, SeedNode
from seed_ros.images import CameraPublisher, Intrinsics
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


class PlayedCamerasNode(SeedNode):
    """Shows untouched bubbles (~/release), a tool at rest (~/grasp), or one that moves (~/move)."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("cameras", **arguments)
        renderer = TactileRenderer(TactileParameters(), Hand(), 0)
        self._untouched = [renderer.no_contact(0.0) for _ in range(15)]
        still = [renderer.render(np.eye(4), 0.0) for _ in range(15)]
        moving = [renderer.render(motion(i), 0.0) for i in range(LENGTH)]
        self._shown, self._next = self._untouched, 0
        self._cameras = {}
        for finger, c in renderer.cameras.items():
            intrinsics = Intrinsics(c.width, c.height, list(c.K.ravel()), list(c.D), c.model)
            self._cameras[finger] = CameraPublisher(self, finger, FrameNames().camera(finger), intrinsics)
        self.serve(Trigger, "~/release", lambda: self._show(self._untouched))
        self.serve(Trigger, "~/grasp", lambda: self._show(still))
        self.serve(Trigger, "~/move", lambda: self._show(moving))
        self.loop = FixedRateLoop(self, RATE, self._send)

    def _show(self, pictures: Pictures) -> str:
        self._shown, self._next = pictures, 0
        return ""

    def _send(self) -> None:
        images = self._shown[self._next]
        self._next = (self._next + 1) % len(self._shown)
        for finger, camera in self._cameras.items():
            camera.publish(images[finger].depth, images[finger].ir, self.now())


main = PlayedCamerasNode.main


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: Apache-2.0
"""The cameras inside the simulated bubbles, in a process of their own: the truth in, images out."""

from __future__ import annotations

import sys
import time
from collections import deque
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from rclpy.node import Node
from seed_msgs.msg import RelativePose
from sensor_msgs.msg import CameraInfo, Image

from seed_core.config import field
from seed_estimation import TactileImages
from seed_ros import diagnostics
from seed_ros.conversions import pose_to_matrix, seconds, stamp_from_seconds
from seed_ros.frames import FrameNames
from seed_ros.images.camera_info import Intrinsics, camera_info
from seed_ros.images.serialized import ImageWriter
from seed_ros.loop import FixedRateLoop
from seed_ros.node import QUIET, run
from seed_ros.parameters import declare, refuse_unknown
from seed_ros.qos import SENSOR
from seed_sim.scenario import load_scenario, tactile_of
from seed_sim.tactile import TactileRenderer

LOOP_RATE = 200.0  # [Hz] at which it is looked what is due
JUST_AFTER = 1e-4  # [s] after images are due: no clock is exact
STANDSTILL = 0.05  # [s] without a step of the clock: simulated time stands still


@dataclass(frozen=True)
class BubbleSettings:
    """Parameters of the simulated cameras."""

    scenario: str = field("nominal", doc="name or file of the scenario")
    seed: int = field(0, low=0, high=2**31 - 1, doc="of dots and noise")
    fingers: str = field("both", choices=("both", "left", "right"), doc="which bubbles have a camera")
    rate: float = field(0.0, unit="Hz", low=0.0, high=120.0, doc="of the cameras; 0: the scenario's")
    latency: float = field(
        0.02, unit="s", low=0.0, high=0.5, doc="least time from exposure to the message, as cameras have it"
    )


class BubblesNode(Node):
    """See docs/interfaces.md."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("bubbles", **arguments)
        cv2.setNumThreads(1)
        self.settings = declare(self, BubbleSettings())
        self.frames = declare(self, FrameNames(), "frames")
        refuse_unknown(self)
        scenario = load_scenario(self.settings.scenario)
        tactile = replace(tactile_of(scenario), fingers=self.settings.fingers)
        self.renderer = TactileRenderer(tactile, scenario.hand, self.settings.seed)
        self._shot = -np.inf
        self._ready: deque[tuple[str, TactileImages]] = deque()
        self._pairs_sent = self._late = 0
        self._stepped = (0.0, 0.0)  # the clock's last step, by itself and by a steady clock [s]
        self._streams = {f: self._finger_publishers(f) for f in self.renderer.cameras}
        self._infos = {f: self._camera_info(f) for f in self.renderer.cameras}
        self._period, self._next = 1.0 / (self.settings.rate or scenario.measurement.rate), 0.0
        self.loop = FixedRateLoop(self, LOOP_RATE, self._tick, steady=True, eager=True)
        self.loop.poll(RelativePose, "sim/ground_truth/relative_pose", self._on_truth, SENSOR)
        self._diagnostics = diagnostics.Diagnostics(self, tactile.camera, self._report)

    def _finger_publishers(self, finger: str) -> tuple[ImageWriter, ImageWriter, Any]:
        create, prefix, frame = (
            partial(self.create_publisher, event_callbacks=QUIET),
            f"bubble_{finger}",
            self.frames.camera(finger),
        )
        return (
            ImageWriter(create(Image, f"{prefix}/depth/image_rect_raw", SENSOR), "32FC1", frame),
            ImageWriter(create(Image, f"{prefix}/ir/image_rect_raw", SENSOR), "mono16", frame),
            create(CameraInfo, f"{prefix}/depth/camera_info", SENSOR),
        )

    def _camera_info(self, finger: str) -> CameraInfo:
        c = self.renderer.cameras[finger]
        values = Intrinsics(c.width, c.height, list(c.K.ravel()), list(c.D), c.model)
        return camera_info(values, 0.0, self.frames.camera(finger))

    def _on_truth(self, message: RelativePose) -> None:
        """Expose when it is time: the images carry the stamp of the truth they show."""
        now, stamp = self._now(), seconds(message.header.stamp)
        if now < self._next or stamp == self._shot:
            return
        self._next, self._shot = max(self._next + self._period, now - self._period), stamp
        X_CT = pose_to_matrix(message.pose.pose) if message.valid else None
        for finger in self.renderer.fingers:  # one is on its way while the next is drawn, as with two cameras
            self._ready.append((finger, self.renderer.finger(finger, X_CT, stamp)))
            self._stepped = now, time.monotonic()
            self._deliver(self._now())
        self.loop.also_at(time.monotonic() + self.settings.latency - (self._now() - stamp) + JUST_AFTER)

    def _now(self) -> float:
        return float(self.get_clock().now().nanoseconds * 1e-9)

    def _tick(self) -> None:
        now = self._now()
        if now != self._stepped[0]:
            self._stepped = now, time.monotonic()
        self._deliver(now)

    def _deliver(self, now: float) -> None:
        awaited = time.monotonic() - self._stepped[1] > STANDSTILL  # time stands still for these images
        while self._ready and (awaited or now - self._ready[0][1].stamp >= self.settings.latency):
            finger, images = self._ready.popleft()
            self._pairs_sent += 1
            self._late += now - images.stamp > self.settings.latency + 0.01
            self._send(finger, images)

    def _send(self, finger: str, images: TactileImages) -> None:
        depth, ir, info = self._streams[finger]
        self._infos[finger].header.stamp = stamp_from_seconds(images.stamp)
        info.publish(self._infos[finger])
        depth.publish(images.depth, images.stamp)
        ir.publish(images.ir.astype(np.uint16), images.stamp)  # whole counts already

    def _report(self) -> diagnostics.Report:
        values = {"pairs": self._pairs_sent, "late": self._late}
        if self._shot == -np.inf:
            return diagnostics.STALE, "no ground truth from the simulation yet", values
        return diagnostics.OK, "exposing", values


def main() -> None:
    """Run the node until it is interrupted."""
    sys.exit(run(BubblesNode))


if __name__ == "__main__":
    main()

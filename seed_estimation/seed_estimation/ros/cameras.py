# SPDX-License-Identifier: Apache-2.0
"""The node `cameras`: two RealSense D405 to the topics that the estimator reads."""

import sys
from typing import Any

from seed_core.errors import SeedError
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.realsense import library
from seed_estimation.realsense.camera import Camera, Pictures
from seed_estimation.realsense.cameras import Cameras, Find
from seed_estimation.realsense.settings import RealSenseSettings
from seed_ros import FixedRateLoop, FrameNames, SeedNode, diagnostics
from seed_ros.images import CameraPublisher, Intrinsics
from seed_ros.node import run

LOOP_RATE = 200.0  # [Hz] at which it is looked whether images have come
FINE = 1.5e-4  # [m] a step of depth that is larger is worth a word


class CamerasNode(SeedNode):
    """See docs/interfaces.md."""

    def __init__(self, find: Find | None = None, **arguments: Any) -> None:
        """find: lists the library's devices that are there; by default recordings or what is on USB."""
        super().__init__("cameras", **arguments)
        self.settings = self.declare(RealSenseSettings())
        frames = self.declare(FrameNames(), "frames")
        self.refuse_unknown()
        self.cameras = Cameras(self.settings, find)
        self._outputs = {f: CameraPublisher(self, f, frames.camera(f), ir="mono8") for f in self.cameras.fingers}
        self._calibrated: dict[str, PinholeCamera] = {}  # that a finger's publisher knows
        self._ages = dict.fromkeys(self.cameras.fingers, 0.0)  # [s] of the newest images when they arrived
        self.loop = FixedRateLoop(self, LOOP_RATE, self._tick, steady=True, priority=self.settings.realtime_priority)
        self.diagnose("RealSense", self._report)
        self.cameras.start()

    def destroy_node(self) -> None:
        """Close the cameras first."""
        self.cameras.close()
        super().destroy_node()

    def _tick(self) -> None:
        self.cameras.take(self._publish)
        while self.cameras.events:
            self.counters.add(*self.cameras.events.popleft())

    def _publish(self, finger: str, camera: Camera, pictures: Pictures) -> None:
        c = camera.model
        if self._calibrated.get(finger) is not c:
            self._outputs[finger].calibrate(Intrinsics(c.width, c.height, list(c.K.ravel()), list(c.D), c.model))
            self._calibrated[finger] = c
            self.get_logger().info(
                f"{finger}: camera {camera.found}, firmware {camera.found.firmware}, {c.width} x {c.height}, depth in "
                f"steps of {1e3 * camera.depth_unit:g} mm"
            )
        self._outputs[finger].publish(pictures.depth, pictures.gray, pictures.stamp)
        self._ages[finger] = pictures.arrival - pictures.stamp
        self.beats.add(self._ages[finger])

    def _report(self) -> diagnostics.Report:
        values: dict[str, object] = {"lost": 0}
        wrong = [p for p in self.cameras.problems.values() if p]
        doubtful = []
        for finger in self.cameras.fingers:
            taken, lost = self.cameras.counts(finger)
            values["lost"] = int(str(values["lost"])) + lost
            own: dict[str, object] = {"images": taken, "lost": lost}
            own["reconnections"] = self.cameras.reconnections[finger]
            camera = self.cameras.camera(finger)
            if camera is not None:
                own |= {"serial": camera.found.serial, "firmware": camera.found.firmware, "usb": camera.found.usb}
                own |= {"clock": camera.dating.clock, "latency_ms": round(1e3 * self._ages[finger], 2)}
                own["depth_unit_mm"] = round(1e3 * camera.depth_unit, 4)
                coarse = f"depth comes in steps of {1e3 * camera.depth_unit:g} mm" if camera.depth_unit > FINE else ""
                doubtful += [f"{finger}: {words}" for words in (camera.doubts, coarse) if words]
            values |= {f"{finger}_{name}": value for name, value in own.items()}
        if wrong:
            return diagnostics.ERROR, "; ".join(dict.fromkeys(wrong)), values
        return (diagnostics.WARN, "; ".join(doubtful), values) if doubtful else (diagnostics.OK, "streaming", values)


def main() -> int:
    """Run the node; without the library it ends at once and says what to install."""
    try:
        library()
    except SeedError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return run(CamerasNode)

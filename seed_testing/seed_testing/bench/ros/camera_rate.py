# SPDX-License-Identifier: Apache-2.0
"""./seed bench cameras: the node of the RealSense cameras on software devices, 640 x 480 at 30 Hz, for ten minutes.

Counts what arrives in another process, what the node lost and what its process takes of a core (feeding the software
devices included), then unplugs a camera for two seconds and measures how long its images take to return.
"""

import json
import os
import subprocess
import sys
import time
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from std_srvs.srv import SetBool

from seed_bringup.launching.addresses import listening_as
from seed_core.errors import FailedError
from seed_core.hand import FINGERS
from seed_core.program.command_line import Parser, command, number
from seed_ros import FixedRateLoop
from seed_ros.images import IMAGES, read_image
from seed_testing.bench.driver import cpu_seconds
from seed_testing.figures import text

NODE = "seed_testing.bench.ros.software_cameras"
PATIENT = QoSProfile(depth=30, reliability=ReliabilityPolicy.BEST_EFFORT)  # counts all, and is in no hurry
STREAMS = tuple((f, k) for f in FINGERS for k in IMAGES)
GAP = 1.5  # [periods] between two stamps: an image is missing
AWAY = 2.0  # [s] that a camera is unplugged
RATE = 30.0  # [Hz]


class _Listener:
    """Stamps of the images of every stream, and the node's diagnostics."""

    def __init__(self) -> None:
        self.stamps: dict[tuple[str, str], list[float]] = {stream: [] for stream in STREAMS}
        self.ages: list[float] = []  # [s] on arrival
        self.told: dict[str, str] = {}
        self.context = Context()
        rclpy.init(args=[], context=self.context)
        self.node = Node("listener", context=self.context, start_parameter_services=False)
        self.loop = FixedRateLoop(
            self.node, 20.0, lambda: None, steady=True, eager=True, priority=20
        )  # as the estimator
        for finger, kind in STREAMS:
            self.loop.poll(
                Image,
                f"bubble_{finger}/{IMAGES[kind]}",
                lambda message, _, stream=(finger, kind): self._on_image(stream, message),
                PATIENT,
                raw=True,
            )
        self.loop.poll(DiagnosticArray, "/diagnostics", self._on_diagnostics, QoSProfile(depth=10))
        self._unplug = self.node.create_client(SetBool, "cameras/unplug")

    def close(self) -> None:
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    def _on_image(self, stream: tuple[str, str], message: bytes) -> None:
        stamp = read_image(message).stamp
        self.stamps[stream].append(stamp)
        self.ages.append(time.time() - stamp)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "/cameras":
                self.told = {v.key: v.value for v in status.values}

    def until(self, true: Any, patience: float, what: str = "") -> float:
        """Listen until `true()`, and tell how long that took [s]; FailedError when it never comes."""
        began = time.monotonic()
        self.loop.run(lambda: true() or time.monotonic() - began > patience)
        if what and not true():
            raise FailedError(f"{what} within {patience:g} s")
        return time.monotonic() - began

    def unplug(self, away: bool) -> None:
        """Take the right camera away, or bring it back."""
        self.until(self._unplug.service_is_ready, 20.0, "no service cameras/unplug")
        future = self._unplug.call_async(SetBool.Request(data=away))
        self.until(future.done, 10.0, "no answer of cameras/unplug")


def run(seconds: float = 600.0) -> dict[str, Any]:
    """Figures over `seconds`, then the time to return. Raises FailedError: no images."""
    environment = os.environ | listening_as("loopback_images.xml")
    process = subprocess.Popen([sys.executable, "-m", NODE], env=environment, stdout=subprocess.DEVNULL)
    listener = _Listener()
    try:
        listener.until(lambda: all(len(s) > RATE for s in listener.stamps.values()), 60.0, "no images")
        before = _taken(listener)
        for stamps in listener.stamps.values():
            stamps.clear()
        listener.ages.clear()
        cpu, began = cpu_seconds(process.pid), time.monotonic()
        listener.until(lambda: False, seconds)
        took = time.monotonic() - began
        share = (cpu_seconds(process.pid) - cpu) / took
        received = {stream: np.array(s) for stream, s in listener.stamps.items()}
        ages = np.array(listener.ages)
        lost = _taken(listener)[1] - before[1]
        returned = _return(listener)
    finally:
        listener.close()
        process.terminate()
        process.wait()
    gaps = [np.rint(np.diff(s) * RATE) - 1.0 for s in received.values()]
    return {
        "seconds": round(took, 1),
        "rate_hz": round(min((len(s) - 1) / float(s[-1] - s[0]) for s in received.values()), 2),
        "lost_by_the_node": lost,
        "missing_at_the_listener": int(sum(g[g > GAP - 1.0].sum() for g in gaps)),
        "received": int(sum(map(len, received.values()))),
        "core_share": round(share, 3),
        "age_p50_ms": round(1e3 * float(np.median(ages)), 2),
        "age_p99_ms": round(1e3 * float(np.quantile(ages, 0.99)), 2),
        "return_s": round(returned, 2),
    }


def _taken(listener: _Listener) -> tuple[int, int]:
    """Images and losses as the node counts them."""
    listener.told = {}
    listener.until(lambda: bool(listener.told), 10.0, "no diagnostics of the node")
    return int(listener.told["left_images"]) + int(listener.told["right_images"]), int(listener.told["lost"])


def _return(listener: _Listener) -> float:
    """From the moment that a camera is plugged in to its images [s]."""
    listener.unplug(True)
    listener.until(lambda: False, AWAY)
    listener.stamps["right", "depth"].clear()  # the last of before have come
    began = time.monotonic()
    listener.unplug(False)
    listener.until(lambda: bool(listener.stamps["right", "depth"]), 20.0, "no images of the camera that is back")
    return time.monotonic() - began


@command("seed bench cameras")
def main(argv: list[str]) -> int:
    """Command line; 0 when nothing was lost by the node and the camera returned within 3 s."""
    parser = Parser(prog="seed bench cameras", description=__doc__)
    parser.add_argument("--minutes", type=number(0.05, "minutes"), default=10.0, help="of images (default %(default)s)")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    options = parser.parse_args(argv)
    figures = run(60.0 * options.minutes)
    print(json.dumps(figures) if options.json else "\n".join(text(figures)))
    return int(figures["lost_by_the_node"] > 0 or figures["return_s"] > 3.0)

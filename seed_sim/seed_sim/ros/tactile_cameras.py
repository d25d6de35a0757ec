# SPDX-License-Identifier: Apache-2.0
"""The cameras inside the simulated bubbles, in a process of their own: the truth in, images out."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from seed_msgs.msg import RelativePose
from std_msgs.msg import Float64MultiArray

from seed_core.config import field
from seed_core.hand import FINGERS_OF
from seed_core.spatial import Array
from seed_estimation import TactileImages
from seed_ros import SENSOR, FixedRateLoop, FrameNames, SeedNode, diagnostics
from seed_ros.conversions import pose_to_matrix, seconds
from seed_ros.images import CameraPublisher, Intrinsics
from seed_sim.membrane import MembraneGrasp
from seed_sim.ros.membrane_message import TOPIC, membranes_from_message
from seed_sim.scenario import load_scenario, tactile_of
from seed_sim.tactile import MeshRenderer, TactileRenderer

LOOP_RATE = 200.0  # [Hz] at which it is looked what is due
JUST_AFTER = 1e-4  # [s] after images are due: no clock is exact
_SPARING = 0.7  # periods that lie between two exposures at least
STANDSTILL = 0.05  # [s] without a step of the clock: simulated time stands still


@dataclass(frozen=True)
class CameraSettings:
    """Parameters of the simulated cameras."""

    scenario: str = field("nominal", doc="name or file of the scenario")
    seed: int = field(0, low=0, high=2**31 - 1, doc="of dots and noise")
    fingers: str = field("both", choices=tuple(FINGERS_OF), doc="which bubbles have a camera")
    rate: float = field(0.0, unit="Hz", low=0.0, high=120.0, doc="of the cameras; 0: the scenario's")
    latency: float = field(
        0.02, unit="s", low=0.0, high=0.5, doc="least time from exposure to the message, as cameras have it"
    )
    realtime_priority: int = field(
        10, low=0, high=98, doc="SCHED_FIFO priority if allowed, below the simulated arm's; 0: none"
    )


class TactileCamerasNode(SeedNode):
    """See docs/interfaces.md."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("bubbles", **arguments)
        cv2.setNumThreads(1)
        self.settings = self.declare(CameraSettings())
        frames = self.declare(FrameNames(), "frames")
        self.refuse_unknown()

        scenario = load_scenario(self.settings.scenario)
        tactile = replace(tactile_of(scenario), fingers=self.settings.fingers)
        self.renderer: TactileRenderer | MeshRenderer
        if scenario.grasp.kind == "membrane":
            free = MembraneGrasp(scenario.membrane, scenario.tactile.tool).free()
            self._nodes = len(free["left"].nodes)
            self.renderer = MeshRenderer(tactile, scenario.hand, self.settings.seed, free)
        else:
            self.renderer = TactileRenderer(tactile, scenario.hand, self.settings.seed)
        self._period, self._next = 1.0 / (self.settings.rate or scenario.measurement.rate), 0.0
        self._exposed = -np.inf  # [s] stamp of the newest images
        self._ready: deque[tuple[str, TactileImages]] = deque()
        self._pairs_sent = self._late = 0
        self._stepped = (0.0, 0.0)  # the clock's last step, by itself and by a steady clock [s]

        self._cameras = {}
        for finger, c in self.renderer.cameras.items():
            intrinsics = Intrinsics(c.width, c.height, list(c.K.ravel()), list(c.D), c.model)
            self._cameras[finger] = CameraPublisher(self, finger, frames.camera(finger), intrinsics)
        priority = self.settings.realtime_priority
        self.loop = FixedRateLoop(self, LOOP_RATE, self._tick, steady=True, eager=True, priority=priority)
        if scenario.grasp.kind == "membrane":
            self.loop.poll(Float64MultiArray, f"sim/{TOPIC}", self._on_membranes, SENSOR)
        else:
            self.loop.poll(RelativePose, "sim/ground_truth/relative_pose", self._on_truth, SENSOR)
        self.diagnose(tactile.camera, self._report)

    def _on_truth(self, message: RelativePose) -> None:
        """Expose when it is time: the images carry the stamp of the truth they show."""
        now, stamp = self.now(), seconds(message.header.stamp)
        if now < self._next or stamp == self._exposed:
            return
        self._next = max(self._next + self._period, now - self._period)
        with self.counters.refusing("truths_refused"):
            X_CT = pose_to_matrix(message.pose.pose) if message.valid else None
            self._expose(now, stamp, lambda finger: self.renderer.finger(finger, X_CT, stamp))

    def _on_membranes(self, message: Float64MultiArray) -> None:
        """Expose at each solve, which comes at the camera's rate; more often only when the tool moves fast."""
        with self.counters.refusing("membranes_refused"):
            solved = membranes_from_message(message, self._nodes)
            if abs(solved.stamp - self._exposed) >= _SPARING * self._period:
                nodes: dict[str, Array | None] = {**solved.nodes} if solved.grasped else dict.fromkeys(solved.nodes)
                draw = self.renderer.finger
                self._expose(self.now(), solved.stamp, lambda finger: draw(finger, nodes[finger], solved.stamp))

    def _expose(self, now: float, stamp: float, draw: Callable[[str], TactileImages]) -> None:
        """Images at stamp [s] of every finger, from `draw`."""
        self._exposed = stamp
        for finger in self.renderer.fingers:  # one is on its way while the next is drawn, as with two cameras
            self._ready.append((finger, draw(finger)))
            self._stepped = now, time.monotonic()
            self._deliver(self.now())
        self.loop.also_at(time.monotonic() + self.settings.latency - (self.now() - stamp) + JUST_AFTER)

    def _tick(self) -> None:
        now = self.now()
        if now != self._stepped[0]:
            self._stepped = now, time.monotonic()
        self._deliver(now)

    def _deliver(self, now: float) -> None:
        stands_still = time.monotonic() - self._stepped[1] > STANDSTILL  # time waits for these images
        while self._ready and (stands_still or now - self._ready[0][1].stamp >= self.settings.latency):
            finger, images = self._ready.popleft()
            self._pairs_sent += 1
            self._late += now - images.stamp > self.settings.latency + 0.01
            self._cameras[finger].publish(images.depth, images.ir, images.stamp)
            self.beats.add(now - images.stamp)

    def _report(self) -> diagnostics.Report:
        values = {"pairs": self._pairs_sent, "late": self._late}
        if self._exposed == -np.inf:
            return diagnostics.STALE, "no ground truth from the simulation yet", values
        return diagnostics.OK, "exposing", values


main = TactileCamerasNode.main

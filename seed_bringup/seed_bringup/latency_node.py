# SPDX-License-Identifier: Apache-2.0
"""How old a tool's pose is when another process receives it, with the whole graph running: ./seed bench node.

The simulated cell plays a task by the wall's clock: simulation, cameras, estimator and controller, each a process. Two
ages are given. From the images' stamp: that is the time of the state of the simulation which they show, so rendering
counts, which no real camera does on this computer. From the sending of the images: what a camera's driver that stamps
images when it has them would see: the way of four images, pairing, the estimate, and the way of its message.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from seed_msgs.msg import RelativePose
from sensor_msgs.msg import CameraInfo

from seed_bringup.demo import live_rates
from seed_bringup.launcher import Launch
from seed_bringup.launching.packages import find_launch_file
from seed_bringup.showing.session_node import Session, SessionError
from seed_core.errors import SeedError
from seed_core.spatial import Array
from seed_ros.conversions import seconds
from seed_ros.qos import COMMAND, SENSOR

TASK_PATIENCE = 75.0  # [s]
STAGES = ("arrival", "latency")  # of the estimator's own diagnostics


class _Ages:
    """Listens, in this process, to what the estimator's publishes."""

    def __init__(self, session: Session) -> None:
        self.ages: list[tuple[float, float]] = []  # [s] of valid poses on arrival: since the stamp, since the sending
        self._sent: dict[float, float] = {}  # [s] when the images of a stamp were sent
        self.stages: dict[str, list[float]] = {}  # [ms] medians as the estimator reports them, second by second
        session.node.create_subscription(RelativePose, "relative_pose", self._on_pose, COMMAND)
        for finger in ("left", "right"):  # each finger's camera_info is sent right before its images
            session.node.create_subscription(CameraInfo, f"bubble_{finger}/depth/camera_info", self._on_info, SENSOR)
        session.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def _on_info(self, message: CameraInfo, info: Any) -> None:
        self._sent.setdefault(seconds(message.header.stamp), 1e-9 * info["source_timestamp"])

    def _on_pose(self, message: RelativePose) -> None:
        now, stamp = time.time(), seconds(message.header.stamp)
        if message.valid and stamp in self._sent:
            self.ages.append((now - stamp, now - self._sent[stamp]))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "/estimator":
                values = {v.key: v.value for v in status.values}
                for stage in STAGES:
                    if f"{stage}_p50_ms" in values:
                        self.stages.setdefault(stage, []).append(float(values[f"{stage}_p50_ms"]))


def run(task: str = "squeegee") -> dict[str, Any]:
    """Ages of the poses of a whole task [ms]: median and 99th percentile, and where the median goes.

    Raises:
        SeedError: the cell did not come up, or the task ended early.
    """
    camera_rate, loop_rate = live_rates()
    with tempfile.TemporaryDirectory() as folder:
        controller = Path(folder) / "controller.yaml"
        controller.write_text(yaml.safe_dump({"controller": {"ros__parameters": {"rate": loop_rate}}}))
        log = (Path(folder) / "nodes.log").open("w", encoding="utf-8")
        arguments = {
            "task": task,
            "controller_file": str(controller),
            "sim_rate": str(loop_rate),
            "camera_rate": str(camera_rate),
            "camera_latency": "0.0",
        }
        launch = Launch(find_launch_file(["cell"]), arguments, lambda label, line: print(f"[{label}] {line}", file=log))
        with log, launch:
            heard = _play(launch, task)
    if not heard.ages:
        raise SeedError("no valid pose arrived")
    return _summary(heard, camera_rate, loop_rate)


def _play(launch: Launch, task: str) -> _Ages:
    def watch() -> None:
        if launch.poll() is not None:
            raise SessionError("the cell ended early")

    session = Session(watch, follow=False)
    try:
        session.trigger("estimator/capture_reference", patience=40.0)
        session.trigger("sim/grasp", patience=40.0)
        session.spin(0.3)
        session.trigger("estimator/initialize_grasp")
        session.enable()
        heard = _Ages(session)
        played = session.play(task, "", lambda _: None, TASK_PATIENCE)
        if not played.result.success:
            raise SessionError(f"the task ended early: {played.result.message}")
    finally:
        session.close()
    return heard


def _summary(heard: _Ages, camera_rate: float, loop_rate: float) -> dict[str, Any]:
    since_stamp, since_sending = 1e3 * np.array(heard.ages).T
    published = {stage: float(np.median(heard.stages.get(stage, [np.nan]))) for stage in STAGES}
    rendering = float(np.median(since_stamp - since_sending))
    return {
        "from_stamp": _percentiles(since_stamp),
        "from_sending": _percentiles(since_sending),
        "of_the_median": {
            "rendering_ms": rendering,
            "way_of_the_images_ms": published["arrival"] - rendering,
            "estimate_ms": published["latency"] - published["arrival"],
            "way_of_the_pose_ms": float(np.median(since_stamp)) - published["latency"],
        },
        "poses": len(heard.ages),
        "camera_rate_hz": camera_rate or "the scenario's",
        "control_rate_hz": loop_rate,
        "cores": len(os.sched_getaffinity(0)),
    }


def _percentiles(ms: Array) -> dict[str, float]:
    median, p99 = np.percentile(ms, (50, 99))
    return {"median_ms": float(median), "p99_ms": float(p99)}

# SPDX-License-Identifier: Apache-2.0
"""Age of a tool's pose when another process receives it, with the whole graph running: ./seed bench node.

Twice, by the wall's clock, each node a process:
- `real`: the graph of a real cell: estimator, controller, driver, frames of the links. Its robot is the stand-in
  controller; its cameras send pictures that were drawn beforehand, and stamp them then, as a driver does on arrival.
- `simulated`: the simulated cell plays a task. The images' stamp is the time of the state that they show, so that
  simulation and rendering count, which no real cell does on this computer; `from_sending` leaves them out.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from seed_msgs.msg import RelativePose
from sensor_msgs.msg import CameraInfo

from seed_bringup.demo.live import live_rates
from seed_bringup.launching.domains import OWN, claimed
from seed_bringup.launching.launcher import Launch
from seed_bringup.launching.packages import find_launch_file
from seed_bringup.ros.session import Session, SessionError
from seed_core.errors import FailedError
from seed_core.hand import FINGERS
from seed_ros import QUEUE, SENSOR, FixedRateLoop
from seed_ros.conversions import seconds
from seed_testing.bench.processes import processes
from seed_testing.figures import figures

TASK, TASK_PATIENCE = "squeegee", 75.0  # [s]
PLAYED = 30.0  # [s] of pictures
ROBOT = "127.0.0.1"  # the stand-in for a real robot's controller; as "localhost", nothing else is simulated
STAGES = ("arrival", "latency")  # of the estimator's own diagnostics


class _Listener:
    """Takes the estimator's poses as they come, in a thread of its own."""

    def __init__(self) -> None:
        self.ages: list[tuple[float, float]] = []  # [s] of valid poses on arrival: since the stamp, since the sending
        self._sent: dict[float, float] = {}  # [s] when the last images of a stamp were sent
        self.stages: dict[str, list[float]] = {}  # [ms] medians as the estimator reports them, second by second
        self._over = threading.Event()
        self._context = Context()
        rclpy.init(args=[], context=self._context)
        self._node = Node("listener", context=self._context, start_parameter_services=False)
        loop = FixedRateLoop(self._node, 10.0, lambda: None, eager=True)
        loop.poll(RelativePose, "relative_pose", self._on_pose, QUEUE)
        for finger in FINGERS:  # each finger's camera_info is sent right before its images
            loop.poll(CameraInfo, f"bubble_{finger}/depth/camera_info", self._on_info, SENSOR, raw=True)
        loop.poll(DiagnosticArray, "/diagnostics", self._on_diagnostics, QoSProfile(depth=10))
        self._thread = threading.Thread(target=loop.run, args=(self._over.is_set,))

    def __enter__(self) -> _Listener:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def _on_info(self, message: bytes, info: Any) -> None:
        stamp = seconds(deserialize_message(message, CameraInfo).header.stamp)
        self._sent[stamp] = 1e-9 * info["source_timestamp"]

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


def run() -> dict[str, Any]:
    """Ages of the poses [ms]: median and 99th percentile, and where the median goes.

    Raises:
        SeedError: a cell did not come up, or the task ended early.
    """
    return {"cores": len(os.sched_getaffinity(0)), "real": _real(), "simulated": _simulated()}


def _real() -> dict[str, Any]:
    robot, cameras = ("-m", "seed_ur.ur_sim", "--host", ROBOT), ("-m", "seed_testing.bench.ros.played_cameras")
    with processes(robot, cameras), _cell({"robot": "ur", "robot_ip": "localhost"}) as session:
        session.trigger("cameras/release", patience=40.0)
        _prepare(session, "cameras/grasp", "driver/resend_robot_program")
        session.trigger("cameras/move")
        with _Listener() as heard:
            session.spin(PLAYED)
    return _summary(heard)


def _simulated() -> dict[str, Any]:
    camera_rate, loop_rate = live_rates()
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as controller:
        yaml.safe_dump({"controller": {"ros__parameters": {"rate": loop_rate}}}, controller)
        rates = {"sim_rate": str(loop_rate), "camera_rate": str(camera_rate), "controller_file": controller.name}
        with _cell({"task": TASK, "camera_latency": "0.0", **rates}) as session:
            _prepare(session, "sim/grasp")
            with _Listener() as heard:
                played = session.play(TASK, None, lambda _: None, TASK_PATIENCE)
    if not played.result.success:
        raise SessionError(f"the task ended early: {played.result.message}")
    return _summary(heard) | {"camera_rate_hz": camera_rate or "the scenario's", "control_rate_hz": loop_rate}


@contextmanager
def _cell(arguments: Mapping[str, str]) -> Iterator[Session]:
    """The cell's graph, and a client of it."""

    def watch() -> None:
        if launch.poll() is not None:
            raise SessionError("the cell ended early")

    with (
        claimed(OWN, "bench pose_age"),
        Launch(find_launch_file(["cell"]), arguments, lambda *_: None) as launch,
    ):
        session = Session(watch, follow=False)
        try:
            yield session
        finally:
            session.close()


def _prepare(session: Session, grasp: str, arm: str = "") -> None:
    session.trigger("estimator/capture_reference", patience=40.0)
    session.trigger(grasp, patience=40.0)
    session.spin(0.3)
    session.trigger("estimator/initialize_grasp")
    session.enable(arm)


def _summary(heard: _Listener) -> dict[str, Any]:
    if not heard.ages:
        raise FailedError("no valid pose arrived")
    since_stamp, since_sending = 1e3 * np.array(heard.ages).T
    arrival, latency = (float(np.median(heard.stages.get(stage, [np.nan]))) for stage in STAGES)
    before = float(np.median(since_stamp - since_sending))
    return {
        "from_stamp": figures("{}_ms", since_stamp, "median", "p99"),
        "from_sending": figures("{}_ms", since_sending, "median", "p99"),
        "of_the_median": {
            "before_sending_ms": before,
            "way_of_the_images_ms": arrival - before,
            "estimate_ms": latency - arrival,
            "way_of_the_pose_ms": float(np.median(since_stamp)) - latency,
        },
        "poses": len(heard.ages),
    }

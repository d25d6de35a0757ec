# SPDX-License-Identifier: Apache-2.0
"""How evenly the controller's node keeps its rate while other processes keep every core busy.

`run()` returns the figures. A second process of this module is the cell around the node: flange poses at the control
rate, relative poses at 45 Hz, and a set-point in motion.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import time
from collections.abc import Sequence

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from seed_msgs.msg import HybridSetpoint as HybridMsg
from seed_msgs.msg import RelativePose
from std_srvs.srv import SetBool

from seed_control.ros.node import ControllerNode
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Hand, Tool
from seed_core.spatial import inverse_pose, pose_from_rpy
from seed_ros.conversions import estimate_to_message, fill_pose, pose_stamped, stamp_from_seconds
from seed_ros.loop import FixedRateLoop
from seed_ros.qos import COMMAND, QUEUE

NAMESPACE = "seed_bench"
BUSY = "while True: sum(range(10000))"
WITHIN = 1e-3  # [s]
_WARM = 2.0  # [s] until the node is discovered, enabled and moving
_IMAGES = 6  # steps between images


def run(seconds: float = 10.0, busy: int | None = None) -> dict[str, object]:
    """Periods of the node's loop over `seconds`; busy: number of loading processes, by default one per core."""
    count = (os.cpu_count() or 1) if busy is None else busy
    load = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(count)]
    cell = subprocess.Popen([sys.executable, "-m", "seed_testing.bench.control_node"])
    try:
        return {"busy_processes": count, **_measured(seconds)}
    finally:
        for process in (*load, cell):
            process.kill()
            process.wait()


def _measured(seconds: float) -> dict[str, object]:
    rclpy.init()
    node = ControllerNode(namespace=NAMESPACE)
    gc.freeze()  # as the node's own process does
    try:
        until = time.monotonic() + 30.0
        node.loop.run(lambda: node.core.state.mode == "position" or time.monotonic() > until)
        warm = time.monotonic() + _WARM
        node.loop.run(lambda: time.monotonic() > warm)
        node.loop.periods.clear()
        end, cpu = time.monotonic() + seconds, time.process_time()
        node.loop.run(lambda: time.monotonic() > end)
        share = (time.process_time() - cpu) / seconds
        return {"mode": node.core.state.mode, "cpu_share": share, **summary(list(node.loop.periods), node.loop.period)}
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def summary(periods: Sequence[float], period: float) -> dict[str, float]:
    """Percentiles [ms] of measured periods [s], and the share of them within 1 ms of the wanted one."""
    p = np.asarray(periods)
    return {
        "share_within_1_ms": float(np.mean(np.abs(p - period) <= WITHIN)),
        "period_p50_ms": 1e3 * float(np.median(p)),
        "period_p99_ms": 1e3 * float(np.percentile(p, 99)),
        "period_max_ms": 1e3 * float(p.max()),
    }


def cell() -> None:
    """An arm that rests, a tool that hangs free, and a tip reference that sways by 20 mm, until killed."""
    rclpy.init()
    node = rclpy.create_node("cell", namespace=NAMESPACE)
    pose = node.create_publisher(PoseStamped, "current_pose", QUEUE)
    relative = node.create_publisher(RelativePose, "relative_pose", QUEUE)
    setpoint = node.create_publisher(HybridMsg, "controller/setpoint", COMMAND)
    enable = node.create_client(SetBool, "controller/enable")
    X_W_tip = pose_from_rpy((np.pi, 0.0, 0.0), (0.45, 0.0, 0.1))
    X_WE = X_W_tip @ inverse_pose(Tool().X_Ttip) @ inverse_pose(Hand().X_EC)
    steps = 0

    def step() -> None:
        nonlocal steps
        now = node.get_clock().now().nanoseconds * 1e-9
        pose.publish(pose_stamped(X_WE, now, "base"))
        if steps % _IMAGES == 0:
            relative.publish(estimate_to_message(RelativePoseEstimate(now, np.eye(4)), "compliance", "tool"))
            message = HybridMsg()
            message.header.frame_id, message.header.stamp = "base", stamp_from_seconds(now)
            X = X_W_tip.copy()
            X[0, 3] += 0.02 * np.sin(now)
            fill_pose(message.pose, X)
            setpoint.publish(message)
        if steps % 250 == 125 and enable.service_is_ready():
            enable.call_async(SetBool.Request(data=True))
        steps += 1

    FixedRateLoop(node, 250.0, step).run()


if __name__ == "__main__":
    cell()

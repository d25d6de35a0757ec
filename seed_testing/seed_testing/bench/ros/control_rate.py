# SPDX-License-Identifier: Apache-2.0
"""Periods of the controller's node while other processes keep every core busy.

A second process of this module is the cell around the node: flange poses at the control rate, relative poses at 42 Hz,
and a set-point in motion.
"""

import gc
import os
import sys
import time

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from seed_msgs.msg import HybridSetpoint as HybridMsg
from seed_msgs.msg import RelativePose
from std_srvs.srv import SetBool

from seed_control.ros.node import ControllerNode
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Hand, Tool
from seed_core.spatial import inverse_pose, make_pose, pose_from_rpy
from seed_ros import COMMAND, QUEUE, FixedRateLoop, SeedNode
from seed_ros.conversions import estimate_to_message, fill_pose, pose_stamped, stamp_from_seconds
from seed_testing.bench.processes import BUSY, processes
from seed_testing.figures import figures

NAMESPACE = "seed_bench"
WITHIN = 1e-3  # [s]
_READY, _WARM = 30.0, 2.0  # [s] of waiting for the set-point to be followed; then until it moves
_IMAGES = 6  # steps between images


def run(seconds: float = 10.0) -> dict[str, object]:
    """Periods of the node's loop over `seconds`, with one loading process per core."""
    count = os.cpu_count() or 1
    with processes(*[BUSY] * count, ("-m", "seed_testing.bench.ros.control_rate")):
        return {"busy_processes": count, **_measured(seconds)}


def _measured(seconds: float) -> dict[str, object]:
    rclpy.init()
    node = ControllerNode(namespace=NAMESPACE)
    gc.freeze()  # as the node's own process does

    def spin(duration: float) -> None:
        end = time.monotonic() + duration
        node.loop.run(lambda: time.monotonic() > end)

    try:
        end = time.monotonic() + _READY
        node.loop.run(lambda: node.core.state.mode == "position" or time.monotonic() > end)
        spin(_WARM)
        node.loop.periods.clear()
        cpu = time.process_time()
        spin(seconds)
        share = (time.process_time() - cpu) / seconds
        periods = np.asarray(node.loop.periods)
        return {
            "mode": node.core.state.mode,
            "cpu_share": share,
            "share_within_1_ms": float(np.mean(np.abs(periods - node.loop.period) <= WITHIN)),
            **figures("period_{}_ms", 1e3 * periods, "p50", "p99", "max"),
        }
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


class CellNode(SeedNode):
    """An arm that rests, a tool that hangs free, and a tip reference that sways by 20 mm."""

    def __init__(self) -> None:
        super().__init__("cell", namespace=NAMESPACE)
        self._pose = self.publisher(PoseStamped, "current_pose", QUEUE)
        self._relative = self.publisher(RelativePose, "relative_pose", QUEUE)
        self._setpoint = self.publisher(HybridMsg, "controller/setpoint", COMMAND)
        self._enable = self.create_client(SetBool, "controller/enable")
        self._X_W_tip = pose_from_rpy((np.pi, 0.0, 0.0), (0.45, 0.0, 0.1))
        self._X_WE = self._X_W_tip @ inverse_pose(Tool().X_Ttip) @ inverse_pose(Hand().X_EC)
        self._steps = 0
        self.loop = FixedRateLoop(self, 250.0, self._step)

    def _step(self) -> None:
        now = self.now()
        self._pose.publish(pose_stamped(self._X_WE, now, "base"))
        if self._steps % _IMAGES == 0:
            self._relative.publish(estimate_to_message(RelativePoseEstimate(now, np.eye(4)), "compliance", "tool"))
            message = HybridMsg()
            message.header.frame_id, message.header.stamp = "base", stamp_from_seconds(now)
            fill_pose(message.pose, make_pose(None, (0.02 * np.sin(now), 0.0, 0.0)) @ self._X_W_tip)
            self._setpoint.publish(message)
        if self._steps % 250 == 125 and self._enable.service_is_ready():
            self._enable.call_async(SetBool.Request(data=True))
        self._steps += 1


if __name__ == "__main__":
    sys.exit(CellNode.main())

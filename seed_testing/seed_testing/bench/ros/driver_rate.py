# SPDX-License-Identifier: Apache-2.0
"""Periods and targets of the driver's node while twenty other processes want every core.

A second process of this module is the controller: a sway about the present pose at the control rate, with the real-time
priority that the controller has. It tells how many targets it has sent.
"""

import gc
import math
import os
import sys
import time

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import UInt32

from seed_driver.ros.node import DriverNode
from seed_ros import COMMAND, QUEUE, FixedRateLoop, SeedNode
from seed_testing.bench.processes import BUSY, processes
from seed_testing.figures import figures
from seed_ur.standin_client import StandIn

NAMESPACE = "seed_bench"
LOAD = 20
RATE, PRIORITY = 250.0, 40  # [Hz] and SCHED_FIFO priority of the controller
SWAY = 0.02  # [m]
_READY, _WARM = 60.0, 2.0  # [s]


def run(seconds: float = 20.0, load: int = LOAD) -> dict[str, object]:
    """Share of the targets that the node accepts, and periods of its loop, over `seconds` beside `load` processes."""
    with StandIn() as robot, processes(("-m", "seed_testing.bench.ros.driver_rate")):
        rclpy.init(args=["--ros-args", "-p", f"robot_ip:={robot.host}"])
        node = DriverNode(namespace=NAMESPACE)
        sent = [0]
        node.loop.poll(UInt32, "sent", lambda message: sent.__setitem__(0, message.data), QUEUE)
        try:
            node.trigger_configure()
            node.trigger_activate()
            gc.freeze()  # as the node's own process does
            _spin(node, _READY, lambda: node.accepted > 0)
            with processes(*[BUSY] * load):
                assert node.supervisor is not None
                node.supervisor.send("start")  # starting them has kept this process from looking after the node
                _spin(node, _WARM)
                return {"busy_processes": load, **_measured(node, sent, seconds)}
        finally:
            node.destroy_node()
            rclpy.try_shutdown()


def _spin(node: DriverNode, seconds: float, done: object = None) -> None:
    end = time.monotonic() + seconds
    node.loop.run(lambda: time.monotonic() > end or (callable(done) and bool(done())))


def _measured(node: DriverNode, sent: list[int], seconds: float) -> dict[str, object]:
    node.loop.periods.clear()
    accepted, refused, before, start = node.accepted, node.counters.total(), sent[0], time.monotonic()
    _spin(node, seconds)
    told, elapsed = sent[0] - before, time.monotonic() - start
    state = node.supervisor.state if node.supervisor is not None else None
    return {
        "load_average": round(os.getloadavg()[0], 1),
        "targets_sent_per_second": round(told / elapsed, 1),
        "accepted_share": round((node.accepted - accepted) / max(1, told), 4),
        "refused": node.counters.total() - refused,
        "following": bool(state and state.armed),
        **figures("period_{}_ms", 1e3 * np.asarray(node.loop.periods), "p50", "p99", "max"),
        "servo_period_p99_ms": round(1e3 * state.period_p99, 3) if state else math.nan,
    }


class SenderNode(SeedNode):
    """Targets from the first pose on."""

    def __init__(self) -> None:
        super().__init__("sender", namespace=NAMESPACE)
        self._targets = self.publisher(PoseStamped, "target_frame", COMMAND)
        self._sent = self.publisher(UInt32, "sent", QUEUE)
        self._here: PoseStamped | None = None
        self._count = 0
        self.loop = FixedRateLoop(self, RATE, self._send, priority=PRIORITY, catch_up=False)
        self.loop.poll(PoseStamped, "current_pose", self._on_pose, QUEUE)

    def _on_pose(self, message: PoseStamped) -> None:
        self._here = self._here or message

    def _send(self) -> None:
        if self._here is None:
            return
        message, here = PoseStamped(), self._here
        message.header.frame_id, message.header.stamp = here.header.frame_id, self.get_clock().now().to_msg()
        message.pose.orientation, p = here.pose.orientation, here.pose.position
        message.pose.position.x, message.pose.position.z = p.x, p.z
        message.pose.position.y = p.y + SWAY * (1.0 - math.cos(self._count / RATE))
        self._targets.publish(message)
        self._count += 1
        self._sent.publish(UInt32(data=self._count))


if __name__ == "__main__":
    sys.exit(SenderNode.main())

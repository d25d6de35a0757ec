# SPDX-License-Identifier: Apache-2.0
"""The simulated gripper's topics."""

import time

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("pydrake", reason="needs Drake")

from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from seed_ros.qos import COMMAND, QUEUE
from seed_ros.testing import Bench
from seed_sim.ros.node import SimNode

pytestmark = pytest.mark.ros


def test_a_force_is_reached_at_the_grippers_speed_and_nonsense_is_refused() -> None:
    bench = Bench()
    try:
        node = bench.add(SimNode, seed=3)
        told: list[tuple[float, float]] = []
        bench.client.create_subscription(
            Float64, "gripper/force", lambda m: told.append((time.monotonic(), m.data)), QUEUE
        )
        forces = bench.client.create_publisher(Float64, "gripper/force_command", COMMAND)
        widths = bench.client.create_publisher(Float64, "gripper/command", COMMAND)
        assert bench.until(lambda: bool(told))
        assert told[-1][1] == 0.0  # the tool stands in its holder
        assert bench.call(Trigger, "sim/grasp", Trigger.Request()).success
        assert bench.until(lambda: told[-1][1] == pytest.approx(5.0))
        bench.every.append(lambda: forces.publish(Float64(data=8.0)))
        assert bench.until(lambda: abs(told[-1][1] - 8.0) < 0.1)
        assert node.plant.grip.width < 0.017
        bench.every.pop()
        widths.publish(Float64(data=float("nan")))
        assert bench.until(lambda: node.counters["widths_refused"] == 1)
        widths.publish(Float64(data=0.022))
        assert bench.until(lambda: abs(node.plant.grip.width - 0.022) < 1e-4)
        assert bench.until(lambda: told[-1][1] < 5.5)
    finally:
        bench.close()

# SPDX-License-Identifier: Apache-2.0
"""The simulated gripper's topics."""

import time
from itertools import pairwise
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("pydrake", reason="needs Drake")

from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from seed_ros.qos import COMMAND, QUEUE
from seed_ros.testing import Bench
from seed_sim.ros.every import Every
from seed_sim.ros.node import SimNode

pytestmark = pytest.mark.ros

FIRM_MEMBRANES = """
grasp: {kind: membrane}
membrane: {squeeze: 0.0165, spacing: 0.008}
tactile:
  tool: {kind: box, radius: 0.012, width: 0.03, length: 0.06}
"""


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


def test_a_force_comes_to_rest_on_firm_membranes(tmp_path: Path) -> None:
    """Their push rises by 1.8 N per closed millimetre, and is solved at the camera's rate, six ticks apart."""
    scenario = tmp_path / "firm.yaml"
    scenario.write_text(FIRM_MEMBRANES, encoding="utf-8")
    bench = Bench()
    try:
        node = bench.add(SimNode, seed=3, scenario=str(scenario))
        assert bench.call(Trigger, "sim/grasp", Trigger.Request()).success
        force = bench.client.create_publisher(Float64, "gripper/force_command", COMMAND)
        wanted = 0.8 * node.plant.grip.push
        bench.every.append(lambda: force.publish(Float64(data=wanted)))
        start = node.plant.time
        assert bench.until(lambda: node.plant.time > start + 0.4)
        pushes: list[float] = []
        bench.every.append(lambda: pushes.append(node.plant.grip.push))
        assert bench.until(lambda: node.plant.time > start + 0.8)
        assert max(abs(push - wanted) for push in pushes) < 0.1  # [N]
    finally:
        bench.close()


@pytest.mark.parametrize("rate", [100.0, 130.0, 250.0, 1000.0])
def test_fingers_are_told_of_at_the_grippers_rate_whatever_the_rate_of_the_ticks(rate: float) -> None:
    """At least 20 Hz, as the contract of a gripper asks; 0.04 s is no whole number of ticks at 130 Hz."""
    every = Every(0.04)
    told = [n / rate for n in range(round(10.0 * rate)) if every.due(n / rate)]
    assert len(told) / 10.0 == pytest.approx(25.0, rel=0.01)
    assert max(b - a for a, b in pairwise(told)) <= 1.0 / 20.0
    assert every.due(1.0)  # time has gone back
    assert not every.due(1.03)
    assert every.due(1.04)


def test_a_slow_cell_keeps_the_rates_of_the_grippers_contract() -> None:
    bench = Bench()
    try:
        node = bench.add(SimNode, seed=3, rate=100.0)
        told = {"width": 0, "force": 0}

        def count(name: str) -> None:
            told[name] += 1

        for name in told:
            bench.client.create_subscription(Float64, f"gripper/{name}", lambda _, n=name: count(n), QUEUE)
        assert bench.until(lambda: min(told.values()) > 0)
        start, before = node.plant.time, dict(told)
        assert bench.until(lambda: node.plant.time > start + 2.0)
        passed = node.plant.time - start
        assert (told["width"] - before["width"]) / passed > 0.8 * 50.0  # by the plant's time
        assert (told["force"] - before["force"]) / passed > 0.8 * 25.0
    finally:
        bench.close()

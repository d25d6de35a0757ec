# SPDX-License-Identifier: Apache-2.0
"""The simulated cameras by simulated time, and before the plant's membranes."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

pytest.importorskip("rclpy", reason="needs ROS 2")

from rosgraph_msgs.msg import Clock
from seed_msgs.msg import RelativePose
from sensor_msgs.msg import Image
from std_msgs.msg import Float32
from std_srvs.srv import Trigger

from seed_ros import MessageError
from seed_ros.conversions import seconds, stamp_from_seconds
from seed_ros.images import depth_from_message
from seed_ros.qos import CLOCK, SENSOR
from seed_ros.testing import Bench
from seed_sim.closed_loop.relative_poses import pose_source
from seed_sim.ros.membrane_message import Membranes, membranes_from_message, membranes_to_message
from seed_sim.ros.node import SimNode
from seed_sim.ros.tactile_cameras import TactileCamerasNode
from seed_sim.scenario import load_scenario

pytestmark = pytest.mark.ros

EXPOSED = 12.0  # [s]


def test_live_cameras_show_what_those_of_the_closed_loop_do(bench: Bench) -> None:
    live = bench.add(TactileCamerasNode, scenario="slip20", seed=4).renderer
    offline = pose_source("rigid_fit", load_scenario("slip20"), 4, 250.0).renderer
    assert live.parameters.slip == 0.2
    assert live.parameters == offline.parameters


def test_images_for_which_simulated_time_stands_still_are_sent(bench: Bench) -> None:
    bench.add(TactileCamerasNode, use_sim_time=True, latency=0.5)
    clock = bench.client.create_publisher(Clock, "/clock", CLOCK)
    truth = bench.client.create_publisher(RelativePose, "sim/ground_truth/relative_pose", SENSOR)
    images: list[Image] = []
    bench.client.create_subscription(Image, "bubble_left/depth/image_rect_raw", images.append, SENSOR)
    stamp = stamp_from_seconds(EXPOSED)

    def stand_still() -> None:
        clock.publish(Clock(clock=stamp))
        message = RelativePose()
        message.header.stamp = stamp
        truth.publish(message)

    bench.every.append(stand_still)
    assert bench.until(lambda: images, patience=10.0)
    assert images[0].header.stamp == stamp


def test_cameras_show_the_membranes_that_the_plant_has_solved(bench: Bench, tmp_path: Path) -> None:
    """Plant and cameras are two processes: an array of nodes goes from one to the other."""
    file = tmp_path / "coarse.yaml"
    file.write_text(
        "grasp: {kind: membrane}\ntactile: {noise: 0, pattern: 0, dropouts: 0}\nmembrane: {spacing: 0.01}\n"
        "pressure: {fault: left_silent}"
    )
    sim = bench.add(SimNode, scenario=str(file), target_timeout=1.0)
    bubbles = bench.add(TactileCamerasNode, scenario=str(file), seed=4)
    depths: list[Image] = []
    gas: dict[str, list[Float32]] = {"left": [], "right": []}
    bench.client.create_subscription(Image, "bubble_left/depth/image_rect_raw", depths.append, SENSOR)
    for finger, heard in gas.items():
        bench.client.create_subscription(Float32, f"bubble_{finger}/pressure", heard.append, SENSOR)
    assert bench.until(lambda: len(depths) > 2, patience=20.0)
    free = bubbles.renderer.no_contact(0.0)["left"].depth
    shown = depth_from_message(depths[-1], "depth")
    assert_allclose(np.nanmax(np.abs(shown - free)), 0.0, atol=6e-4)  # nothing is in the grasp yet
    bench.call(Trigger, "sim/grasp", Trigger.Request())
    closed = sim.time.stamp
    assert bench.until(lambda: seconds(depths[-1].header.stamp) > closed + 0.05)
    imprint = np.nanmax(free - depth_from_message(depths[-1], "depth"))
    assert_allclose(imprint, sim.plant.membranes.parameters.squeeze, atol=1.5e-3)  # [m]
    assert not gas["left"]
    assert_allclose(gas["right"][-1].data, sim.plant.grip.pressures["right"], atol=0.5)  # [hPa]


def test_tool_that_the_membranes_lose_stands_in_its_holder_again(bench: Bench, tmp_path: Path) -> None:
    file = tmp_path / "coarse.yaml"
    file.write_text("grasp: {kind: membrane}\nmembrane: {spacing: 0.01}")
    sim = bench.add(SimNode, scenario=str(file), target_timeout=1.0)
    bench.call(Trigger, "sim/grasp", Trigger.Request())
    assert sim.holder.grasped
    sim.plant.grasp(np.array((0.0, 0.045, 0.0)))  # [m] through a rim's plane
    assert bench.until(lambda: not sim.holder.grasped)
    assert "tool pierces the left membrane" in sim.counters.last
    then = sim.plant.time
    assert bench.until(lambda: sim.plant.time > then + 0.05)
    assert np.isfinite(sim.plant.X_CT).all()
    assert bench.call(Trigger, "sim/grasp", Trigger.Request()).success


def test_nodes_of_another_mesh_are_refused() -> None:
    nodes = {finger: np.arange(12.0).reshape(4, 3) for finger in ("left", "right")}
    message = membranes_to_message(Membranes(1.25, True, nodes))
    back = membranes_from_message(message, 4)
    assert (back.stamp, back.grasped) == (1.25, True)
    assert_allclose(back.nodes["right"], nodes["right"])
    with pytest.raises(MessageError, match="26 numbers, 32 are expected: give sim and bubbles one scenario"):
        membranes_from_message(message, 5)
    message.data[3] = float("nan")
    with pytest.raises(MessageError, match="not finite"):
        membranes_from_message(message, 4)

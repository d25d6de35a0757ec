# SPDX-License-Identifier: Apache-2.0
"""The simulated cameras by simulated time."""

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from rosgraph_msgs.msg import Clock
from seed_msgs.msg import RelativePose
from sensor_msgs.msg import Image

from seed_ros.conversions import stamp_from_seconds
from seed_ros.qos import CLOCK, SENSOR
from seed_ros.testing import Bench
from seed_sim.closed_loop.relative_poses import pose_source
from seed_sim.ros.tactile_cameras import TactileCamerasNode
from seed_sim.scenario import load_scenario

pytestmark = [pytest.mark.ros, pytest.mark.neighbourly]

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

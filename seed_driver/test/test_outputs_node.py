# SPDX-License-Identifier: Apache-2.0
"""What the driver publishes comes at the rate that is set, out of states that come at another."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed")
pytest.importorskip("tf2_msgs", reason="the workspace is not built (./seed test does it)")

from seed_driver.config import DriverConfig
from seed_driver.process.shared_memory import ServoState
from seed_driver.ros.node import DriverNode
from seed_driver.ros.outputs import Outputs
from seed_ros.testing import Bench

pytestmark = pytest.mark.ros
DURATION = 4.0  # [s]


@pytest.mark.parametrize(
    ("wanted", "states", "published"),
    [(250.0, 250.0, 250.0), (200.0, 250.0, 200.0), (100.0, 250.0, 100.0), (10.0, 250.0, 10.0), (500.0, 125.0, 125.0)],
)
def test_poses_come_at_the_rate_that_is_set_or_at_that_of_the_states(
    wanted: float, states: float, published: float
) -> None:
    """States are late by up to a quarter of their period, and the node looks twice at each."""
    rng, poses = np.random.default_rng(5), []
    bench = Bench()
    try:
        node = bench.add(DriverNode, robot_ip="127.0.0.9", autostart=False)
        outputs = Outputs(node, DriverConfig(robot_ip="127.0.0.9", publish_rate=wanted))
        outputs.pose = SimpleNamespace(publish=poses.append)
        for i in range(int(DURATION * states)):
            at = 100.0 + (i + rng.uniform(0.0, 0.25)) / states
            for _ in range(2):
                outputs.publish(ServoState(linked=True, armed=True, sample_time=at), at, 0, 0, 0)
        assert len(poses) == pytest.approx(published * DURATION, rel=0.01, abs=1.5)
    finally:
        bench.close()

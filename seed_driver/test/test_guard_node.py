# SPDX-License-Identifier: Apache-2.0
"""The guard's node towards those who send it targets."""

from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed")
pytest.importorskip("tf2_msgs", reason="the workspace is not built (./seed test does it)")

from geometry_msgs.msg import PoseStamped
from std_srvs.srv import Trigger

from seed_core.spatial import pose_from_rpy
from seed_driver.ros.target_guard import GuardNode
from seed_ros import COMMAND, QUEUE
from seed_ros.conversions import pose_stamped
from seed_ros.testing import Bench

pytestmark = pytest.mark.ros
X_WE = pose_from_rpy((np.pi, 0.0, 0.0), (0.4, 0.0, 0.3))


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


def test_two_nodes_that_send_targets_at_once_have_the_arm_hold_and_are_named(bench: Bench) -> None:
    guard = bench.add(GuardNode, command_timeout=1.0).guard
    here = bench.client.create_publisher(PoseStamped, "current_pose", QUEUE)
    senders = [bench.client.create_publisher(PoseStamped, "target_frame", COMMAND) for _ in range(2)]

    def message() -> PoseStamped:
        return pose_stamped(X_WE, bench.client.get_clock().now().nanoseconds * 1e-9, "base")

    def resumed() -> bool:
        return bench.call(Trigger, "guard/resend_robot_program", Trigger.Request()).success

    bench.every.append(lambda: here.publish(message()))
    assert bench.until(resumed)
    bench.every.append(lambda: senders[0].publish(message()))
    bench.spin(0.5)  # the other one only could send
    assert guard.reason == ""
    bench.every.append(lambda: (bench._loops[0].take(), senders[1].publish(message())))
    assert bench.until(lambda: guard.reason)
    assert guard.reason == "more than one node sends target_frame (/client and /client): end all but one"
    bench.every.pop()
    bench.spin(0.6)
    assert resumed()
    bench.spin(0.3)
    assert guard.reason == ""

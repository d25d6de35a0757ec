# SPDX-License-Identifier: Apache-2.0
"""What `./seed watch` makes of a message."""

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed")
pytest.importorskip("seed_msgs", reason="the workspace is not built (./seed test does it)")

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped

from seed_bringup.ros.watching import lines


def test_a_pose_is_told_in_degrees_with_standard_deviations() -> None:
    message = PoseWithCovarianceStamped()
    message.header.frame_id = "base"
    message.header.stamp.sec, message.header.stamp.nanosec = 3, 500_000_000
    message.pose.pose.position.z = 0.25
    message.pose.pose.orientation.x, message.pose.pose.orientation.w = np.sin(np.pi / 12), np.cos(np.pi / 12)
    message.pose.covariance = np.diag([4e-6] * 3 + [1e-4] * 3).ravel()
    text = lines(message)
    assert "  stamp: 3.500 s" in text
    assert "  frame_id: base" in text
    assert "    position: 0 0 0.25" in text
    assert "    orientation: roll pitch yaw 30.00 0.00 0.00 deg" in text
    assert "  covariance: standard deviations 0.002 0.002 0.002 0.01 0.01 0.01" in text


def test_lists_of_messages_and_long_arrays_stay_short() -> None:
    status = DiagnosticStatus(level=b"\1", values=[KeyValue(key="rate", value="45")])
    assert "rate: 45" in lines(status)
    assert "level: 1" in lines(status)

# SPDX-License-Identifier: Apache-2.0
"""The node of the tutorial on an own sensor publishes what a controller takes, in the frames that it asks for."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from seed_msgs.msg import RelativePose

from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import pose_from_rpy
from seed_ros.conversions import estimate_to_message, pose_to_matrix
from seed_ros.frames import FrameNames

PAGE = Path(__file__).resolve().parents[2] / "docs/tutorials/own_sensor.md"
pytestmark = [pytest.mark.ros, pytest.mark.skipif(not PAGE.is_file(), reason="this is an installed copy")]


def test_the_node_of_the_page_publishes_poses_of_its_own_sensor(bench, tmp_path: Path) -> None:
    for title, code in re.findall(
        r'^```python title="([\w.]+)"\n(.*?)^```', PAGE.read_text(), re.MULTILINE | re.DOTALL
    ):
        (tmp_path / title).write_text(code)
    X_CT, frames, now = pose_from_rpy((0.02, 0.0, 0.01), (0.0, 0.0, -0.001)), FrameNames(), 1e9
    truth = estimate_to_message(RelativePoseEstimate(now, X_CT), frames.compliance, frames.tool)
    came: list[RelativePose] = []
    send = bench.client.create_publisher(RelativePose, "sim/ground_truth/relative_pose", 20)
    bench.client.create_subscription(RelativePose, "relative_pose", came.append, 20)
    bench.every.append(lambda: send.publish(truth))
    node = subprocess.Popen([sys.executable, str(tmp_path / "my_poses.py")])
    try:
        assert bench.until(lambda: came)
    finally:
        node.terminate()
        node.wait(10.0)
    message = came[0]
    assert message.valid, message.reason
    assert message.header == truth.header
    assert message.child_frame_id == frames.tool
    assert message.method == "mine"
    error = np.abs(pose_to_matrix(message.pose.pose) - X_CT)
    assert error[:3, 3].max() < 5e-5  # [m], of 1 mm
    assert error[:3, :3].max() < 0.003  # [rad], of 0.02 rad

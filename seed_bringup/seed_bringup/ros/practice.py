# SPDX-License-Identifier: Apache-2.0
"""Simulated cameras, and hands that hold a cylinder before them: to practise a capture without hardware."""

import subprocess
from contextlib import AbstractContextManager

import numpy as np
from seed_msgs.msg import RelativePose

from seed_bringup.launching.domains import OWN, claimed
from seed_bringup.launching.packages import executable
from seed_bringup.ros.session import Session
from seed_core.spatial import pose_from_rpy
from seed_ros.conversions import fill_pose
from seed_ros.qos import SENSOR

# Roll, pitch and yaw of the cylinder in each step after the free membranes [deg]
POSES = ((0, 0, 0), (10, 0, 0), (-10, 0, 0), (0, 20, 0), (0, -20, 0))
PERIOD = 0.02  # [s] between two poses that are told
SETTLE = 1.0  # [s] until the images show a new pose


class Practice:
    """Tells the simulated cameras what to show; `begin` each step."""

    def __init__(self, session: Session) -> None:
        """Start the cameras."""
        self._session, self._step = session, 0
        self._truth = session.node.create_publisher(RelativePose, "sim/ground_truth/relative_pose", SENSOR)
        session.node.create_timer(PERIOD, self._tell)
        self._cameras = subprocess.Popen([str(executable("seed_sim", "bubbles"))])

    @staticmethod
    def domain() -> AbstractContextManager[int]:
        """A ROS domain of its own."""
        return claimed(OWN, "capture --practice")

    def close(self) -> None:
        """End the cameras."""
        self._cameras.terminate()
        self._cameras.wait()

    def begin(self, step: int) -> None:
        """Hold what a step asks for: nothing in step 0, then the cylinder in its poses."""
        self._step = step
        self._session.spin(SETTLE)

    def ask(self, prompt: str) -> str:
        """Say yes to what is asked."""
        print(prompt, flush=True)
        return ""

    def _tell(self) -> None:
        message = RelativePose(valid=self._step > 0)
        message.header.stamp = self._session.node.get_clock().now().to_msg()
        rpy = POSES[max(self._step - 1, 0)]
        fill_pose(message.pose.pose, pose_from_rpy(np.deg2rad(rpy), (0.0, 0.0, 0.0)))
        self._truth.publish(message)

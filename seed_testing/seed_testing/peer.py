# SPDX-License-Identifier: Apache-2.0
"""A ROS node that plays the controller's part towards any arm: streams targets, listens, calls."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from seed_core.arm.quaternion import Quaternion
from seed_core.errors import FailedError
from seed_core.vector3 import Vector3
from seed_ros.qos import COMMAND

Pose = tuple[Vector3, Quaternion]
Path = Callable[[float], Pose]  # a pose for each time [s]
PERIOD = 0.004  # [s] of targets


class Peer:
    """The other side of an arm's topics; `driver` is the arm node's name."""

    def __init__(
        self,
        driver: str = "driver",
        base: str = "base",
        current_pose: str = "current_pose",
        target_frame: str = "target_frame",
    ) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = Node("peer", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.driver, self.base = driver, base
        self.poses: deque[tuple[float, PoseStamped]] = deque(maxlen=20_000)  # time of arrival, message
        self.pause = 0.0  # [s] longest time that this program did not get to run, since it was last set to 0
        self.pose_topic = self.node.create_subscription(PoseStamped, current_pose, self._on_pose, 10).topic_name
        self.targets = self.node.create_publisher(PoseStamped, target_frame, COMMAND)

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, *_: object) -> None:
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def _on_pose(self, message: PoseStamped) -> None:
        self.poses.append((time.monotonic(), message))

    def spin(self, seconds: float) -> None:
        """Listen."""
        last = time.monotonic()
        until = last + seconds
        while (now := time.monotonic()) < until:
            self.pause, last = max(self.pause, now - last), now
            self.executor.spin_once(timeout_sec=0.01)
        self.pause = max(self.pause, now - last)

    def wait(self, condition: Callable[[], bool], timeout: float, what: str) -> float:
        """Listen until `condition`; the seconds it took. Raises FailedError after `timeout` [s]."""
        start = time.monotonic()
        while not condition():
            self.executor.spin_once(timeout_sec=0.01)
            if time.monotonic() - start > timeout:
                raise FailedError(f"{what}: not within {timeout} s")
        return time.monotonic() - start

    def pose(self) -> Pose:
        """The newest pose of the flange, position [m] and quaternion."""
        if not self.poses:
            raise FailedError(f"nothing came on {self.pose_topic}: is the arm running, and in this domain?")
        p, q = self.poses[-1][1].pose.position, self.poses[-1][1].pose.orientation
        return (p.x, p.y, p.z), (q.x, q.y, q.z, q.w)

    def send(self, p: Vector3, q: Quaternion, age: float = 0.0, frame: str | None = None) -> None:
        """Publish one target, stamped `age` seconds ago."""
        message = PoseStamped()
        now = self.node.get_clock().now()
        message.header.stamp = (now - rclpy.duration.Duration(seconds=age)).to_msg()
        message.header.frame_id = self.base if frame is None else frame
        at, turn = message.pose.position, message.pose.orientation
        (at.x, at.y, at.z), (turn.x, turn.y, turn.z, turn.w) = p, q
        self.targets.publish(message)

    def stream(self, path: Path, seconds: float, goes_on: Callable[[], bool] = lambda: True) -> None:
        """Send a path at the peer's rate, for some time or until it may not go on."""
        start = deadline = last = time.monotonic()
        while (now := time.monotonic()) - start < seconds and goes_on():
            self.pause, last = max(self.pause, now - last), now
            self.send(*path(now - start))
            deadline += PERIOD
            while (left := deadline - time.monotonic()) > 0:
                self.executor.spin_once(timeout_sec=left)
        self.pause = max(self.pause, now - last)

    def call(self, name: str, kind: Any = Trigger, timeout: float = 10.0, **fields: Any) -> Any:
        """Call a service of the arm; its response."""
        client = self.node.create_client(kind, name if name.startswith("/") else f"{self.driver}/{name}")
        if not client.wait_for_service(timeout_sec=timeout):
            raise FailedError(f"there is no service {client.srv_name}")
        future = client.call_async(kind.Request(**fields))
        self.wait(future.done, timeout, f"answer of {client.srv_name}")
        self.node.destroy_client(client)
        return future.result()

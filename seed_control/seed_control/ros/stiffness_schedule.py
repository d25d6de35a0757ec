# SPDX-License-Identifier: Apache-2.0
"""Follows the grip live: pressures or width in, a new stiffness for the controller out."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from std_msgs.msg import Float32, Float64

from seed_control.wrench.stiffness_schedule import GripFollower, GripSettings
from seed_core.bushing import Stiffness
from seed_core.errors import SeedError
from seed_core.stiffness_file import GripStiffness, load_stiffness
from seed_ros.diagnostics import Counters
from seed_ros.qos import QUEUE, SENSOR


class GripListener:
    """Subscribes to what tells the grip and calls `apply` with each new stiffness."""

    def __init__(
        self, node: Node, settings: GripSettings, counters: Counters, apply: Callable[[Stiffness], None]
    ) -> None:
        self._counters, self._apply = counters, apply
        self._pressures: dict[str, float] = {}
        if not settings.file:
            return
        self._follower = GripFollower(GripStiffness(load_stiffness(settings.file)), settings.follow)
        if settings.follow == "width":
            node.create_subscription(Float64, "gripper/width", self._on_width, QUEUE)
            return
        node.create_subscription(Float32, "bubble_left/pressure", self._on_left, SENSOR)
        node.create_subscription(Float32, "bubble_right/pressure", self._on_right, SENSOR)

    def _on_width(self, message: Float64) -> None:
        self._take(message.data)

    def _on_left(self, message: Float32) -> None:
        self._on_pressure("left", message.data)

    def _on_right(self, message: Float32) -> None:
        self._on_pressure("right", message.data)

    def _on_pressure(self, side: str, value: float) -> None:
        """The identification is over the mean of both bubbles."""
        self._pressures[side] = value
        if len(self._pressures) == 2:
            self._take(0.5 * (self._pressures["left"] + self._pressures["right"]))

    def _take(self, value: float) -> None:
        try:
            stiffness = self._follower.update(value)
        except SeedError as error:
            self._counters.add("grip_unreadable", str(error))
            return
        if stiffness is not None:
            self._apply(stiffness)

# SPDX-License-Identifier: Apache-2.0
"""Publishing transforms. /tf is only a topic of type tf2_msgs/TFMessage, so that tf2_ros is not needed for it."""

from __future__ import annotations

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from tf2_msgs.msg import TFMessage

from seed_ros.loop import QUIET_OUT


class TransformBroadcaster:
    """Publishes moving transforms on /tf and fixed ones, kept and sent together, on /tf_static."""

    def __init__(self, node: Node) -> None:
        self._moving = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100), event_callbacks=QUIET_OUT)
        self._fixed = node.create_publisher(
            TFMessage,
            "/tf_static",
            QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE),
            event_callbacks=QUIET_OUT,
        )
        self._kept: dict[str, TransformStamped] = {}

    def send(self, *transforms: TransformStamped) -> None:
        """Moving transforms."""
        self._moving.publish(TFMessage(transforms=list(transforms)))

    def send_static(self, *transforms: TransformStamped) -> None:
        """Fixed transforms; those sent before stay."""
        self._kept.update({t.child_frame_id: t for t in transforms})
        self._fixed.publish(TFMessage(transforms=list(self._kept.values())))

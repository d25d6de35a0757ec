# SPDX-License-Identifier: Apache-2.0
"""The qualities of service that the suite uses, and publishers that are not heard by theirs."""

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo

from seed_ros.diagnostics import Counters

# Images and other streams where the newest value is what counts.
SENSOR = QoSProfile(depth=2, reliability=ReliabilityPolicy.BEST_EFFORT)
# Commands and estimates: the newest must arrive.
COMMAND = QoSProfile(depth=1)
# What a late joiner needs.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Set-points and poses of which each one counts.
QUEUE = QoSProfile(depth=20)
# Moving transforms, as tf2_ros has them.
TF = QoSProfile(depth=100)
# Simulated time.
CLOCK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def full_name(endpoint: TopicEndpointInfo) -> str:
    """Of the node that publishes or subscribes, as the graph tells of it: with its namespace."""
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


class QosMismatch:
    """Publishers whose quality of service is not what a node asks for: `look` now and then.

    rclpy tells that by an event of each subscription, which the streams of a `FixedRateLoop` do without; and silence
    alone looks like a driver that does not run.
    """

    def __init__(self, node: Node, counters: Counters) -> None:
        self._node, self._counters = node, counters
        self._told: set[bytes] = set()  # publishers

    def look(self) -> None:
        """Tell of each publisher once."""
        for subscription in self._node.subscriptions:
            topic, wanted = subscription.topic_name, subscription.qos_profile
            for publisher in self._node.get_publishers_info_by_topic(topic):
                gid = bytes(publisher.endpoint_gid)
                if gid in self._told:
                    continue
                compatible, why = qos_check_compatible(publisher.qos_profile, wanted)
                if compatible == QoSCompatibility.ERROR:
                    self._told.add(gid)
                    words = "; ".join(filter(None, why.replace("ERROR: ", "").split(";")))
                    self._counters.add(
                        "qos_incompatible",
                        f"{topic}: nothing that {full_name(publisher)} publishes comes here, "
                        f"by its quality of service: {words}",
                    )

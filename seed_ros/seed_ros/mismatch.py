# SPDX-License-Identifier: Apache-2.0
"""Publishers that a node does not hear, as their quality of service is not what it asks for.

rclpy tells that by an event of each subscription, which the streams of a `FixedRateLoop` do without; and silence alone
looks like a driver that does not run.
"""

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible

from seed_ros.diagnostics import Counters


class Mismatch:
    """`look` now and then."""

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
                    path = f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
                    words = "; ".join(filter(None, why.replace("ERROR: ", "").split(";")))
                    self._counters.add(
                        "qos_incompatible",
                        f"{topic}: nothing that {path} publishes comes here, by its quality of service: {words}",
                    )

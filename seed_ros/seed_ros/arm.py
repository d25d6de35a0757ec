# SPDX-License-Identifier: Apache-2.0
"""What a node is told of the arm that follows it, on `arm_hold_reason`; and who sends an arm its targets."""

import time
from collections.abc import Mapping
from math import inf
from typing import Any

from rclpy.node import Node

from seed_core.arm.senders import Senders
from seed_ros.qos import full_name

RESUME = "resend_robot_program"  # service of what moves the arm
TARGETS = "target_frame"
SILENCE = f"no {TARGETS}"  # begins the reason of an arm that heard no target


def arm_holds(node: Node, reason: str) -> str:
    """That the arm holds, and how it is resumed where the name of the topic tells that; '' where it follows targets."""
    if not reason:
        return ""
    arm, _, topic = node.resolve_topic_name("arm_hold_reason").rpartition("/")
    if topic != "hold_reason":
        return f"the arm holds: {reason}"
    if reason.startswith(SILENCE) and "(" not in reason:  # else it tells the cause itself
        reason += " (this computer is too busy, or the controller has ended)"
    first = "" if RESUME in reason else "mend that, then "  # it waits for nothing else
    return f"the arm holds: {reason}; {first}call {arm[1:]}/{RESUME}"


class TargetSenders:
    """Says so when more than one node sends an arm its targets: it would go to the mean of both.

    A node that only could send, as one that waits for a goal, is no matter.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._senders = node, Senders()
        self._names, self._named_at = "", -inf

    def conflict(self, information: Mapping[str, Any]) -> str:
        """Who sends, where that is more than one; information: of each message, as FixedRateLoop.poll gives it."""
        now = time.monotonic()
        if not self._senders.several(information.get("publication_sequence_number"), now):
            return ""
        if now - self._named_at > 1.0:  # [s] the graph is asked no more often
            self._named_at = now
            found = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(TARGETS))
            self._names = " and ".join(sorted(full_name(p) for p in found))
        return f"more than one node sends {TARGETS} ({self._names}): end all but one"

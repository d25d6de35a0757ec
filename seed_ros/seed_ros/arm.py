# SPDX-License-Identifier: Apache-2.0
"""What a node is told of the arm that follows it, on `arm_hold_reason`."""

from rclpy.node import Node

RESUME = "resend_robot_program"  # service of what moves the arm
SILENCE = "no target_frame"  # begins the reason of an arm that heard no target


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

# SPDX-License-Identifier: Apache-2.0
"""What Foxglove may see and press. Nothing else of the graph is forwarded, and nothing is published into it."""

HOST, PORT = "127.0.0.1", 8765
_BUBBLE = ("depth/image_rect_raw", "depth/camera_info", "ir/image_rect_raw", "pressure")
TOPICS = frozenset(
    (
        *(f"bubble_{side}/{what}" for side in ("left", "right") for what in _BUBBLE),
        *("relative_pose", "contact_patches", "estimator/debug_image"),
        *("target_frame", "wrench_estimate", "controller/state", "controller/wrench", "controller/reference"),
        *("controller/ready", "current_pose", "current_twist", "wrench", "joint_states", "gripper/width"),
        *("driver/hold_reason", "driver/robot_mode", "driver/safety_mode", "driver/speed_scaling"),
        *("guard/hold_reason", "sim/hold_reason", "sim/real_time_factor"),
        *(
            f"sim/ground_truth/{what}"
            for what in ("relative_pose", "contact_wrench", "tip_pose", "table_pose", "table")
        ),
        *("tf", "tf_static", "diagnostics", "clock"),
    )
)
STILL = ("Stop", "Cancel")  # always offered: they bring the arm to rest
BUTTONS = ("Reference", "Grasp", "Release", "Enable", "Play")  # with --buttons only


def offered_as(topic: str, namespace: str = "/") -> str | None:
    """The name that Foxglove sees a topic of the graph under, or None where it sees none.

    The cell's namespace is taken off, so that one layout fits every cell. namespace: with its slash.
    """
    root = namespace.rstrip("/") + "/"
    if topic == "/diagnostics":
        return topic
    name = topic.removeprefix(root)
    return f"/{name}" if topic.startswith(root) and name in TOPICS else None

# SPDX-License-Identifier: Apache-2.0
"""Messages in readable form: one line per value, degrees for turns, standard deviations for covariances."""

import time
from typing import Any

import numpy as np
from rclpy.node import Node

from seed_bringup.bags import qos
from seed_bringup.bags.types import message_class
from seed_core.spatial import pose_from_quaternion, rpy_from_rotation

LONG = 12  # an array with more values than this is described, not printed


def published(node: Node) -> dict[str, str]:
    """Topics that somebody publishes, with their types."""
    mine = {name for name, _ in node.get_publisher_names_and_types_by_node(node.get_name(), node.get_namespace())}
    found = sorted(node.get_topic_names_and_types())
    return {n: kinds[0] for n, kinds in found if n not in mine and node.count_publishers(n)}


class Watch:
    """Prints the newest message of a topic, at most `rate` times a second."""

    def __init__(self, node: Node, topic: str, kind: str, rate: float, once: bool) -> None:
        self.count, self.over = 0, False
        self._topic, self._period, self._once = topic, 1.0 / rate, once
        self._began, self._next = time.monotonic(), 0.0
        node.create_subscription(message_class(kind), topic, self._on_message, qos.TO_RECORD)

    def _on_message(self, message: Any) -> None:
        now = time.monotonic()
        self.count += 1
        if now < self._next or self.over:
            return
        self._next, self.over = now + self._period, self._once
        rate = f", {self.count / (now - self._began):.1f} Hz" if self.count > 10 else ""
        print(f"{self._topic}: message {self.count}{rate}\n" + "\n".join(lines(message, "  ")), flush=True)


def lines(message: Any, indent: str = "") -> list[str]:
    """A message, a line for each of its values."""
    out = []
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        text = _one_line(name, value)
        if text is not None:
            out.append(f"{indent}{name}: {text}".rstrip())
        elif hasattr(value, "get_fields_and_field_types"):
            out += [f"{indent}{name}:", *lines(value, indent + "  ")]
        else:
            for number, item in enumerate(value):
                if set(item.get_fields_and_field_types()) == {"key", "value"}:
                    out.append(f"{indent}{item.key}: {item.value}".rstrip())
                    continue
                out += [f"{indent}{name}[{number}]:", *lines(item, indent + "  ")]
    return out


def _one_line(name: str, value: Any) -> str | None:
    """What fits into one line; None: it does not."""
    fields = set(value.get_fields_and_field_types()) if hasattr(value, "get_fields_and_field_types") else set()
    if fields == {"x", "y", "z", "w"}:
        return _turn(value)
    if fields == {"x", "y", "z"}:
        return _numbers([value.x, value.y, value.z])
    if fields == {"sec", "nanosec"}:
        return f"{value.sec + 1e-9 * value.nanosec:.3f} s"
    if fields:
        return None
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, bytes):
        return str(int.from_bytes(value))
    if isinstance(value, str | int | bool):
        return str(value)
    if len(value) and hasattr(value[0], "get_fields_and_field_types"):
        return None
    return _array(name, value)


def _turn(q: Any) -> str:
    """A quaternion as fixed-axis angles."""
    if abs(np.linalg.norm([q.x, q.y, q.z, q.w]) - 1.0) > 1e-3:
        return f"x y z w {_numbers([q.x, q.y, q.z, q.w])} (no rotation)"
    angles = rpy_from_rotation(pose_from_quaternion([q.x, q.y, q.z, q.w], (0.0, 0.0, 0.0))[:3, :3])
    return f"roll pitch yaw {' '.join(f'{a:.2f}' for a in np.rad2deg(angles).round(2) + 0.0)} deg"


def _array(name: str, value: Any) -> str:
    if "covariance" in name and len(value) == 36:
        deviations = np.sqrt(np.maximum(np.diag(np.reshape(value, (6, 6))), 0.0))
        return f"standard deviations {_numbers(deviations)}"
    if len(value) > LONG:
        return f"{len(value)} values"
    return _numbers(value) if len(value) and isinstance(value[0], float | np.floating) else str(list(value))


def _numbers(values: Any) -> str:
    return " ".join(f"{v:.4g}" for v in values)

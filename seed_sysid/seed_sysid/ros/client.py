# SPDX-License-Identifier: Apache-2.0
"""./seed identify --live: sends the goal to a running `sysid` node and shows how it goes; Ctrl-C cancels it."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from seed_msgs.action import IdentifyStiffness

from seed_ros import client_node
from seed_sysid.run.live import LiveError
from seed_sysid.stiffness_map import AXES, UNITS

ACTION = "sysid/identify_stiffness"
PATIENCE = 10.0  # [s] for the node to appear, to accept and to cancel
GONE = 2.0  # [s] without the node during a goal; one that starts afterwards knows nothing of the goal
START = "start it first: ./seed launch seed_sysid identify_launch.xml"


class Client:
    """One goal; a context manager."""

    def __init__(self, namespace: str) -> None:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)  # an interrupt is ours: it cancels
        self._node = client_node("identify", namespace=namespace)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._action = ActionClient(self._node, IdentifyStiffness, ACTION)
        self._name = f"{namespace}/{ACTION}".lstrip("/")
        self._shown = ("", -1)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self._action.destroy()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def run(self, output: Path, poses: str, zero_sensor: bool) -> Any:
        """The result of the goal; an interrupt cancels it. Raises LiveError when there is no node or no answer."""
        self._until(self._action.server_is_ready, f"there is no action {self._name}; {START}")
        goal = IdentifyStiffness.Goal(output=str(output.resolve()), poses=poses, zero_sensor=zero_sensor)
        sent = self._action.send_goal_async(goal, feedback_callback=lambda m: self._show(m.feedback))
        self._until(sent.done, f"{self._name} does not answer")
        handle = sent.result()
        future = handle.get_result_async()
        try:
            self._until(future.done, f"the node of {self._name} is gone; --out {output} goes on", patience=np.inf)
        except KeyboardInterrupt:
            handle.cancel_goal_async()
            self._until(future.done, "the cancellation was not answered: stop the arm by other means")
        return future.result().result

    def _until(self, condition: Callable[[], Any], trouble: str, patience: float = PATIENCE) -> None:
        deadline, alive = time.monotonic() + patience, time.monotonic()
        while not condition():
            self._executor.spin_once(timeout_sec=0.1)
            now = time.monotonic()
            alive = now if np.isfinite(patience) or self._action.server_is_ready() else alive
            if now > deadline or now - alive > GONE:
                raise LiveError(trouble)

    def _show(self, f: Any) -> None:
        if (f.state, f.done) == self._shown or (f.done == self._shown[1] and not sys.stderr.isatty()):
            return
        self._shown = (f.state, f.done)
        left = f"{f.remaining / 60.0:.1f} min left" if np.isfinite(f.remaining) else ""
        text = f"pose {f.done} of {f.total}, grip {f.grip + 1}, {f.state:<9} {left}"
        print(f"\r{text:<70}", end="" if sys.stderr.isatty() else "\n", file=sys.stderr, flush=True)


def identify(output: Path, poses: str, zero_sensor: bool, namespace: str = "/") -> dict[str, Any]:
    """Run one identification on the live cell in a namespace; its figures.

    Raises:
        LiveError: it fails; with the node's words.
    """
    with Client(namespace) as client:
        result = client.run(output, poses, zero_sensor)
    if not result.success:
        raise LiveError(result.message)
    return {
        "stiffness": {"rotation": list(result.rotation), "translation": list(result.translation)},
        "std": {"rotation": list(result.rotation_std), "translation": list(result.translation_std)},
        "stiffness_file": result.stiffness_file,
        "warnings": [w for w in result.message.split("; ") if w],
    }


def table(figures: dict[str, Any], folder: Path) -> str:
    """The figures as text, and what the run has left in its folder."""
    values, deviations = ([*figures[n]["rotation"], *figures[n]["translation"]] for n in ("stiffness", "std"))
    rows = zip(AXES, values, deviations, UNITS, strict=True)
    lines = [f"  {axis:<6}{k:9.3f} +- {std:7.3f} {unit}" for axis, k, std, unit in rows]
    lines = ["stiffness at the middle grip (standard deviations):", *lines]
    lines += [f"warning: {w}" for w in figures["warnings"]]
    if not figures["stiffness_file"]:
        lines.append("no stiffness.yaml is written: an axis is not determined")
    left = sorted(f.name for f in folder.iterdir()) if folder.is_dir() else ["see there, on the computer of the node"]
    return "\n".join([*lines, f"left in {folder}: {', '.join(left)}"])

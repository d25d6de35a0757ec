# SPDX-License-Identifier: Apache-2.0
"""Beside ./seed launch: one line once a cell lacks nothing but what a person does, or what is still missing.

    python -m seed_bringup.ros.started NAMESPACE

It listens to controller/ready, and ends with that line, after a minute, or when its standard input is closed.
"""

import os
import re
import sys
import threading
import time
from collections.abc import Iterator, Mapping

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from seed_ros.node import client_node
from seed_ros.qos import LATCHED

PATIENCE = 15.0  # [s] until it is told what is still missing
LONGEST = 60.0  # [s] that it listens
BY_A_PERSON = re.compile(r"has not been called|\bcall [\w/]+/|no tool in the grasp|no grasp")
REFUSED = "estimate is invalid: "  # before the estimator's own words


class Progress:
    """What is to be said of a cell that starts, from what its controller misses."""

    def __init__(self) -> None:
        self.up = False
        self._parts: Mapping[str, str] | None = None
        self._told = False

    def missing(self, parts: Mapping[str, str]) -> Iterator[str]:
        """What is missing now, by part: of it, words to say."""
        self._parts = parts
        if not self.up and not self._lacks(parts):
            self.up = True
            steps = "; ".join(words.rpartition(REFUSED)[2] for words in parts.values() if words)
            yield f"the cell is up, what is left is yours: {steps}" if steps else "the cell is up and ready"

    def after(self, elapsed: float) -> Iterator[str]:
        """Words to say so long [s] after the launch."""
        if elapsed < PATIENCE or self.up or self._told:
            return
        self._told = True
        if self._parts is None:
            yield f"after {PATIENCE:.0f} s nothing has come on controller/ready: the controller still starts"
        else:
            yield f"after {PATIENCE:.0f} s still missing: {'; '.join(self._lacks(self._parts))}"

    def _lacks(self, parts: Mapping[str, str]) -> list[str]:
        return [words for part, words in parts.items() if words and not _by_a_person(part, words)]


def _by_a_person(part: str, words: str) -> bool:
    """Whether a part that lacks waits for a person: the controller is enabled by one."""
    return part in ("controller", "force") or BY_A_PERSON.search(words) is not None


def main(namespace: str) -> None:
    """Listen and tell."""
    threading.Thread(target=lambda: (sys.stdin.read(), os._exit(0)), daemon=True).start()
    began, progress = time.monotonic(), Progress()
    try:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        node = client_node("seed_client", namespace=namespace)
    except RuntimeError:  # without keys for it, a secured cell starts untold
        return

    def on_ready(message: DiagnosticStatus) -> None:
        for words in progress.missing({v.key: v.value for v in message.values}):
            print(f"[launch] {words}", flush=True)

    node.create_subscription(DiagnosticStatus, "controller/ready", on_ready, LATCHED)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not progress.up and (elapsed := time.monotonic() - began) < LONGEST:
        executor.spin_once(timeout_sec=0.2)
        for words in progress.after(elapsed):
            print(f"[launch] {words}", flush=True)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "")

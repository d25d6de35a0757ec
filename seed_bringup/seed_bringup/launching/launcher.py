# SPDX-License-Identifier: Apache-2.0
"""Starts what a launch file describes and watches over it; the API behind ./seed launch and ./seed demo.

launch = Launch(file, {"namespace": "cell"})
launch.start()
code = launch.wait()      # or poll() in a loop of one's own, then stop()
"""

from __future__ import annotations

import contextlib
import math
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from pathlib import Path

from seed_bringup.launching import reaper
from seed_bringup.launching.description import Node, describe
from seed_bringup.launching.launch_xml import LaunchError
from seed_bringup.launching.process import NodeProcess, Output, exit_text

KILL_AFTER = 1.5  # [s] after SIGTERM; what asks for no longer time has ended within 5 s
POLL = 0.05  # [s]


def print_output(label: str, line: str) -> None:
    """The default output: the node's name in front of each of its lines, as long as somebody can read them."""
    with contextlib.suppress(OSError):
        print(f"[{label}] {line}", flush=True)


class Launch:
    """A launch file and its running nodes. Not for several threads, but any one thread may use it.

    Args:
        file: The launch file, in XML.
        arguments: Its launch arguments by name.
        output: Takes the label of a node, or 'launch', and a line of what it says.

    Raises:
        LaunchError: The file or an argument is wrong; the message names file and line.
    """

    def __init__(
        self, file: str | Path, arguments: Mapping[str, str] | None = None, output: Output = print_output
    ) -> None:
        self.description = describe(Path(file), dict(arguments or {}))
        self.nodes: list[NodeProcess] = []
        self._output = output
        self._output_lock = threading.Lock()
        self._running = contextlib.ExitStack()  # closes the folder of parameter files and the reaper
        self._folder = Path()
        self._reaper: subprocess.Popen[str] | None = None
        self._respawns: list[tuple[float, Node]] = []
        self._code: int | None = None

    def start(self) -> Launch:
        """Start every node; when one cannot start, stop those that did."""
        if os.environ.get("ROS_SECURITY_ENABLE") == "true" and os.environ.get("SEED_ROS") == "wheels":
            raise LaunchError(
                "ROS_SECURITY_ENABLE is set, and the wheels' Fast DDS was built without its security libraries: take "
                "ROS 2 from apt (SEED_ROS=/opt/ros/jazzy), or unset it"
            )
        self._folder = Path(self._running.enter_context(tempfile.TemporaryDirectory(prefix="seed-launch-")))
        command = [sys.executable, "-I", "-S", reaper.__file__]
        self._reaper = subprocess.Popen(command, stdin=subprocess.PIPE, text=True, start_new_session=True)
        self._running.enter_context(self._reaper)  # closes its pipe and waits for it
        for message in self.description.messages:
            self._say("launch", message)
        try:
            for node in self.description.nodes:
                self._start(node)
        except BaseException:
            self.stop()
            raise
        return self

    def poll(self) -> int | None:
        """Look after the nodes once: None while the run goes on, else 0 if every node ended well, 1 if not."""
        for running in list(self.nodes):
            code = running.process.poll()
            if code is not None and self._code is None:
                self._ended(running, code)
        now = time.monotonic()
        for due, node in [r for r in self._respawns if r[0] <= now]:
            self._respawns.remove((due, node))
            self._start(node)
        if self._code is None and not self.nodes and not self._respawns:
            self._code = 0
        return self._code

    def wait(self, timeout: float = math.inf) -> int | None:
        """Poll until the run has ended and stop what is left; None when `timeout` [s] passed first."""
        deadline = time.monotonic() + timeout
        while self.poll() is None:
            if time.monotonic() > deadline:
                return None
            time.sleep(POLL)
        self.stop()
        return self._code

    def stop(self) -> None:
        """End every node and its children: SIGINT, SIGTERM after its `sigterm_timeout`, SIGKILL 1.5 s later."""
        self._code = self._code or 0
        self._respawns.clear()
        started = time.monotonic()
        self._signal(signal.SIGINT)
        timeouts = {running.node.sigterm_timeout for running in self.nodes}
        steps = [
            (t + more, n, t) for t in timeouts for n, more in ((signal.SIGTERM, 0.0), (signal.SIGKILL, KILL_AFTER))
        ]
        for at, number, timeout in sorted(steps):
            if self._all_ended_before(started + at):
                break
            if late := [running for running in self.nodes if running.node.sigterm_timeout == timeout]:
                labels = ", ".join(running.node.label for running in late)
                self._say("launch", f"{labels} still running after {at:.1f} s: {number.name}")
                for running in late:
                    running.signal(number)
        self._all_ended_before(time.monotonic() + 0.4)
        self._running.close()

    def kill(self) -> None:
        """End every node at once."""
        self._code = 1 if self._code is None else self._code
        self._signal(signal.SIGKILL)
        self._all_ended_before(time.monotonic() + 0.5)
        self._running.close()

    def __enter__(self) -> Launch:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _start(self, node: Node) -> None:
        running = NodeProcess(node, self._folder, self._say)
        self.nodes.append(running)
        self._tell_reaper(f"+{running.process.pid}")

    def _ended(self, running: NodeProcess, code: int) -> None:
        """A node ended by itself: start it again, note it, or take the run down."""
        running.finish_output()
        self._forget(running)
        node = running.node
        if node.respawn:
            self._say(
                "launch", f"{node.label} ended with {exit_text(code)}; starting it again in {node.respawn_delay:g} s"
            )
            self._respawns.append((time.monotonic() + node.respawn_delay, node))
        elif code == 0 and not node.shutdown_on_exit:
            self._say("launch", f"{node.label} has finished")
        else:
            self._say("launch", f"{node.label} died with {exit_text(code)} ({node.origin}); shutting down")
            self._code = 1

    def _forget(self, running: NodeProcess) -> None:
        running.signal(signal.SIGKILL)  # children that it left behind
        self.nodes.remove(running)
        self._tell_reaper(f"-{running.process.pid}")

    def _all_ended_before(self, deadline: float) -> bool:
        """Wait for every process group to end; whether they did."""
        while True:
            for running in [n for n in self.nodes if not n.group_alive()]:
                running.finish_output()
                self._forget(running)
            if not self.nodes or time.monotonic() > deadline:
                return not self.nodes
            time.sleep(POLL)

    def _signal(self, number: signal.Signals) -> None:
        for running in self.nodes:
            running.signal(number)

    def _tell_reaper(self, line: str) -> None:
        assert self._reaper is not None
        assert self._reaper.stdin is not None
        with contextlib.suppress(BrokenPipeError, ValueError):  # it was killed, or stop() is called again
            print(line, file=self._reaper.stdin, flush=True)

    def _say(self, label: str, line: str) -> None:
        """Hand a line to the output, one at a time."""
        with self._output_lock:
            self._output(label, line)

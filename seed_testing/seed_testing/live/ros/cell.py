# SPDX-License-Identifier: Apache-2.0
"""A live cell with a client that prepares it, plays tasks and listens to what every node says of itself."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Float32

from seed_bringup.bags.recording import recording
from seed_bringup.demo.live import RECORDED
from seed_bringup.launching.launcher import Launch
from seed_bringup.launching.packages import find_launch_file
from seed_bringup.ros.session import Played, Session, SessionError
from seed_testing.live.processes import Usage, named, usage

STARTS_WITHIN = 60.0  # [s] on a busy machine
FIGURES = ("pairs", "sets_missing", "images_refused", "overruns", "holds")


class Cell:
    """A context manager: the graph of `demo_launch.xml`, and a session in it.

    Attributes:
        session: the client.
        said: newest diagnostics of each node: level, message, values.
        also: called often while anything is waited for.
        page: address of the operator page, once it serves; empty without one.
    """

    session: Session

    def __init__(
        self, arguments: Mapping[str, str], log: Path, record: Path | None = None, launch_file: str = "demo"
    ) -> None:
        self.arguments = dict(arguments)
        self.images = arguments.get("method", "rigid_fit") != "truth"
        self.ur = arguments.get("robot") == "ur"
        self.said: dict[str, tuple[int, str, dict[str, str]]] = {}
        self.factors: list[float] = []
        self.also: Callable[[], None] = lambda: None
        self.page = ""
        self._record, self._log = record, log
        self._death, self._last = "", dict[str, str]()  # why the cell ended; the last line of each node
        self.launch = Launch(find_launch_file([launch_file]), self.arguments, self._tell)
        self._stack = ExitStack()

    def __enter__(self) -> Cell:
        with ExitStack() as stack:
            self._file = stack.enter_context(self._log.open("w", encoding="utf-8"))
            stack.enter_context(self.launch)
            if self._record is not None:
                stack.enter_context(recording(self._record, RECORDED))
            self.session = Session(self._watch, follow=False)
            stack.callback(self.session.close)
            node = self.session.node
            node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 20)
            node.create_subscription(Float32, "sim/real_time_factor", lambda m: self.factors.append(m.data), 10)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _tell(self, label: str, line: str) -> None:
        print(f"[{label}] {line}", file=self._file, flush=True)
        if label == "page" and "http://" in line:
            self.page = line.split()[-1]
        if label == "launch" and "died" in line:
            self._death = f"{line}; it said last: {self._last.get(line.split(' ')[0], 'nothing')}"
        self._last[label] = line

    def _watch(self) -> None:
        if self.launch.poll() is not None:
            raise SessionError(f"the cell ended early: {self._death or 'nobody says why'}")
        self.also()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for s in message.status:
            level = s.level[0] if isinstance(s.level, bytes) else int(s.level)
            self.said[s.name.lstrip("/").split(":")[0]] = level, s.message, {v.key: v.value for v in s.values}

    # what one does with a gripper
    def prepare(self) -> None:
        """Picture the empty bubbles, grasp, picture the grasp."""
        if self.images:
            self.session.trigger("estimator/capture_reference", patience=STARTS_WITHIN)
        self.session.trigger("sim/grasp", patience=STARTS_WITHIN)
        self.session.spin(0.5)
        self.initialize()

    def initialize(self) -> None:
        """Count deflections from the tool as it is held."""
        if self.images:
            self.session.trigger("estimator/initialize_grasp", patience=STARTS_WITHIN)

    def enable(self) -> None:
        """Arm and controller."""
        self.session.enable("driver/resend_robot_program" if self.ur else "sim/resend_robot_program", patience=30.0)

    def play(self, task: str, patience: float) -> Played:
        """A task to its end."""
        self.session.played = Played()
        return self.session.play(task, None, lambda _: None, patience)

    def recover(self) -> None:
        """After a hold: put the tool back, and take everything anew."""
        with suppress(SessionError):
            self.session.switch("controller/enable", False)
        if not self.ur:
            self.session.trigger("sim/reset")
        else:
            with suppress(SessionError):
                self.session.trigger("sim/release")
        self.session.spin(1.0)
        self.prepare()

    # what it uses and says
    def pids(self) -> dict[str, int]:
        """Processes by name, of the nodes and of what they started."""
        return named({n.process.pid: n.node.label for n in self.launch.nodes})

    def usage(self) -> dict[str, Usage]:
        """Of every process, this one included as `client`."""
        used = {name: usage(pid) for name, pid in (self.pids() | {"client": os.getpid()}).items()}
        return {name: u for name, u in used.items() if u is not None}

    def figures(self) -> dict[str, float]:
        """What the nodes count, as `node.figure`, and the newest real-time factor."""
        found: dict[str, float] = {"real_time_factor": self.factors[-1] if self.factors else float("nan")}
        for node, (_, _, values) in self.said.items():
            found |= {f"{node}.{key}": float(values[key]) for key in FIGURES if key in values}
        return found

    def bag_mb(self) -> float:
        """[MB] that the recorder has written."""
        return 0.0 if self._record is None else _size(self._record)


def _size(path: Path) -> float:
    files: list[Path] = [path] if path.is_file() else [f for f in path.parent.rglob("*") if f.is_file()]
    return sum(f.stat().st_size for f in files) / 1e6

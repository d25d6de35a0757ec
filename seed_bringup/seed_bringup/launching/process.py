# SPDX-License-Identifier: Apache-2.0
"""One running node: its command line, its process group, its output marked with its name."""

import signal
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import yaml

from seed_bringup.launching.description import Node
from seed_bringup.launching.reaper import signalled

Output = Callable[[str, str], None]  # (label, line)


def command_line(node: Node, folder: Path) -> list[str]:
    """The node's arguments; parameters go through files written to `folder`, so that types survive."""
    remappings = [*node.remappings]
    if node.namespace:
        remappings.insert(0, ("__ns", node.namespace))
    if node.name:
        remappings.insert(0, ("__node", node.name))
    ros = [word for source, target in remappings for word in ("-r", f"{source}:={target}")]
    for parameters in node.parameters:
        file = parameters
        if not isinstance(file, Path):
            target = f"{node.namespace}/{node.name}" if node.name else "/**"
            with tempfile.NamedTemporaryFile("w", dir=folder, suffix=".yaml", delete=False) as written:
                yaml.safe_dump({target: {"ros__parameters": parameters}}, written)
            file = Path(written.name)
        ros += ["--params-file", str(file)]
    return [str(node.executable), *node.arguments, *(["--ros-args", *ros] if ros else [])]


class NodeProcess:
    """Starts on construction, in a process group of its own; a thread hands its lines to `output`."""

    def __init__(self, node: Node, folder: Path, output: Output) -> None:
        self.node = node
        self.interrupted = False  # by us
        self.process = subprocess.Popen(
            command_line(node, folder),
            env=node.environment | {"PYTHONUNBUFFERED": "1"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
            # A launcher started in the background ignores SIGINT, and its children would inherit that.
            preexec_fn=_take_signals,
        )
        self._reader = threading.Thread(target=self._read, args=(output,), daemon=True)
        self._reader.start()

    def _read(self, output: Output) -> None:
        assert self.process.stdout is not None
        lines = (line.rstrip("\n") for line in self.process.stdout)
        for line in without_interrupts(lines, lambda: self.interrupted):
            output(self.node.label, line)

    def signal(self, number: int) -> None:
        """Send to the whole group, which may outlive its first process."""
        self.interrupted = True
        signalled(self.process.pid, number)

    def group_alive(self) -> bool:
        """Whether any process of the group still runs."""
        if self.process.poll() is None:
            return True
        # Where nobody adopts orphans (containers without an init), dead ones stay in the group as zombies.
        return signalled(self.process.pid, 0) and any(
            _runs_in_group(stat, self.process.pid) for stat in Path("/proc").glob("[0-9]*/stat")
        )

    def finish_output(self) -> None:
        """Wait for the last lines."""
        self._reader.join(timeout=0.5)


# How the end of a Python program begins that an interrupt meets, the latter two before it has loaded anything
_DYING = ("Traceback (", "Fatal Python error: init_import_site", "Python runtime state: ")


def without_interrupts(lines: Iterable[str], interrupted: Callable[[], bool]) -> Iterator[str]:
    """Leave out the tracebacks of Python programs that our interrupt met while they were still starting."""
    held: list[str] = []  # a traceback, until its last line tells what it was
    dying = False
    for line in lines:
        if interrupted() and (line.startswith(_DYING) or (held and line.startswith(" "))):
            held.append(line)
            continue
        dying = dying or any("_find_and_load" in part for part in held)  # in an import an interrupt becomes any error
        if dying:
            continue
        if not (held and line == "KeyboardInterrupt"):
            yield from [*held, line]
        held.clear()
    if not dying:
        yield from held


def _runs_in_group(stat: Path, group: int) -> bool:
    try:
        state, _, process_group = stat.read_text().rpartition(")")[2].split()[:3]
    except OSError:
        return False
    return int(process_group) == group and state not in "ZX"


def _take_signals() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def exit_text(code: int) -> str:
    """An exit code for people: 'exit code 3' or 'exit code -11, signal SIGSEGV'."""
    names = {-number: f", signal {number.name}" for number in signal.Signals}
    return f"exit code {code}{names.get(code, '')}"

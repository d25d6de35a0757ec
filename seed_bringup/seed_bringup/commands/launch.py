# SPDX-License-Identifier: Apache-2.0
"""./seed launch FILE [name:=value ...]: by `ros2 launch` where it exists, else by our launcher."""

import os
import shutil
import signal
import sys
from pathlib import Path
from types import FrameType

from seed_bringup.launching.description import TERM_AFTER, declared_arguments, describe
from seed_bringup.launching.domains import SHARED, VARIABLE, claimed, running
from seed_bringup.launching.launch_xml import LaunchError
from seed_bringup.launching.launcher import KILL_AFTER, Launch
from seed_bringup.launching.packages import find_launch_file
from seed_core.program.command_line import Parser, command


@command("seed launch")
def main(argv: list[str]) -> int:
    """Parse, check every argument, run; 1 when a node failed."""
    parser = Parser(prog="seed launch", description=__doc__)
    parser.add_argument("words", nargs="+", metavar="WORD", help="FILE, or PACKAGE FILE, and arguments as name:=value")
    parser.add_argument("-s", "--show-args", action="store_true", help="list the arguments of the launch file")
    parser.add_argument("--own", action="store_true", help="our launcher even where ros2 launch exists")
    options = parser.parse_args(argv)
    words = [w for w in options.words if ":=" not in w]
    if not 1 <= len(words) <= 2:
        raise LaunchError("name one launch file: FILE or PACKAGE FILE, then arguments as name:=value")
    file = find_launch_file(words)
    if options.show_args:
        print(describe_arguments(file))
        return 0
    arguments = dict(w.split(":=", 1) for w in options.words if ":=" in w)
    others = running()
    with claimed(SHARED, " ".join(["launch", *options.words])) as domain:
        if domain in others:
            print(
                f"[launch] warning: '{others[domain]}' runs in ROS domain {domain}, too, and both hear each other: "
                f"leave {VARIABLE} unset for a domain of its own, or give one of them a namespace",
                flush=True,
            )
        if domain:
            print(f"[launch] in ROS domain {domain}; other terminals: export {VARIABLE}={domain}", flush=True)
        if shutil.which("ros2") and not options.own:
            return _by_ros2(file, arguments)
        return run(Launch(file, arguments))


def describe_arguments(file: Path) -> str:
    """One line for each launch argument: name, default, choices, what it does."""
    lines = [f"Arguments of {file.name} (give as name:=value):"]
    for argument in declared_arguments(file):
        default = "required" if argument.default is None else f"default {argument.default!r}"
        choices = f", one of {', '.join(argument.choices)}" if argument.choices else ""
        lines.append(f"  {argument.name} ({default}{choices})\n      {argument.description or 'no description'}")
    return "\n".join(lines if len(lines) > 1 else [f"{file.name} takes no arguments"])


def run(launch: Launch) -> int:
    """Run until the nodes end or a signal comes; a second signal kills."""
    signals: list[int] = []

    def on_signal(number: int, frame: FrameType | None) -> None:
        del frame
        signals.append(number)
        if len(signals) > 1:
            launch.kill()
            os._exit(128 + number)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, on_signal)
    launch.start()
    print(f"[launch] {len(launch.nodes)} nodes running; Ctrl-C ends them", flush=True)
    code: int | None = None
    while code is None and not signals:
        code = launch.wait(timeout=0.2)
    if code is None:
        print("[launch] stopping", flush=True)
        launch.stop()
        return 128 + signals[0]
    return code


def _by_ros2(file: Path, arguments: dict[str, str]) -> int:
    """`ros2 launch` takes unknown arguments in silence, so they are checked here first."""
    describe(file, arguments)
    timeouts = {"sigterm_timeout": TERM_AFTER, "sigkill_timeout": KILL_AFTER}
    words = [f"{name}:={value}" for name, value in (arguments | timeouts).items()]
    sys.stdout.flush()
    os.execvp("ros2", ["ros2", "launch", str(file), *words])

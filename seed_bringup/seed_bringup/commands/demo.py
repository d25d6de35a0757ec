# SPDX-License-Identifier: Apache-2.0
"""./seed demo: the simulated cell, live, plays a task on tactile images; ends with a report.

Every process of the real graph runs: simulation, cameras, estimator, controller, and a recorder.

--world hidden: the tool is held between two membranes with mechanics (coarsely meshed), drawn from --seed with the
tool's weight and the table's tilt and friction. Estimator and controller are told none of it: first the suite's own
identification runs on these very membranes, and the controller works with the map that it finds. --world known: the
grasp is a spring whose stiffness the controller knows; no identification, so it is over sooner.

The exit code is 0 only if the force was held against the simulation's own contact forces: at most 1.0 N and 0.15 N m
rms in a hidden world, 0.5 N and 0.08 N m in the known one.
"""

import argparse
import signal
import time
from dataclasses import replace
from pathlib import Path

from seed_bringup.demo.baselines import finished, running_baselines
from seed_bringup.demo.conclusion import conclude
from seed_bringup.demo.hidden import FOUND, HIDDEN, at_camera_rate, find_out, write_scenario
from seed_bringup.demo.live import CORES, SMALL_CAMERA_RATE, camera_rate_of, play_live
from seed_bringup.demo.plan import Plan, plan
from seed_bringup.demo.score import TOPICS
from seed_bringup.demo.series import read_series
from seed_bringup.demo.terminal import say
from seed_bringup.launching.domains import OWN, claimed
from seed_control.parameters import LAW_HELP, LAWS
from seed_control.tasks import LEAST_FORCE, MOST_FORCE
from seed_core.program.command_line import Parser, command, interrupts, number, seed_number
from seed_estimation.parameters import METHOD_HELP, METHODS

BASELINES = ("open_loop", "welded")
BASELINE_PATIENCE = 300.0  # [s]


def _parser() -> argparse.ArgumentParser:
    p = Parser(prog="seed demo", description=__doc__)
    p.add_argument("--task", default="squeegee", help="name of a shipped task, or a task file")
    p.add_argument(
        "--force",
        type=number(LEAST_FORCE, "N", MOST_FORCE),
        help="[N] size of every force in the task; the task's own if left out",
    )
    p.add_argument("--seed", type=seed_number, default=7, help="draws the table, all noise and the hidden world")
    p.add_argument(
        "--world",
        choices=("known", "hidden"),
        help="what is told to the controller; default: hidden for a plain wipe, known with another task, estimator, "
        "scenario or robot",
    )
    p.add_argument("--scenario", help="what is simulated: a shipped scenario or a file; the task's own if left out")
    p.add_argument(
        "--estimator",
        default="rigid_fit",
        choices=(*METHODS, "truth"),
        help=f"of the pose: {METHOD_HELP}; truth is exact",
    )
    p.add_argument("--law", default="seed", choices=LAWS, help=f"control law: {LAW_HELP}")
    p.add_argument("--out", type=Path, help="folder to write; default: results/TASK-TIME")
    p.add_argument("--images", action="store_true", help="record the cameras' images in the bag too (20 MB/s)")
    p.add_argument(
        "--camera-rate",
        type=number(0.0, "Hz"),
        default=0.0,
        help="[Hz] of the simulated cameras; default: the scenario's, "
        f"or {SMALL_CAMERA_RATE:g} where there are fewer than {CORES} cores",
    )
    p.add_argument("--no-view", action="store_true", help="do not serve the operator page meanwhile")
    p.add_argument("--verbose", action="store_true", help="show what the nodes say")
    p.add_argument(
        "robot",
        nargs="*",
        default=["robot:=sim"],
        metavar="NAME:=VALUE",
        help="robot:=ur [robot_ip:=127.x.y.z]: the UR driver and ur_rtde in the loop, against the stand-in controller",
    )
    return p


@command("seed demo")
def main(argv: list[str]) -> int:
    """Play the task, then write the report; 0 only if the force was held."""
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, signal.default_int_handler)
    options = _parser().parse_args(argv)
    with claimed(OWN, " ".join(["demo", *argv])) as domain:
        return _demo(options, domain)


def _demo(options: argparse.Namespace, domain: int) -> int:
    started = time.monotonic()
    asked = plan(options, domain)
    o = asked.options
    say(f"task {asked.task.name}, scenario {asked.scenario.name}, seed {o.seed}, estimator {o.estimator}")
    say(f"results go to {asked.folder}; the cell runs in ROS domain {domain} of its own")
    try:
        return _played(asked, started)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"what there is so far is in {asked.folder}") from None


def _played(asked: Plan, started: float) -> int:
    o, findings = asked.options, None
    if asked.hidden:
        findings = find_out(asked.scenario, o.seed, asked.folder / FOUND)
        asked = replace(asked, scenario=at_camera_rate(findings.scenario, camera_rate_of(o)))
        write_scenario(asked.scenario, asked.folder / HIDDEN)  # gripped as the procedure found to be needed
    with interrupts() as check:
        live = play_live(asked, findings.believed if findings else asked.scenario, check)
    with running_baselines(BASELINES, o.task, o.force, o.seed, asked.scenario_name) as running:
        series = read_series(asked.folder / "bag.mcap", TOPICS)
        say("baselines: open loop and welded, on the same table")
        baselines = finished(running, BASELINE_PATIENCE)
    held = conclude(asked, live, series, baselines, findings)
    say(f"it took {time.monotonic() - started:.0f} s; look at {asked.folder / 'report.html'}")
    return 0 if held else 1

# SPDX-License-Identifier: Apache-2.0
"""./seed dataset: bags or evaluations as a LeRobot dataset."""

import argparse
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from seed_bringup.commands.developer import checkout
from seed_bringup.dataset.environment import make, run
from seed_bringup.dataset.episode import Episode, write_arrays
from seed_control.tasks import load_task
from seed_core.errors import FailedError, SeedError
from seed_core.program.command_line import Parser, command, interrupts, leaving_at_once, whole
from seed_sim.closed_loop.relative_poses import ESTIMATORS, GEL

REQUIREMENTS = "requirements/lerobot.txt"
OFFERED = tuple(e for e in ESTIMATORS if e != GEL)  # no task names a scenario with gels


@command("seed dataset")
def main(argv: list[str]) -> int:
    """Make one dataset."""
    p = Parser(
        prog="seed dataset",
        description="Make a LeRobot dataset of bags, or of a task in closed loop without ROS. LeRobot and torch are\n"
        "installed into an environment of their own the first time (up to 9 GB), never into the suite's.",
    )
    p.add_argument("out", nargs="?", type=Path, help="folder to make; one that exists is refused")
    p.add_argument("bags", nargs="*", type=Path, help="bags: each stretch with a set-point is an episode")
    p.add_argument("--evaluate", metavar="TASK", help="instead of bags: a task, by name or file, as ./seed evaluate")
    p.add_argument("--episodes", type=whole(1), default=10, help="of --evaluate; one per seed")
    p.add_argument("--seed", type=whole(0), default=0, help="first seed of --evaluate")
    p.add_argument("--estimator", choices=OFFERED, default="rigid_fit", help="of --evaluate; truth: without images")
    p.add_argument("--text", default="", help="the task in words; with bags it must be given")
    p.add_argument("--fps", type=whole(1, 250), default=25, help="frames a second")
    p.add_argument("--namespace", default="", help="of the cell that was recorded")
    p.add_argument("--repo-id", default="seed/dataset", help="name of the dataset on the hub; nothing is sent there")
    p.add_argument("--arrays", action="store_true", help="plain NumPy files instead; needs no LeRobot")
    options = p.parse_args(argv)
    if options.out is None:
        p.error("name the folder to make")
    if bool(options.bags) == bool(options.evaluate):
        raise SeedError("name bags, or a task with --evaluate, and not both")
    if options.bags and not options.text:
        raise SeedError("say with --text in words what the bags show: a policy is told the task by that")
    if options.out.exists():
        raise SeedError(f"{options.out} exists already: name another folder, datasets are never overwritten")
    _check(options)  # all that can be wrong with the arguments, before gigabytes are fetched
    python = None if options.arrays else make(checkout() / REQUIREMENTS)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with (
        interrupts() as check,
        tempfile.TemporaryDirectory(dir=options.out.parent, prefix=f".{options.out.name}-") as folder,
    ):
        arrays, made = Path(folder, "arrays"), Path(folder, "dataset")
        info = write_arrays(_episodes(options, check), arrays)
        if python is not None:
            script = Path(__file__).with_name("lerobot_writer.py")
            run(python, script, str(arrays), str(made), options.repo_id, check=check)
        check()
        shutil.move(made if python is not None else arrays, options.out)
    frames = sum(e["frames"] for e in info["episodes"])
    print(f"{options.out}: {len(info['episodes'])} episodes, {frames} frames at {info['fps']} a second")
    print(f"  {', '.join(info['fields'])}")
    return 0


def _check(options: argparse.Namespace) -> None:
    """Raises SeedError: bags or task cannot become a dataset."""
    with leaving_at_once("dataset"):
        from seed_bringup.dataset import episodes_bag, evaluations
    for bag in options.bags:
        episodes_bag.check(bag, options.namespace)
    if options.evaluate:
        evaluations.check(load_task(options.evaluate), options.fps, options.estimator)


def _tell(words: str) -> None:
    print(f"seed dataset: {words}", file=sys.stderr, flush=True)


def _episodes(options: argparse.Namespace, check: Callable[[], None]) -> Iterator[Episode]:
    """One after the other; check: is called all along, and raises where the command is to end."""
    from seed_bringup.dataset import episodes_bag, evaluations

    for bag in options.bags:
        yield from episodes_bag.episodes_of(bag, options.fps, options.text, options.namespace, _tell, check)
    if options.bags:
        return
    task = load_task(options.evaluate)
    for seed in range(options.seed, options.seed + options.episodes):
        try:
            episode = evaluations.evaluated(task, seed, options.fps, options.estimator, options.text, check)
        except FailedError as error:
            _tell(str(error))
            continue
        print(f"seed {seed}: {len(episode)} frames", file=sys.stderr, flush=True)
        yield episode

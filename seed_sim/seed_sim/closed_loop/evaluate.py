# SPDX-License-Identifier: Apache-2.0
"""`./seed evaluate`: the closed loop without ROS, for one seed or swept over scenarios."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from seed_control.tasks import Task, load_task
from seed_core.command_line import Help, command, seed_number, to_json, whole
from seed_core.errors import SeedError
from seed_sim.closed_loop.baselines import run_baseline
from seed_sim.closed_loop.recording import score
from seed_sim.closed_loop.run import Progress, Run, run_closed_loop
from seed_sim.closed_loop.sources import ESTIMATORS
from seed_sim.scenario import Scenario, load_scenario, shipped_scenarios

LAWS = ("seed", "plain", "published", "open_loop", "welded", "welded_roll")
BASELINES = ("open_loop", "welded", "welded_roll")
SCENARIO_OF_TASK = {"squeegee": "nominal", "write": "pen"}  # others have a scenario of their own name


@dataclass(frozen=True)
class Evaluation:
    """One run and its score."""

    result: dict[str, Any]
    run: Run


def scored_phase(task: Task) -> str:
    """The phase that is scored: the named 'wipe', strokes, the one with the largest torque, or the last with force."""
    if task.draw is not None:
        return "draw"
    controls = {p.name: p.control for p in task.phases if p.control is not None}
    if not controls:
        raise SeedError(f"task '{task.name}' controls no force in any phase: there is nothing to score")
    largest = max(controls, key=lambda name: sum(t * t for t in controls[name].torque))
    if "wipe" in controls or not any(controls[largest].torque):
        return "wipe" if "wipe" in controls else list(controls)[-1]
    return largest


def run(
    task: str | Task = "squeegee",
    *,
    law: str = "seed",
    estimator: str = "truth",
    force: float | None = None,
    seed: int = 0,
    scenario: str | Path | Scenario | None = None,
    meshcat: Any = None,
    progress: Progress | None = None,
) -> Evaluation:
    """Play a task once in closed loop and score it; deterministic per seed but for `real_time_factor`.

    Args:
        task: name, path or task.
        force: [N] replaces the size of every force in the task.
        scenario: name, file or scenario; default: the task's own.

    Raises:
        SeedError: unknown names, or values that cannot be used.
    """
    loaded = load_task(task, force) if isinstance(task, str) else task
    name = scenario if scenario is not None else SCENARIO_OF_TASK.get(loaded.name, loaded.name)
    what = name if isinstance(name, Scenario) else load_scenario(name)
    if law in BASELINES:
        done = run_baseline(what, loaded, kind=law, seed=seed, meshcat=meshcat)
    elif law in LAWS:
        done = run_closed_loop(
            what, loaded, law=law, estimator=estimator, seed=seed, meshcat=meshcat, progress=progress
        )
    else:
        raise SeedError(f"law '{law}' is unknown; known: {', '.join(LAWS)}")
    recording = done.recording
    result = {
        "task": loaded.name,
        "scenario": what.name,
        "law": law,
        "seed": seed,
        "estimator": "none" if law in BASELINES else estimator,
        **score(recording, scored_phase(loaded)),
        "message": recording.message,
        "real_time_factor": done.plant.time / max(recording.wall_time, 1e-9),
    }
    return Evaluation(result, done)


# --- command line ------------------------------------------------------------------------------------------------
def _parser() -> argparse.ArgumentParser:
    p = argparse.ArgumentParser(
        prog="seed evaluate",
        formatter_class=Help,
        description="Play a task in closed loop without ROS, faster than real time, and score the plant's own forces.\n"
        "With --scenarios N, sweep over seeds and columns.",
    )
    p.add_argument("task", help="name of a shipped task (squeegee, pen, write, torque_driver, peg) or a task file")
    p.add_argument("--law", choices=LAWS, default="seed", help="control law or baseline")
    p.add_argument(
        "--estimator",
        choices=ESTIMATORS,
        default="truth",
        help="where relative poses come from: exact; exact with noise and delay; rendered images",
    )
    p.add_argument("--force", type=float, help="[N] size of every force in the task; its own if left out")
    p.add_argument("--seed", type=seed_number, default=7, help="draws table and errors; first seed of a sweep")
    p.add_argument("--scenario", help=f"one of {', '.join(shipped_scenarios())}, or a file; the task's own if left out")
    p.add_argument("--scenarios", type=whole(1), metavar="N", help="sweep: seeds per column")
    p.add_argument(
        "--column",
        action="append",
        choices=shipped_scenarios(),
        metavar="NAME",
        help="sweep: only this column, any shipped scenario (may be repeated)",
    )
    p.add_argument("--jobs", type=whole(1), default=1, metavar="J", help="sweep: processes")
    p.add_argument("--plot", type=Path, help="sweep: where to write the plot (PNG)")
    p.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return p


def _print_result(r: dict[str, Any]) -> None:
    f, x, lean = r["force_z"], r["torque_x"], r["lean_deg"]
    print(f"{r['task']}, scenario {r['scenario']}, seed {r['seed']}, law {r['law']}, estimator {r['estimator']}")
    print(f"  force z    rmse {f['rmse']:8.3f} N     mean {f['mean']:8.3f} N     worst {f['max_abs_error']:8.3f} N")
    print(f"  torque x   rmse {x['rmse']:8.3f} N m   mean {x['mean']:8.3f} N m   worst {x['max_abs_error']:8.3f} N m")
    z = r.get("torque_z")
    if z is not None and z["mean"]:
        worst = z["max_abs_error"]
        print(f"  torque z   rmse {z['rmse']:8.3f} N m   mean {z['mean']:8.3f} N m   worst {worst:8.3f} N m")
    print(f"  lean       rms  {lean['rms']:8.2f} deg   worst {lean['max']:7.2f} deg")
    print(f"  path       rmse {r['path_rmse_mm']:8.2f} mm")
    made = r["contact"]
    when = f"at {made['time']:.2f} s" if made["made"] else "never"
    print(f"  contact    {when}; {r['message'] or 'no end'}")
    print(f"  simulated {r['real_time_factor']:.1f} times faster than real time")


class _Bar:
    """Progress of one run on a terminal."""

    def __init__(self) -> None:
        from tqdm import tqdm

        self._bar = tqdm(total=100, bar_format="{l_bar}{bar}| {postfix}", leave=False, disable=not sys.stderr.isatty())

    def __call__(self, share: float, phase: str) -> None:
        self._bar.n = round(100 * share)
        self._bar.set_postfix_str(phase)

    def close(self) -> None:
        self._bar.close()


@command("seed evaluate")
def main(argv: list[str]) -> int:
    """Command line: 1 when the task did not come to its end."""
    parser = _parser()
    args = parser.parse_args(argv)
    if args.scenarios:
        from seed_sim.closed_loop.sweep import sweep_command

        return sweep_command(args)
    for name in ("column", "plot"):
        if getattr(args, name) is not None:
            parser.error(f"--{name} belongs to a sweep: give --scenarios N as well")
    bar = _Bar()
    try:
        result = run(
            args.task,
            law=args.law,
            estimator=args.estimator,
            force=args.force,
            seed=args.seed,
            scenario=args.scenario,
            progress=bar,
        ).result
    finally:
        bar.close()
    if args.json:
        print(to_json(result))
    else:
        _print_result(result)
    return 0 if result["finished"] else 1


if __name__ == "__main__":
    sys.exit(main())

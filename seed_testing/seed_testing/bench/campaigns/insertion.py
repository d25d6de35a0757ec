# SPDX-License-Identifier: Apache-2.0
"""Insertion over drawn cells: how often it succeeds, in what time, with what force. A line per case can be kept."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed

from seed_control.tasks import load_task
from seed_core.errors import SeedError
from seed_core.program.command_line import Parser, command, seed_number, whole
from seed_sim.campaigns import keep_run, kept_runs
from seed_sim.closed_loop.evaluate import evaluate, scenario_of
from seed_sim.closed_loop.progress import in_parallel
from seed_sim.closed_loop.relative_poses import ESTIMATORS
from seed_sim.scenario import Scenario, load_scenario
from seed_testing.figures import text

CASES = 60
MOST_FORCE = 12.0  # [N]
SETTINGS = ("task", "estimator", "clearance")


def one_case(settings: dict[str, Any], seed: int) -> dict[str, Any]:
    """The score of one case; one that breaks is no success."""
    try:
        result = evaluate(
            settings["task"], estimator=settings["estimator"], seed=seed, scenario=_scenario(settings)
        ).result
    except SeedError as error:
        return {**settings, "seed": seed, "success": False, "message": str(error)}
    return {**settings, "seed": seed, "message": result["message"], **(result["insertion"] or {"success": False})}


def _scenario(settings: dict[str, Any]) -> Scenario:
    """The task's own, with another clearance if one is given."""
    scenario = load_scenario(scenario_of(load_task(settings["task"])))
    if scenario.hole is None:
        raise SeedError(f"task '{settings['task']}' has no hole to go into: give insert_peg or insert_plug")
    if settings["clearance"] is None:
        return scenario
    return replace(scenario, hole=replace(scenario.hole, clearance=settings["clearance"]))


def run(settings: dict[str, Any], seeds: Sequence[int], jobs: int = 1, out: Path | None = None) -> list[dict[str, Any]]:
    """Every case, those that `out` has from there.

    Raises:
        SeedError: the file holds cases of other settings, or the task has no hole.
    """
    _scenario(settings)
    cases = _known(out, settings)
    todo = [seed for seed in seeds if seed not in cases]
    for case in in_parallel([delayed(one_case)(settings, seed) for seed in todo], jobs, "case"):
        cases[case["seed"]] = case
        keep_run(out, json.dumps(case))
    return [cases[seed] for seed in seeds]


def _known(out: Path | None, settings: dict[str, Any]) -> dict[int, dict[str, Any]]:
    def of_these(case: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        if any(case[name] != settings[name] for name in SETTINGS):
            raise ValueError("one with other settings")
        return int(case["seed"]), case

    return dict(kept_runs(out, of_these, "a case of this campaign"))


def summarised(cases: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Share of successes, and over them the time from contact to the depth; the forces over all cases."""
    good = [c for c in cases if c["success"]]
    forces = [c["largest_force"] for c in cases if "largest_force" in c]
    times = [c["inserted"] for c in good if c["inserted"] is not None]
    searched = [c["found"] for c in good if c["found"] is not None]  # a task that knows its hole searches none
    return {
        "cases": len(cases),
        "successes": len(good),
        "success_share": len(good) / len(cases),
        "time_mean_s": float(np.mean(times)) if times else None,
        "time_p90_s": float(np.percentile(times, 90)) if times else None,
        "search_mean_s": float(np.mean(searched)) if searched else None,
        "force_p90_n": float(np.percentile(forces, 90)) if forces else None,
        "force_worst_n": max(forces, default=None),
        "squeeze_worst_n": max((c["squeeze"] for c in cases if "squeeze" in c), default=None),
        f"beyond_{MOST_FORCE:g}_n": [c["seed"] for c in cases if c.get("largest_force", 0.0) > MOST_FORCE],
        "failed": {c["seed"]: c["message"] for c in cases if not c["success"]},
    }


@command("seed bench insertion")
def main(argv: list[str]) -> int:
    """Command line."""
    p = Parser(prog="seed bench insertion", description=__doc__)
    p.add_argument("--task", default="insert_peg", help="insert_peg, insert_plug or a file; default: %(default)s")
    p.add_argument("--cases", type=whole(1), default=CASES, help="how many; default: %(default)s")
    p.add_argument("--seed", type=seed_number, default=1000, help="of the first case; default: %(default)s")
    p.add_argument("--estimator", choices=ESTIMATORS, default="noisy", help="of the tool's pose; default: %(default)s")
    p.add_argument("--clearance", type=float, help="[mm] instead of the scenario's")
    p.add_argument("--jobs", type=whole(1), default=1, help="processes; default: %(default)s")
    p.add_argument("--out", type=Path, metavar="FILE", help="a JSON line per case; cases in it are not repeated")
    p.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    options = p.parse_args(argv)
    settings = {name: getattr(options, name) for name in SETTINGS}
    seeds = range(options.seed, options.seed + options.cases)
    cases = run(settings, seeds, options.jobs, options.out)
    summary = {**settings, "first_seed": options.seed, **summarised(cases)}
    print(json.dumps({**summary, "each": cases}) if options.json else "\n".join(text(summary)))
    return 0

# SPDX-License-Identifier: Apache-2.0
"""Many runs of a task along surfaces that nobody drew, of every kind in turn, and the table of what they came to."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed

from seed_core.errors import SeedError
from seed_sim.campaigns import keep_run, kept_runs
from seed_sim.closed_loop.evaluate import evaluate
from seed_sim.closed_loop.progress import in_parallel

SMOOTH = ("cylinder", "hollow", "sphere", "saddle", "relief")
ROUGH = ("wedge", "step_up", "step_down", "edge", "moving_table")
SCENARIOS = (*SMOOTH, *ROUGH)
MEAN_FORCE, WORST_FORCE = 0.3, 0.6  # [N] rms along the true normal: of the smooth ones' mean, and of each
MOST_NORMAL = 3.0  # [deg] rms of the normal found on a smooth one
MOST_PEAK = 1.6  # times of the wanted force that no run may press with
FIGURES = {"force_rms": ("N", WORST_FORCE), "normal_rms_deg": ("deg", MOST_NORMAL), "peak": ("times", MOST_PEAK)}


def surfaces(
    runs: int,
    seed: int,
    kinds: Sequence[str] = SCENARIOS,
    task: str = "follow",
    jobs: int = 1,
    keep: Path | None = None,
) -> list[dict[str, Any]]:
    """So many runs of the kinds in turn, each with a seed of its own, on estimates with noise and delay.

    keep: file with a line of JSON for each run as it ends; runs that it holds already are not made again.
    """
    wanted = [(kinds[i % len(kinds)], seed + i) for i in range(runs)]
    known = _kept(keep, task)
    calls = [delayed(one_surface)(task, *one) for one in wanted if one not in known]
    for run in in_parallel(calls, jobs, "run", ordered=False):
        known[run["scenario"], run["seed"]] = run
        keep_run(keep, json.dumps(run))
    return [known[one] for one in wanted]


def _kept(file: Path | None, task: str) -> dict[tuple[str, int], dict[str, Any]]:
    """Runs of that task in a file, by scenario and seed."""

    def run_of(run: dict[str, Any]) -> tuple[str, tuple[str, int], dict[str, Any]]:
        return run["task"], (run["scenario"], run["seed"]), run

    runs = kept_runs(file, run_of, "a run of ./seed validate surfaces")
    return {which: run for of, which, run in runs if of == task}


def one_surface(task: str, scenario: str, seed: int) -> dict[str, Any]:
    """The score of one run with what became of it."""
    run = {"task": task, "scenario": scenario, "seed": seed}
    try:
        result = evaluate(task, scenario=scenario, seed=seed, estimator="noisy").result
    except SeedError as error:
        return run | {"finished": False, "message": str(error), "surface": None}
    return run | {k: result[k] for k in ("finished", "message", "surface")}


def failure(run: dict[str, Any]) -> str:
    """What a run is beyond; '' for nothing. Over an edge a run may hold, with a reason."""
    s = run["surface"]
    if s is None:
        return "broke"
    if s["peak"] > MOST_PEAK:
        return "peak"
    if run["scenario"] in SMOOTH:
        if not run["finished"]:
            return "not finished"
        beyond = (("force", s["force_rms"], WORST_FORCE), ("normal", s["normal_rms_deg"], MOST_NORMAL))
        return ", ".join(name for name, value, most in beyond if value > most)
    return "" if run["finished"] or run["message"] else "no reason"


def table(runs: Sequence[dict[str, Any]]) -> str:
    """A line per run, and the mean of the smooth ones."""
    lines = [f"{'surface':14s} seed   force rms  mean     normal rms  worst    peak      "]
    for r in runs:
        s, head = r["surface"], f"{r['scenario']:14s}{r['seed']:5d} "
        if s is None:
            lines.append(f"{head} {r['message']}  BEYOND: {failure(r)}")
            continue
        figures = f"{s['force_rms']:8.3f} N {s['force_mean']:6.2f} N {s['normal_rms_deg']:7.2f} deg"
        end = "" if r["finished"] else f"  {r['message']:.70}"
        beyond = f"  BEYOND: {why}" if (why := failure(r)) else ""
        lines.append(f"{head} {figures} {s['normal_max_deg']:6.1f} {s['peak']:6.2f} x{end}" + beyond)
    result = summary(runs)
    for group in (name for name in ("smooth", "rough") if result[name]["runs"]):
        of = result[group]
        broke = f", {of['broke']} broke off without figures" if of["broke"] else ""
        lines.append(f"{group}, {of['runs']} runs, {of['finished']} finished{broke}: median, 90 %, worst")
        if of["broke"] == of["runs"]:
            continue
        for name, (unit, most) in FIGURES.items():
            bound = f"   (at most {most:g} {unit} for each)" if most is not None and name in of["bounded"] else ""
            median, ninety, worst = of[name]
            lines.append(f"  {name:14s}{median:6.2f}{ninety:7.2f}{worst:7.2f} {unit}{bound}")
        if group == "smooth":
            lines.append(f"  force_rms on the mean {of['force_rms_mean']:.3f} N (at most {MEAN_FORCE:g} N)")
    lines.append(f"{result['beyond']} of {len(runs)} runs beyond a bound")
    return "\n".join(lines)


def summary(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Median, 90 % and worst of smooth and of rough surfaces, with the number of all runs that are beyond a bound.

    A run that broke off has no figures; it counts among the runs of its group.
    """
    out: dict[str, Any] = {"beyond": sum(bool(failure(r)) for r in runs)}
    for group, kinds in (("smooth", SMOOTH), ("rough", ROUGH)):
        every = [r for r in runs if r["scenario"] in kinds]
        of = [r for r in every if r["surface"] is not None]
        out[group] = {
            "runs": len(every),
            "finished": sum(r["finished"] for r in every),
            "broke": len(every) - len(of),
            "bounded": list(FIGURES) if group == "smooth" else ["peak"],
        }
        for name in FIGURES if of else ():
            values = [r["surface"][name] for r in of]
            out[group][name] = [*np.quantile(values, (0.5, 0.9)).tolist(), max(values)]
        if of:
            out[group]["force_rms_mean"] = float(np.mean([r["surface"]["force_rms"] for r in of]))
    return out

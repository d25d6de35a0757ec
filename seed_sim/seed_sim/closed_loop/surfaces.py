# SPDX-License-Identifier: Apache-2.0
"""Many runs of a task along surfaces that nobody drew, of every kind in turn, and the table of what they came to."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from joblib import delayed

from seed_core.errors import SeedError
from seed_sim.closed_loop.evaluate import evaluate
from seed_sim.closed_loop.progress import in_parallel

SMOOTH = ("cylinder", "hollow", "sphere", "saddle", "relief")
ROUGH = ("wedge", "step_up", "step_down", "edge", "moving_table")
SCENARIOS = (*SMOOTH, *ROUGH)
MEAN_FORCE, WORST_FORCE = 0.3, 0.6  # [N] rms along the true normal: of the smooth ones' mean, and of each
MOST_NORMAL = 3.0  # [deg] rms of the normal found on a smooth one
MOST_PEAK = 1.6  # times of the wanted force that no run may press with


def surfaces(
    runs: int, seed: int, kinds: Sequence[str] = SCENARIOS, task: str = "follow", jobs: int = 1
) -> list[dict[str, Any]]:
    """So many runs of the kinds in turn, each with a seed of its own, on estimates with noise and delay."""
    wanted = [(kinds[i % len(kinds)], seed + i) for i in range(runs)]
    return list(in_parallel([delayed(one_surface)(task, *one) for one in wanted], jobs, "run"))


def one_surface(task: str, scenario: str, seed: int) -> dict[str, Any]:
    """The score of one run with what became of it."""
    try:
        result = evaluate(task, scenario=scenario, seed=seed, estimator="noisy").result
    except SeedError as error:
        return {"scenario": scenario, "seed": seed, "finished": False, "message": str(error), "surface": None}
    return {k: result[k] for k in ("scenario", "seed", "finished", "message", "surface")}


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
            lines.append(f"{head} {r['message']}")
            continue
        figures = f"{s['force_rms']:8.3f} N {s['force_mean']:6.2f} N {s['normal_rms_deg']:7.2f} deg"
        end = "" if r["finished"] else f"  {r['message']:.70}"
        beyond = f"  BEYOND: {why}" if (why := failure(r)) else ""
        lines.append(f"{head} {figures} {s['normal_max_deg']:6.1f} {s['peak']:6.2f} x{end}" + beyond)
    result = summary(runs)
    if result["runs"]:
        lines.append(
            f"smooth: force {result['force_rms_mean']:.3f} N rms on the mean (at most {MEAN_FORCE:g}), "
            f"{result['force_rms_worst']:.3f} N at worst ({WORST_FORCE:g}); "
            f"normal {result['normal_rms_deg_mean']:.2f} deg rms ({MOST_NORMAL:g} for each); "
            f"{result['beyond']} of {len(runs)} runs beyond a bound"
        )
    return "\n".join(lines)


def summary(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Of the smooth surfaces, with the number of all runs that are beyond a bound."""
    smooth = [r["surface"] for r in runs if r["scenario"] in SMOOTH and r["surface"] is not None]
    out: dict[str, Any] = {"runs": len(smooth), "beyond": sum(bool(failure(r)) for r in runs)}
    if smooth:
        force, normal = ([s[key] for s in smooth] for key in ("force_rms", "normal_rms_deg"))
        out |= {"force_rms_mean": float(np.mean(force)), "force_rms_worst": max(force)}
        out |= {"normal_rms_deg_mean": float(np.mean(normal)), "normal_rms_deg_worst": max(normal)}
    return out

# SPDX-License-Identifier: Apache-2.0
"""Sweeps of the closed loop over seeds and columns, on this machine's cores or a cluster (joblib's back ends)."""

from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed

from seed_core.errors import SeedError
from seed_sim.closed_loop.evaluate import evaluate
from seed_sim.closed_loop.progress import in_parallel


def sweep(
    task: str,
    columns: list[str],
    seeds: list[int],
    *,
    law: str,
    estimator: str,
    force: float | None = None,
    jobs: int = 1,
) -> dict[str, Any]:
    """Every column (a scenario's name) with every seed.

    Uses joblib's active back end: see docs/results.md for Dask and Ray.

    Returns:
        The settings, and by column the score of every run with mean, p95 and max over them.
    """
    cases = [(column, seed) for column in columns for seed in seeds]
    calls = [delayed(one_run)(task, column, seed, law, estimator, force) for column, seed in cases]
    results = list(in_parallel(calls, jobs, "run"))
    runs_of = {c: results[i * len(seeds) : (i + 1) * len(seeds)] for i, c in enumerate(columns)}
    return {
        "task": task,
        "law": law,
        "estimator": estimator,
        "seeds": seeds,
        "columns": {c: column_summary(runs) for c, runs in runs_of.items()},
    }


def one_run(task: str, column: str, seed: int, law: str, estimator: str, force: float | None) -> dict[str, Any]:
    """The score of one run; a run that breaks is reported as such, not left out."""
    try:
        return evaluate(task, law=law, estimator=estimator, force=force, seed=seed, scenario=column).result
    except SeedError as error:
        return {"seed": seed, "scenario": column, "error": str(error), "finished": False}


def column_summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """The runs of one column, how many were scored, the seeds that failed, and a summary of what was scored."""
    good = [r for r in runs if r.get("samples")]
    failed = [r["seed"] for r in runs if not r.get("finished")]
    out: dict[str, Any] = {"runs": runs, "scored": len(good), "failed": failed}
    for key, figure in (("force_z", "rmse"), ("torque_x", "rmse"), ("lean_deg", "rms"), ("lean_deg", "max")):
        if good:
            out[f"{key}_{figure}"] = summary([r[key][figure] for r in good])
    return out


def summary(values: list[float]) -> dict[str, float]:
    """mean, p95 and max."""
    v = np.asarray(values, dtype=float)
    return {"mean": float(v.mean()), "p95": float(np.percentile(v, 95)), "max": float(v.max())}


def plot(result: dict[str, Any], path: Path) -> None:
    """Force error and lean of every run of a sweep, by column."""
    from matplotlib.figure import Figure

    from seed_sim.replay.plots import save

    figure = Figure(figsize=(10, 4), layout="constrained")
    drawn = (("force_z", "rmse", "force error, RMSE [N]"), ("lean_deg", "max", "largest lean [deg]"))
    for axis, (key, sub, label) in zip(figure.subplots(1, 2), drawn, strict=True):
        means = "mean"
        for i, column in enumerate(result["columns"].values()):
            if values := [r[key][sub] for r in column["runs"] if r.get("samples")]:
                axis.plot([i] * len(values), values, "o", alpha=0.5)
                axis.plot([i - 0.2, i + 0.2], [np.mean(values)] * 2, "k-", label=means)
                means = ""
        axis.set_xticks(range(len(result["columns"])), list(result["columns"]), rotation=20)
        axis.set(ylabel=label)
        axis.set_ylim(bottom=0)
        axis.grid(axis="y", alpha=0.3)
        if not means:
            axis.legend(fontsize=8)
    how = f"law {result['law']}, poses: {result['estimator']}"
    figure.suptitle(f"{result['task']}, {how}, {len(result['seeds'])} seeds per scenario")
    save(figure, path, dpi=130)

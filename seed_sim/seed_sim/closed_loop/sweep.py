# SPDX-License-Identifier: Apache-2.0
"""Sweeps of the closed loop over seeds and columns, on this machine's cores or a cluster (joblib's back ends)."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from seed_control.tasks import load_task
from seed_core.command_line import results_folder, to_json
from seed_core.errors import SeedError
from seed_sim.scenario import COLUMNS, load_scenario


def one(task: str, column: str, seed: int, law: str, estimator: str, force: float | None) -> dict[str, Any]:
    """The score of one run; a run that breaks is reported as such, not left out."""
    from seed_sim.closed_loop.evaluate import run

    try:
        return run(task, law=law, estimator=estimator, force=force, seed=seed, scenario=column).result
    except SeedError as error:
        return {"seed": seed, "scenario": column, "error": str(error), "finished": False}


def summary(values: list[float]) -> dict[str, float]:
    """mean, p95 and max."""
    v = np.asarray(values, dtype=float)
    return {"mean": float(v.mean()), "p95": float(np.percentile(v, 95)), "max": float(v.max())}


def column_summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """What a sweep tells of one column."""
    good = [r for r in runs if "error" not in r]
    out: dict[str, Any] = {"runs": runs, "failed": [r["seed"] for r in runs if not r.get("finished")]}
    if good:
        out["force_z_rmse"] = summary([r["force_z"]["rmse"] for r in good])
        out["torque_x_rmse"] = summary([r["torque_x"]["rmse"] for r in good])
        out["lean_deg_rms"] = summary([r["lean_deg"]["rms"] for r in good])
        out["lean_deg_max"] = summary([r["lean_deg"]["max"] for r in good])
    return out


def sweep(
    task: str,
    columns: list[str],
    seeds: list[int],
    *,
    law: str,
    estimator: str,
    force: float | None = None,
    jobs: int = 1,
    progress: bool = True,
) -> dict[str, Any]:
    """Every column with every seed. Uses joblib's active back end: see docs/control.md for Dask and Ray."""
    from tqdm import tqdm

    cases = [(column, seed) for column in columns for seed in seeds]
    work = Parallel(n_jobs=jobs, return_as="generator")(
        delayed(one)(task, column, seed, law, estimator, force) for column, seed in cases
    )
    quiet = not (progress and sys.stderr.isatty())
    results = list(tqdm(work, total=len(cases), unit="run", disable=quiet))
    by_column: dict[str, list[dict[str, Any]]] = {c: [] for c in columns}
    for (column, _), result in zip(cases, results, strict=True):
        by_column[column].append(result)
    return {
        "task": task,
        "law": law,
        "estimator": estimator,
        "seeds": seeds,
        "columns": {c: column_summary(runs) for c, runs in by_column.items()},
    }


def plot(result: dict[str, Any], path: Path) -> None:
    """Force error and lean of every run, by column."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for axis, key, sub, label in zip(
        axes, ("force_z", "lean_deg"), ("rmse", "max"), ("force error, RMSE [N]", "largest lean [deg]"), strict=True
    ):
        for i, column in enumerate(result["columns"].values()):
            values = [r[key][sub] for r in column["runs"] if key in r]
            axis.plot([i] * len(values), values, "o", alpha=0.5)
            axis.plot([i - 0.2, i + 0.2], [np.mean(values)] * 2, "k-", label="mean" if i == 0 else None)
        axis.set_xticks(range(len(result["columns"])), list(result["columns"]), rotation=20)
        axis.set_ylabel(label)
        axis.set_ylim(bottom=0)
        axis.grid(axis="y", alpha=0.3)
        axis.legend(fontsize=8)
    how = f"law {result['law']}, poses: {result['estimator']}"
    figure.suptitle(f"{result['task']}, {how}, {len(result['seeds'])} seeds per scenario")
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _table(result: dict[str, Any]) -> None:
    print(f"{'column':18s} {'force rmse mean':>15s} {'p95':>7s} {'max':>7s} {'lean rms':>9s} {'lean max':>9s}  failed")
    for name, c in result["columns"].items():
        if "force_z_rmse" not in c:
            print(f"{name:18s} every run failed: {c['runs'][0]['error']}")
            continue
        f = c["force_z_rmse"]
        print(
            f"{name:18s} {f['mean']:13.3f} N {f['p95']:7.3f} {f['max']:7.3f} {c['lean_deg_rms']['mean']:9.2f} "
            f"{c['lean_deg_max']['max']:9.2f}  {c['failed'] or '-'}"
        )


def sweep_command(args: argparse.Namespace) -> int:
    """`./seed evaluate TASK --scenarios N`."""
    images = args.estimator in ("published", "rigid_fit")  # micro-slip of the membrane exists in images only
    usual = [*COLUMNS, "slip20"] if images else list(COLUMNS)
    columns = args.column or ([args.scenario] if args.scenario else usual)
    load_task(args.task, args.force)  # a mistake here would break every run
    for column in columns:
        load_scenario(column)
    seeds = list(range(args.seed, args.seed + args.scenarios))
    path = _plot_file(args)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)  # before the minutes that a sweep takes
    how = {"law": args.law, "estimator": args.estimator, "force": args.force, "jobs": args.jobs}
    result = sweep(args.task, columns, seeds, **how)
    if args.json:
        print(to_json(result))
    else:
        _table(result)
    if path is not None:
        plot(result, path)
        print(f"plot: {path}", file=sys.stderr)
    return 1 if any("error" in r for c in result["columns"].values() for r in c["runs"]) else 0


def _plot_file(args: argparse.Namespace) -> Path | None:
    """Where the plot goes; nowhere with --json alone. A folder takes it under its usual name."""
    name = f"sweep-{Path(args.task).stem}-{args.law}-{args.seed}.png"
    if args.plot is None:
        return None if args.json else results_folder() / name
    path = Path(args.plot)
    return path / name if path.is_dir() else path

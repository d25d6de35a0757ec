# SPDX-License-Identifier: Apache-2.0
"""Fig. 6: force along z and torque about x of a squeegee under SEED, along a taught path, and bolted to the gripper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from seed_sim import Evaluation, evaluate
from seed_testing.reproduce.output import Progress, table, write

# label, law, estimator, colour
CASES = (
    ("SEED, tactile images", "seed", "rigid_fit", "tab:blue"),
    ("SEED, exact pose", "seed", "truth", "tab:cyan"),
    ("Algorithm 2 as published, exact pose", "published", "truth", "tab:purple"),
    ("open loop", "open_loop", "truth", "tab:gray"),
    ("welded", "welded", "truth", "tab:red"),
    ("welded with roll control", "welded_roll", "truth", "tab:orange"),
)
DRAWN = ("SEED, tactile images", "open loop", "welded")


def reproduce(folder: Path, seed: int, force: float) -> tuple[str, list[Path]]:
    """Run every case on the same table. Returns the table and the files."""
    runs = {}
    for label, law, estimator, _ in CASES:
        progress = Progress(label)
        runs[label] = evaluate("squeegee", law=law, estimator=estimator, seed=seed, force=force, progress=progress)
        progress.done()
    text = _table(runs, seed, force)
    files = write(folder, "fig6", text, {label: r.result for label, r in runs.items()})
    return text, [*files, _draw(runs, folder / "fig6.png", force)]


def _table(runs: dict[str, Evaluation], seed: int, force: float) -> str:
    rows = []
    for label, evaluation in runs.items():
        r = evaluation.result
        f, x, lean = r["force_z"], r["torque_x"], r["lean_deg"]
        rows.append(
            [
                label,
                f"{f['rmse']:.3f}",
                f"{f['mean']:.2f}",
                f"{f['max_abs_error']:.2f}",
                f"{x['rmse']:.4f}",
                f"{lean['rms']:.2f}",
                f"{lean['max']:.2f}",
                "yes" if r["finished"] else r["message"][:40],
            ]
        )
    header = ["squeegee", "force rmse N", "mean N", "worst N", "torque rmse N m", "lean rms deg", "max", "finished"]
    return f"Fig. 6 in simulation: {force:g} N, seed {seed}, from 2 s after contact\n\n" + table(header, rows)


def _draw(runs: dict[str, Evaluation], path: Path, force: float) -> Path:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 1, figsize=(9, 6), sharex=True, layout="constrained")
    for label, _, _, colour in CASES:
        if label not in DRAWN:
            continue
        recording = runs[label].recording
        since = recording["t"] - (recording.contact_time or 0.0)
        _line(axes[0], since, -recording["force"][:, 2], label, colour)
        _line(axes[1], since, recording["torque_T"][:, 0], label, colour)
    axes[0].axhline(force, color="k", lw=0.8, ls="--", label="commanded")
    axes[1].axhline(0.0, color="k", lw=0.8, ls="--")
    axes[0].set_ylabel("force onto the table [N]")
    axes[0].set_ylim(-1.0, 2.2 * force)
    axes[1].set_ylabel("torque about the blade's x [N m]")
    axes[1].set_xlabel("time since contact [s]")
    axes[1].set_xlim(-0.5, None)
    axes[0].legend(ncols=2, fontsize="small")
    figure.savefig(path, dpi=140)
    plt.close(figure)
    return path


def _line(axis: Any, t: Any, y: Any, label: str, colour: str) -> None:
    axis.plot(t, y, color=colour, lw=1.0, label=label)
    axis.grid(alpha=0.3)

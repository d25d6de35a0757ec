# SPDX-License-Identifier: Apache-2.0
"""Fig. 6: force along z and torque about x of a squeegee under SEED, along a taught path, and bolted to the gripper."""

from pathlib import Path
from typing import NamedTuple

from seed_sim import Evaluation, evaluate
from seed_sim.closed_loop.progress import progress_bar
from seed_testing.reproduce.report import table, write


class Case(NamedTuple):
    """One run of the squeegee; those with a colour are drawn."""

    label: str
    law: str
    estimator: str
    colour: str = ""


CASES = (
    Case("SEED, tactile images", "seed", "rigid_fit", "tab:blue"),
    Case("SEED, exact pose", "seed", "truth"),
    Case("Algorithm 2 as published, exact pose", "published", "truth", "tab:green"),
    Case("open loop", "open_loop", "truth", "tab:gray"),
    Case("welded", "welded", "truth", "tab:red"),
    Case("welded with roll control", "welded_roll", "truth"),
)
COLUMNS = {
    "force rmse N": "{force_z[rmse]:.3f}",
    "mean N": "{force_z[mean]:.2f}",
    "worst N": "{force_z[max_abs_error]:.2f}",
    "torque rmse N m": "{torque_x[rmse]:.4f}",
    "lean rms deg": "{lean_deg[rms]:.2f}",
    "max": "{lean_deg[max]:.2f}",
}


def reproduce(folder: Path, seed: int, force: float) -> tuple[str, list[Path]]:
    """Run every case on the same table. Returns the table and the files."""
    runs = {}
    for case in CASES:
        with progress_bar(case.label) as progress:
            runs[case.label] = evaluate(
                "squeegee", law=case.law, estimator=case.estimator, seed=seed, force=force, progress=progress
            )
    text = _table(runs, seed, force)
    files = write(folder, "fig6", text, {label: r.result for label, r in runs.items()})
    return text, [*files, _draw(runs, folder / "fig6.png", force)]


def _table(runs: dict[str, Evaluation], seed: int, force: float) -> str:
    rows = []
    for label, run in runs.items():
        r = run.result
        numbers = [column.format(**r) for column in COLUMNS.values()]
        rows.append([label, *numbers, "yes" if r["finished"] else r["message"][:40]])
    title = f"Fig. 6 in simulation: {force:g} N, seed {seed}, from 2 s after contact\n\n"
    return title + table(["squeegee", *COLUMNS, "finished"], rows)


def _draw(runs: dict[str, Evaluation], path: Path, force: float) -> Path:
    from matplotlib.figure import Figure

    from seed_sim.replay.plots import save

    figure = Figure(figsize=(9, 6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for case in CASES:
        if case.colour:
            recording = runs[case.label].recording
            since = recording["t"] - (recording.contact_time or 0.0)
            upper.plot(since, -recording["force"][:, 2], color=case.colour, lw=1.0, label=case.label)
            lower.plot(since, recording["torque_T"][:, 0], color=case.colour, lw=1.0)
    upper.axhline(force, color="k", lw=0.8, ls="--", label="commanded")
    lower.axhline(0.0, color="k", lw=0.8, ls="--")
    upper.set(ylabel="force onto the table [N]", ylim=(-1.0, 2.2 * force))
    lower.set(ylabel="torque about the blade's x [N m]", xlabel="time since contact [s]", xlim=(-0.5, None))
    upper.legend(ncols=2, fontsize="small")
    for axis in (upper, lower):
        axis.grid(alpha=0.3)
    save(figure, path, dpi=140)
    return path

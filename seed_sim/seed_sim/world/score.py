# SPDX-License-Identifier: Apache-2.0
"""The score over many worlds: median, 90 % and worst of true and believed force, of torque and lean."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed

from seed_core.errors import SeedError
from seed_core.program.command_line import to_json
from seed_sim.campaigns import keep_run, kept_runs, spread
from seed_sim.closed_loop.progress import Progress, in_parallel, progress_bar
from seed_sim.world.draw import draw_world
from seed_sim.world.parameters import Kind
from seed_sim.world.trial import run_trial

DRAWS = 20
# What draws of one score share:
SETTINGS = ("task", "law", "model", "estimator", "force", "scenario", "world", "late_stamps", "arm_sensor")
FIGURES: tuple[tuple[str, str, str], ...] = (  # key, name in the table, unit
    ("force_z", "true force", "N"),
    ("believed_z", "believed", "N"),
    ("stated_z", "stated", "N"),
    ("torque_x", "torque x", "N m"),
    ("lean", "lean", "deg"),
    ("nees", "nees", ""),
)


def score_draws(
    settings: dict[str, Any], draws: Sequence[int], jobs: int = 1, out: Path | None = None, *, shown: bool = False
) -> dict[str, Any]:
    """Run a task in the world of each draw.

    Args:
        settings: by the names in SETTINGS.
        draws: seeds of the worlds.
        jobs: processes.
        out: JSON lines, one per draw; draws that stand in it already are not repeated, and count as well.
        shown: where one draw is left to run, a bar on a terminal tells what it does; several are counted.

    Raises:
        SeedError: the file holds draws of other settings.
    """
    runs = _known(out, settings)
    missing = [d for d in draws if d not in runs]
    for run in _runs(settings, missing, jobs, shown):
        runs[run["draw"]] = run
        keep_run(out, to_json(run))
    ordered = [runs[d] for d in sorted(runs)]
    return {**settings, "draws": ordered, "summary": summarised(ordered)}


def _runs(settings: dict[str, Any], draws: Sequence[int], jobs: int, shown: bool) -> Iterator[dict[str, Any]]:
    if len(draws) == 1:
        with progress_bar(f"draw {draws[0]}", shown=shown, leave=False) as progress:
            yield one_draw(settings, draws[0], progress)
    else:
        yield from in_parallel([delayed(one_draw)(settings, d) for d in draws], jobs, "draw")


def one_draw(settings: dict[str, Any], draw: int, progress: Progress | None = None) -> dict[str, Any]:
    """The result of one draw with its settings; a run that breaks is reported as such, not left out."""
    kind: Kind = settings["world"]
    try:
        world = draw_world(draw, kind, late_stamps=settings["late_stamps"])
        given = {k: settings[k] for k in ("law", "model", "estimator", "force", "scenario", "arm_sensor")}
        result = run_trial(settings["task"], world, draw, **given, progress=progress).result
    except SeedError as error:
        result = {"draw": draw, "error": str(error), "finished": False}
    return {**result, **settings}


def _known(out: Path | None, settings: dict[str, Any]) -> dict[int, dict[str, Any]]:
    def of_these(run: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        if other := [f"{k} {run[k]}" for k in SETTINGS if run[k] != settings[k]]:
            raise ValueError(f"one with {', '.join(other)}")
        return int(run["draw"]), run

    return dict(kept_runs(out, of_these, "a draw of this score"))


def value_of(run: dict[str, Any], key: str) -> float | None:
    """A figure of FIGURES of one draw; None where there is none."""
    if key == "lean":
        value = (run.get("lean_deg") or {}).get("rms")
    else:
        value = run.get(key)
        value = value.get("rmse") if isinstance(value, dict) else value
    return float(value) if value is not None and run.get("samples") and np.isfinite(value) else None


def summarised(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Median, 90 % and worst by figure, of the draws that were scored; and which did what they should not."""
    out: dict[str, Any] = {
        "draws": len(runs),
        "scored": sum(bool(r.get("samples")) for r in runs),
        "not_finished": [r["draw"] for r in runs if not r.get("finished")],
        "swing": [r["draw"] for r in runs if (r.get("swing") or {}).get("seen")],
    }
    stated = [r["within"] for r in runs if r.get("within") is not None]
    out["within_two_deviations"] = sum(stated) / len(stated) if stated else None
    for key, _, _ in FIGURES:
        values = [v for r in runs if (v := value_of(r, key)) is not None]
        out[key] = spread(values) if values else None
    return out


def table(result: dict[str, Any]) -> str:
    """The score as text: a line per draw, then the summary."""
    settings = ", ".join(f"{k} {result[k]}" for k in SETTINGS if result[k] not in (None, False))
    lines = [settings, "draw  " + "".join(f"{name:>12s}" for _, name, _ in FIGURES) + "  within  end"]
    keys = [key for key, _, _ in FIGURES]
    for run in result["draws"]:
        lines.append(_line(f"{run['draw']:4d}", [value_of(run, key) for key in keys], _end(run)))
    summary = result["summary"]
    for name in ("median", "p90", "worst"):
        lines.append(_line(name, [(summary[key] or {}).get(name) for key in keys], ""))
    within = summary["within_two_deviations"]
    lines.append(
        f"{summary['scored']} of {summary['draws']} draws scored; not finished: {summary['not_finished'] or 'none'}; "
        f"swing: {summary['swing'] or 'none'}; within two stated deviations: "
        + ("none stated" if within is None else f"{within:.0%}")
    )
    return "\n".join(lines)


def _line(head: str, values: Sequence[float | None], tail: str) -> str:
    cells = []
    for (_, _, unit), v in zip(FIGURES, values, strict=True):
        cells.append(f"{'-' if v is None else f'{v:.3f}'} {unit:3s}".rjust(12))
    return (f"{head:6s}" + "".join(cells) + tail).rstrip()


def _end(run: dict[str, Any]) -> str:
    within = {None: "-", True: "yes", False: "no"}[run.get("within")]
    swings = "; swings" if (run.get("swing") or {}).get("seen") else ""
    problems = "".join(f"; {p}" for p in run.get("problems", ()))
    return f"  {within:6s}  {run.get('error') or run.get('message') or 'no end'}{swings}{problems}"

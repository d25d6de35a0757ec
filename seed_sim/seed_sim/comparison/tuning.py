# SPDX-License-Identifier: Apache-2.0
"""The tuning of every method: its grid on seeds that no comparison uses, and the file in which the best are written."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from seed_core.errors import SeedError
from seed_core.program.files import shared_path
from seed_sim.comparison.methods import Method, Settings, method_named
from seed_sim.comparison.run import Run

FIRST = "nominal"
FURTHER = ("hard table", "moving table", "force steps")
SEEDS = (900, 901)  # a comparison's begin at 2000
PRESS_SHARE = 0.25  # of the error before the wipe in the cost
KEPT = 8  # points that go on to the further cases ...
OF_THESE = 0.4  # ... and the share of these that goes on to the further seed
COMMAND = "./seed compare --tune"

Work = tuple[Run, dict[str, float]]
Runner = Callable[[list[Work]], Iterable[dict[str, Any]]]


def tuning_file() -> Path:
    """The file that is part of the project."""
    return shared_path("seed_sim", "config/compare") / "tuning.json"


def chosen_settings(names: Iterable[str], file: Path | None = None) -> dict[str, Settings]:
    """Best settings by method; {} for one without a grid.

    Raises:
        SeedError: the file is no tuning, or lacks a method.
    """
    settings: dict[str, Settings] = {name: {} for name in names}
    by = {name: method_named(name).tuned_as or name for name in settings}
    tuned = [name for name in settings if method_named(by[name]).grid]
    if not tuned:
        return settings
    file = file or tuning_file()
    try:
        methods = json.loads(file.read_text(encoding="utf-8"))["methods"]
        return settings | {name: dict(methods[by[name]]["settings"]) for name in tuned}
    except (ValueError, KeyError, TypeError) as error:
        raise SeedError(f"{file}: not a tuning of these methods ({error}): make it with {COMMAND}") from error


def cost(row: dict[str, Any]) -> float:
    """[share of the wanted force] rms over the wipe, and a share of that before it."""
    return float(row["rms"] + PRESS_SHARE * (row["press_rms"] if row["press_rms"] is not None else row["rms"]))


def tune(method: Method, runner: Runner, kept: int = KEPT) -> dict[str, Any]:
    """The grid in three rounds: all points in one case, the best in further ones, the best of those on another seed."""
    costs: dict[str, list[float]] = {}

    def try_out(points: list[dict[str, float]], cases: Iterable[str], seeds: Iterable[int]) -> list[dict[str, float]]:
        works = [(Run(method.name, case, seed), p) for p in points for case in cases for seed in seeds]
        for row in runner(works):
            costs.setdefault(_name(row["settings"]), []).append(cost(row))
        return sorted(points, key=lambda p: float(np.mean(costs[_name(p)])))

    points = try_out(method.points(), (FIRST,), SEEDS[:1])
    points = try_out(points[:kept], FURTHER, SEEDS[:1])
    points = try_out(points[: max(round(OF_THESE * kept), 1)], (FIRST, *FURTHER), SEEDS[1:])
    return {
        "settings": points[0],
        "cost": round(float(np.mean(costs[_name(points[0])])), 4),
        "kept": kept,
        "grid": {name: list(values) for name, values in method.grid.items()},
        "tried": {name: [round(float(np.mean(c)), 4), len(c)] for name, c in costs.items()},
    }


def _name(settings: Settings) -> str:
    return " ".join(f"{k}={v:g}" for k, v in settings.items())


def written(tunings: dict[str, Any], file: Path) -> None:
    """Write the file, with what it took."""
    about = {
        "command": COMMAND,
        "cost": f"mean over runs of the rms force error over the wipe + {PRESS_SHARE:g} x that before it [N]",
        "cases": [FIRST, *FURTHER],
        "seeds": list(SEEDS),
        "tried": "by settings: mean cost, runs; points that were poor in the first case have one run",
        "methods": tunings,
    }
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")

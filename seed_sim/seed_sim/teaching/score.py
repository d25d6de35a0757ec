# SPDX-License-Identifier: Apache-2.0
"""Demonstrations, taught and played again in the same cell with other noise; path and force of the plant."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from joblib import delayed

from seed_control.tasks import Task
from seed_control.teach import TeachError, make_task, task_text
from seed_control.teach.compare import difference
from seed_core.config import load_text
from seed_sim.closed_loop.progress import in_parallel
from seed_sim.closed_loop.run import play
from seed_sim.teaching.draw import TOOLS, DrawnDemonstration, draw
from seed_sim.teaching.shown import Shown

ALL = "all"
_OTHER = 500_000  # added to the seed of the noise where a task is played again


class Replay(NamedTuple):
    """How far a replay was from its demonstration.

    Attributes:
        path, path_max: [m] rms and largest distance of the two true paths in the surface, both ways.
        force: [N] rms difference of the true pressing forces at the same place.
        ended: why there is no such figure; ''.
    """

    kind: str
    seed: int
    path: float
    path_max: float
    force: float
    ended: str = ""


def shown(case: DrawnDemonstration, estimator: str = "noisy") -> Shown:
    """The demonstration."""
    task = case.task()
    demonstration = Shown(task, TOOLS[case.tool], task.frame.pose, case.seed, case.seed, estimator)
    if case.kind.startswith("led"):
        demonstration.led(case.path, case.forces, case.speed)
    else:
        play(task, demonstration.plant, demonstration)
    return demonstration


def again(case: DrawnDemonstration, task: Task, estimator: str = "noisy") -> tuple[Shown, str]:
    """The task in the same cell, with other noise; and how it ended, '' for well."""
    table = case.task().frame.pose
    replay = Shown(task, TOOLS[case.tool], table, case.seed, case.seed + _OTHER, estimator)
    recording = play(task, replay.plant, replay)
    return replay, "" if recording.finished else recording.message or "it did not end"


def replay(seed: int, estimator: str = "noisy") -> Replay:
    """One demonstration, taught by its measurements, and its replay."""
    case, nan = draw(seed), float("nan")
    first = shown(case, estimator)
    try:
        made = make_task(first.measured, "mine", case.tool, case.settings).task
        second, ended = again(case, load_text(task_text(made), Task, "mine.yaml"), estimator)
        apart = difference(first.true, second.true, case.settings)
    except TeachError as error:
        return Replay(case.kind, seed, nan, nan, nan, str(error))
    return Replay(case.kind, seed, apart.path, apart.path_max, apart.force, ended)


def campaign(seeds: Sequence[int], estimator: str = "noisy", jobs: int = 1) -> list[Replay]:
    """A demonstration of each seed."""
    return list(in_parallel([delayed(replay)(seed, estimator) for seed in seeds], min(jobs, len(seeds)), "replay"))


def summary(replays: Sequence[Replay]) -> dict[str, dict[str, Any]]:
    """Of all and by kind: median, 90 % and worst of path [mm] and force [N]; what ended early is infinitely far."""
    out: dict[str, dict[str, Any]] = {}
    for kind in (ALL, *sorted({r.kind for r in replays})):
        of = [r for r in replays if kind in (ALL, r.kind)]
        out[kind] = {
            "replays": len(of),
            "path_mm": _spread([1e3 * r.path for r in of], of),
            "path_max_mm": _spread([1e3 * r.path_max for r in of], of),
            "force": _spread([r.force for r in of], of),
            "ended": {str(r.seed): r.ended for r in of if r.ended},
        }
    return out


def _spread(values: Sequence[float], of: Sequence[Replay]) -> dict[str, float]:
    far = np.array([np.inf if r.ended else v for v, r in zip(values, of, strict=True)])
    return {
        "median": float(np.percentile(far, 50.0, method="higher")),
        "p90": float(np.percentile(far, 90.0, method="higher")),
        "worst": float(far.max()),
    }


def table(result: dict[str, dict[str, Any]]) -> str:
    """The summary as text, a line per kind."""
    lines = [
        f"{'':16} shown   path, rms [mm]         path, largest [mm]     force, rms [N]",
        f"{'':16}        median   90 %  worst  median   90 %  worst  median   90 %  worst",
    ]
    for kind, row in result.items():
        figures = "  ".join(
            f"{row[key]['median']:6.2f} {row[key]['p90']:6.2f} {row[key]['worst']:6.2f}"
            for key in ("path_mm", "path_max_mm", "force")
        )
        lines.append(f"{kind:16} {row['replays']:5d}  {figures}")
    lines += [
        f"seed {seed}: {why}" for kind, row in result.items() for seed, why in row["ended"].items() if kind == ALL
    ]
    return "\n".join(lines)

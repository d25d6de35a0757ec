# SPDX-License-Identifier: Apache-2.0
"""Single perturbations: worlds that differ from what is believed in one thing, the suite being told everything else.

What each costs in true force, what is believed meanwhile, and when and in which words it is reported.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from joblib import delayed

from seed_core.errors import SeedError
from seed_sim.campaigns import spread
from seed_sim.closed_loop.progress import Progress, in_parallel, progress_bar
from seed_sim.closed_loop.relative_poses import FROM_IMAGES
from seed_sim.world.parameters import CameraWorld, CellWorld, ImageWorld, ProcedureWorld, SpringWorld, World
from seed_sim.world.score import value_of
from seed_sim.world.trial import run_trial


@dataclass(frozen=True)
class Perturbation:
    """One thing that is not as believed."""

    words: str
    world: World

    @property
    def seen(self) -> bool:
        """Whether images alone show it."""
        return self.world.images != ImageWorld() or self.world.cell.hanging


def _both(**values: Any) -> ImageWorld:
    """The same error in both cameras."""
    return ImageWorld(CameraWorld(**values), CameraWorld(**values))


def _mounts(deg: float, mm: float) -> ImageWorld:
    """Mounts off by that much on every axis, in different directions."""
    left = CameraWorld((deg, -deg, deg), (mm, mm, -mm))
    right = CameraWorld((-deg, deg, deg), (mm, -mm, mm))
    return ImageWorld(left, right)


def _spring(**values: Any) -> World:
    return World(spring=SpringWorld(**values))


def _z(factor: float) -> tuple[float, float, float, float, float, float]:
    return 1.0, 1.0, 1.0, 1.0, 1.0, factor


def _all(factor: float, off: float = 0.0) -> World:
    """Every stiffness times a factor, and z of the pose that is told off by so much [mm]."""
    return World(spring=SpringWorld(scale=(factor,) * 6), images=ImageWorld(zero_mm=(0.0, 0.0, off)))


_FITTED = 1.0 + 0.2 * 0.375  # of a line through half of the range of a spring that stiffens by 20 %
PERTURBATIONS: dict[str, Perturbation] = {
    "none": Perturbation("as believed", World()),
    "stiffness_-20": Perturbation("stiffness of the force axis x0.8", _spring(scale=_z(0.8))),
    "stiffness_-5": Perturbation("stiffness of the force axis x0.95", _spring(scale=_z(0.95))),
    "stiffness_+10": Perturbation("stiffness of the force axis x1.1", _spring(scale=_z(1.1))),
    "stiffness_all_-15": Perturbation("every stiffness x0.85, z off by 0.3 mm", _all(0.85, off=0.3)),
    "stiffness_all_+15": Perturbation("every stiffness x1.15, z off by -0.3 mm", _all(1.15, off=-0.3)),
    "stiffness_all_-5": Perturbation("every stiffness x0.95", _all(0.95)),
    "stiffness_all_+5": Perturbation("every stiffness x1.05", _all(1.05)),
    "stiffening": Perturbation("stiffening 20 % at full deflection, file: small signal", _spring(stiffening=0.2)),
    "stiffening_fitted": Perturbation(
        "stiffening 20 %, file: fitted over half the range",
        World(spring=SpringWorld(stiffening=0.2), procedures=ProcedureWorld(stiffness=(_FITTED,) * 6)),
    ),
    "hysteresis_5": Perturbation("hysteresis 5 % of full scale", _spring(hysteresis=0.05)),
    "hysteresis_10": Perturbation("hysteresis 10 % of full scale", _spring(hysteresis=0.10)),
    "relaxation": Perturbation("relaxation 10 % in 2 s", _spring(relaxation=0.1)),
    "fade_5": Perturbation("stiffness -5 % within 14 s", _spring(fade=0.05, fade_time=14.0)),
    "fade_20": Perturbation("stiffness -20 % within 14 s", _spring(fade=0.20, fade_time=14.0)),
    "centre_z": Perturbation("elastic centre 5 mm along z", _spring(centre_mm=(0.0, 0.0, 5.0))),
    "centre_y": Perturbation("elastic centre 5 mm along y", _spring(centre_mm=(0.0, 5.0, 0.0))),
    "mounts": Perturbation("mounts 0.5 deg, 0.5 mm", World(images=_mounts(0.5, 0.5))),
    "mounts_2": Perturbation("mounts 2 deg, 2 mm", World(images=_mounts(2.0, 2.0))),
    "focal_1": Perturbation("focal length 1 %", World(images=_both(focal=0.01))),
    "focal_3": Perturbation("focal length 3 %", World(images=_both(focal=0.03))),
    "depth_scale_2": Perturbation("depth scale 2 %", World(images=_both(depth_scale=0.02))),
    "depth_scale_5": Perturbation("depth scale 5 %", World(images=_both(depth_scale=0.05))),
    "depth_lag": Perturbation("depth filtered by 40 ms", World(images=ImageWorld(depth_lag=0.04))),
    "hanging": Perturbation("grasp taken while the tool hangs", World(cell=CellWorld(hanging=True))),
    "mass": Perturbation("mass +10 %", World(cell=CellWorld(mass=0.1))),
    "late_60": Perturbation("stamps 60 ms late", World(images=ImageWorld(clock=0.06))),
    "late_80": Perturbation("stamps 80 ms late", World(images=ImageWorld(clock=0.08))),
    "late_85": Perturbation("stamps 85 ms late", World(images=ImageWorld(clock=0.085))),
    "skew_11": Perturbation("fingers 11 ms apart, one stamp", World(images=ImageWorld(skew=0.011))),
    "skew_22": Perturbation("fingers 22 ms apart, one stamp", World(images=ImageWorld(skew=0.022))),
    "skew_11_stamped": Perturbation(
        "fingers 11 ms apart, each with its stamp", World(images=ImageWorld(skew=0.011, skew_stamped=True))
    ),
    "slip": Perturbation("micro-slip of 10 %", World(images=ImageWorld(slip=0.1))),
    "creep_20": Perturbation("patch's edge lets go, slides at 20 mm", World(images=ImageWorld(creep_hold_mm=20.0))),
    "creep_14": Perturbation("patch's edge lets go, slides at 14 mm", World(images=ImageWorld(creep_hold_mm=14.0))),
    "shape": Perturbation("membranes 0.2 mm higher after the reference", World(images=_both(shape_mm=0.2))),
    "range_0.3": Perturbation("range drifts 0.3 mm after the reference", World(images=_both(range_mm=0.3))),
    "range_2": Perturbation("range drifts 2 mm after the reference", World(images=_both(range_mm=2.0))),
    "not_calibrated": Perturbation("range not calibrated", World(images=ImageWorld(range_error=1.0))),
}


def perturbed(
    names: Sequence[str],
    task: str,
    seeds: Sequence[int],
    *,
    law: str,
    estimator: str,
    force: float | None,
    scenario: str | None,
    arm_sensor: bool = False,
    jobs: int = 1,
    shown: bool = False,
) -> list[dict[str, Any]]:
    """The rows of the table, one per name ('all': every one) and seed.

    jobs: processes, for more than one seed. shown: a bar on a terminal tells of each run, or counts those of several.

    Raises:
        SeedError: a name is unknown, or one of images for an estimator that looks at none.
    """
    wanted = list(PERTURBATIONS) if "all" in names else list(names)
    unknown = [n for n in wanted if n not in PERTURBATIONS]
    if unknown:
        raise SeedError(f"perturbation '{unknown[0]}' is unknown; known: all, {', '.join(PERTURBATIONS)}")
    if estimator not in FROM_IMAGES and (seen := [n for n in wanted if PERTURBATIONS[n].seen]):
        others = ", ".join(n for n, p in PERTURBATIONS.items() if not p.seen)
        raise SeedError(
            f"perturbation '{seen[0]}' is of images, which the estimator '{estimator}' does not look at: take one of "
            f"{', '.join(FROM_IMAGES)}, or of the perturbations {others}"
        )
    how = {"law": law, "estimator": estimator, "force": force, "scenario": scenario, "arm_sensor": arm_sensor}
    rows = []
    if len(seeds) == 1:
        for name in wanted:
            with progress_bar(name, shown=shown, leave=False) as progress:
                rows.append(_row(name, task, seeds[0], how, progress))
    else:
        rows.extend(in_parallel([delayed(_row)(n, task, s, how) for n in wanted for s in seeds], jobs, "run"))
    return sorted(rows, key=lambda r: (wanted.index(r["perturbation"]), r["seed"]))


def _row(name: str, task: str, seed: int, how: dict[str, Any], progress: Progress | None = None) -> dict[str, Any]:
    p = PERTURBATIONS[name]
    result = run_trial(task, p.world, seed, **how, progress=progress).result
    return {"perturbation": name, "words": p.words, "seed": seed, **result}


def first_report(row: dict[str, Any]) -> dict[str, Any] | None:
    """What the controller said first; None if nothing."""
    return next(iter(row.get("reports", ())), None)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The rows as text; those of several seeds as median, 90 % and worst."""
    if len({row["seed"] for row in rows}) > 1:
        return _table_of_seeds(rows)
    lines = [f"{'perturbation':44s}{'true':>9s}{'believed':>10s}{'torque x':>10s}{'lean':>7s}  end; reported"]
    for row in rows:
        report, scored = first_report(row), bool(row.get("samples"))
        cells = "        -         -         -      -"
        if scored:
            believed, lean = (row["believed_z"] or {}).get("rmse", float("nan")), row["lean_deg"]["rms"]
            cells = f"{row['force_z']['rmse']:9.3f}{believed:10.3f}{row['torque_x']['rmse']:10.3f}{lean:7.2f}"
        swings = ", swings" if (row.get("swing") or {}).get("seen") else ""
        said = "no" if report is None else _when(report)
        lines.append(f"{row['words']:44s}{cells}  {'finished' if row['finished'] else 'aborted'}{swings}; {said}")
    return "\n".join(lines)


def _table_of_seeds(rows: Sequence[dict[str, Any]]) -> str:
    """A line per perturbation."""
    heads = "".join(f"{name:>25s}" for name in ("true force [N]", "torque x [N m]", "lean [deg]"))
    lines = ["median / 90 % / worst", f"{'perturbation':44s}{heads}  finished; reported"]
    for name in dict.fromkeys(row["perturbation"] for row in rows):
        these = [row for row in rows if row["perturbation"] == name]
        cells = ""
        for key in ("force_z", "torque_x", "lean"):
            values = [v for row in these if (v := value_of(row, key)) is not None]
            s = spread(values) if values else None
            cells += f"{'-' if s is None else '{median:.3f} / {p90:.3f} / {worst:.3f}'.format(**s):>25s}"
        finished = f"{sum(bool(row['finished']) for row in these)} of {len(these)}"
        lines.append(f"{these[0]['words']:44s}{cells}  {finished}; {_reports(these)}")
    return "\n".join(lines)


def _reports(rows: Sequence[dict[str, Any]]) -> str:
    """How often something was reported, and when."""
    first = [r for row in rows if (r := first_report(row)) is not None]
    after = [r["after"] for r in first if not _before_contact(r)]
    said = f"{len(first)} of {len(rows)}"
    if len(after) < len(first):
        said += f", {len(first) - len(after)} before contact"
    return said + (f", {len(after)} after {np.median(after):.1f} s, at most {max(after):.1f} s" if after else "")


def _before_contact(report: dict[str, Any]) -> bool:
    return report["after"] is None or report["after"] < 0


def _when(report: dict[str, Any]) -> str:
    when = "before contact" if _before_contact(report) else f"after {report['after']:.1f} s"
    return f"{when}: {report['text']}"

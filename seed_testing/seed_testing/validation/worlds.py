# SPDX-License-Identifier: Apache-2.0
"""An estimator in hidden worlds: mounts, lenses, range, lag and skew that it is not told of, and what is left of it."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from joblib import delayed

from seed_core.errors import SeedError
from seed_core.spatial import interpolate_pose
from seed_sim.campaigns import spread
from seed_sim.closed_loop.progress import in_parallel
from seed_sim.scenario import Scenario
from seed_sim.tactile.trajectory import poses
from seed_sim.world.cameras import WorldCameras
from seed_sim.world.draw import draw_world
from seed_sim.world.parameters import World
from seed_sim.world.poses import make_estimator, take_grasp
from seed_sim.world.procedures.find_out import calibrate_cameras
from seed_testing.validation.scores import AXES, NAMED, Series, scores


def run_world(scenario: Scenario, world: World, method: str, seed: int) -> Series:
    """Truth and estimates of one trajectory in a world, calibrated there; scored against the pose at the stamp.

    Raises:
        SeedError: the calibration fails, or the estimator does not see the grasp.
    """
    cv2.setNumThreads(1)
    calibration = calibrate_cameras(scenario, world, seed) if world.procedures.run else None
    cameras, period = WorldCameras(scenario, world, seed), 1.0 / scenario.trajectory.rate
    estimator = make_estimator(scenario, cameras, calibration, method, period)
    take_grasp(estimator, cameras, np.eye(4), 0.0, period)
    series, before = Series(), np.eye(4)
    for t, X_CT in poses(scenario.trajectory, seed):
        seen = {f: interpolate_pose(before, X_CT, max(1.0 - e / period, 0.0)) for f, e in cameras.early.items()}
        images = {f: cameras.finger(f, X, t) for f, X in seen.items()}
        series.estimate(estimator, images, t + world.images.clock, X_CT)
        before = X_CT
    return series


def score_worlds(scenario: Scenario, method: str, draws: Sequence[int], jobs: int = 1) -> dict[str, Any]:
    """Scores of every draw, and median, 90 % and worst over them by figure."""
    runs = list(in_parallel([delayed(_one)(scenario, method, d) for d in draws], jobs, "draw"))
    good = [r for r in runs if r.get("nees") is not None]
    summary: dict[str, Any] = {"draws": len(runs), "scored": len(good)}
    if good:
        summary["nees"] = spread([r["nees"] for r in good])
        summary["valid_fraction"] = {"median": float(np.median([r["valid_fraction"] for r in runs])),
                                     "worst": min(r["valid_fraction"] for r in runs)}  # fmt: skip
        summary["rmse"] = {n: spread([r["rmse"][n] for r in good]) for n in NAMED}
        gains = {a: [r["gain"][a] for r in good if r["gain"][a] is not None] for a in AXES}
        summary["gain_error"] = {a: spread([abs(g - 1.0) for g in gains[a]]) if gains[a] else None for a in AXES}
    return {"method": method, "scenario": scenario.name, "draws": runs, "summary": summary}


def _one(scenario: Scenario, method: str, draw: int) -> dict[str, Any]:
    try:
        series = run_world(scenario, draw_world(draw), method, draw)
    except SeedError as error:
        return {"draw": draw, "error": str(error), "valid_fraction": 0.0}
    return {"draw": draw, **scores(series, scenario.trajectory.score_from)}


def table(result: dict[str, Any]) -> str:
    """The scores as text: a line per draw, then the summary."""
    head = "".join(f"{name:>10s}" for name in NAMED)
    lines = [f"{result['method']}, {result['scenario']}, rms errors in hidden worlds", f"draw    valid{head}      nees"]
    for r in result["draws"]:
        if r.get("nees") is None:
            lines.append(f"{r['draw']:4d}{100 * r['valid_fraction']:7.1f} %  {r.get('error', 'hardly ever valid')}")
            continue
        cells = "".join(f"{r['rmse'][n]:10.3f}" for n in NAMED)
        lines.append(f"{r['draw']:4d}{100 * r['valid_fraction']:7.1f} %{cells}{r['nees']:10.2f}")
    summary = result["summary"]
    for name in ("median", "p90", "worst") if summary["scored"] else ():
        cells = "".join(f"{summary['rmse'][n][name]:10.3f}" for n in NAMED)
        lines.append(f"{name:13s}{cells}{summary['nees'][name]:10.2f}")
    return "\n".join(lines)

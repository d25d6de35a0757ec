# SPDX-License-Identifier: Apache-2.0
"""How far off the estimator's motion of each membrane is, on rendered images of membranes with mechanics.

What is true are the nodes of the same band around the patch. The handle moves as the scenario `long_cylinder` says,
a quarter as far, so that it stays in the grasp.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from joblib import delayed

from seed_core.errors import SeedError
from seed_core.estimate import MembraneMotion
from seed_core.hand import FINGERS
from seed_core.membrane.features import DEFORMATION, RIGID
from seed_core.spatial import Array, rotation_error
from seed_sim.bubble_renderer import HeldRenderer, renderer_of
from seed_sim.closed_loop.progress import in_parallel
from seed_sim.scenario import load_scenario
from seed_sim.tactile.trajectory import poses
from seed_testing.validation.maps.membrane_run import Watcher
from seed_testing.validation.run import FOLDERS, between_membranes, estimator_for

DURATION = 10.0  # [s] of the scenario's motion
NAMES = (*RIGID, *DEFORMATION)
UNITS = np.array([np.rad2deg(1.0)] * 3 + [1e3] * 12)  # degrees and mm, as told


def errors(seed: int) -> tuple[dict[str, Array], float]:
    """By finger (n, 15) [deg, mm]: turn, shift at the band's middle, deformation; and the mean share that slides.

    Raises:
        SeedError: the membrane of this seed cannot be grasped, or the estimator does not see it.
    """
    scenario = between_membranes(load_scenario("long_cylinder", *FOLDERS), seed)
    scenario = replace(scenario, trajectory=replace(scenario.trajectory, duration=DURATION))
    renderer = renderer_of(scenario, seed)
    assert isinstance(renderer, HeldRenderer)
    estimator = estimator_for(scenario, "rigid_fit", renderer)
    exact = Watcher(renderer.hold.state, 0.0, np.random.default_rng(seed))
    out: dict[str, list[Array]] = {finger: [] for finger in FINGERS}
    sliding = []
    for stamp, X_CT in poses(scenario.trajectory, seed):
        estimate = estimator.update(renderer.render(X_CT, stamp), stamp)
        state = renderer.hold.state
        sliding.append(state.sliding_share)
        true = {m.finger: m for m in exact.motions(state, scenario.membrane.ambient)}
        for told in estimate.membrane:
            out[told.finger].append(_error(told, true[told.finger]))
    if not all(len(told) > 1 for told in out.values()):
        raise SeedError("the estimator told no motion of a membrane")
    return {finger: UNITS * np.array(told) for finger, told in out.items()}, float(np.mean(sliding))


def _error(told: MembraneMotion, true: MembraneMotion) -> Array:
    """(15,) [rad, m] of what is told."""
    turn, off = rotation_error(told.X_CM[:3, :3], true.X_CM[:3, :3]), told.X_CM - true.X_CM
    shift = off[:3, :3] @ true.centroid + off[:3, 3]
    return np.concatenate((turn, shift, told.deformation - true.deformation))


def score(seed: int) -> dict[str, Any]:
    """Rms error over a motion in degrees and mm, and its part from image to image; `failed` says why there is none."""
    try:
        off, sliding = errors(seed)
    except SeedError as error:
        return {"seed": seed, "failed": str(error)}
    quick = np.concatenate([np.diff(finger, axis=0) for finger in off.values()]) / np.sqrt(2.0)
    return {"seed": seed, "sliding": sliding, "rms": _rms(np.concatenate([*off.values()])), "quick": _rms(quick)}


def scores(seeds: Sequence[int], jobs: int) -> dict[str, Any]:
    """Of every membrane, and rms over them."""
    runs = list(in_parallel([delayed(score)(s) for s in seeds], jobs, "membrane"))
    good = [r for r in runs if "failed" not in r]
    out: dict[str, Any] = {"membranes": len(runs), "scored": len(good), "names": NAMES, "runs": runs}
    return out | {name: _rms(np.array([r[name] for r in good])) for name in ("rms", "quick") if good}


def table(result: dict[str, Any]) -> str:
    """The errors, in words."""
    lines = [f"{result['scored']} of {result['membranes']} membranes; rms error of what is told of each"]
    if result["scored"]:
        lines.append(f"{'':<10}{'all':>9}{'image to image':>16}")
        for name, unit, a, b in zip(NAMES, ["deg"] * 3 + ["mm"] * 12, result["rms"], result["quick"], strict=True):
            lines.append(f"{name:<10}{a:9.3f}{b:16.3f} {unit}")
    return "\n".join(lines + [f"membrane {r['seed']} failed: {r['failed']}" for r in result["runs"] if "failed" in r])


def _rms(values: Array) -> list[float]:
    return np.sqrt((values**2).mean(axis=0)).tolist()  # type: ignore[no-any-return]

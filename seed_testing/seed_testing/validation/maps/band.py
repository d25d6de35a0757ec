# SPDX-License-Identifier: Apache-2.0
"""How far off the estimator's motion of each membrane is, on rendered images of membranes with mechanics.

What is true are the nodes of the same band around the patch. The handle moves as the scenario `long_cylinder` says,
a quarter as far, so that it stays in the grasp.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from joblib import delayed

from seed_core.errors import SeedError
from seed_core.membrane.features import DEFORMATION, RIGID
from seed_core.membrane.material import around, deformation, rigid_motion
from seed_core.spatial import Array, rotation_error
from seed_sim.bubbles import HeldRenderer, renderer_of
from seed_sim.closed_loop.progress import in_parallel
from seed_sim.membrane import GraspState
from seed_sim.scenario import load_scenario, on_membrane
from seed_sim.tactile.trajectory import poses
from seed_testing.validation.run import FOLDERS, estimator_for

SCALE = 0.25  # of the scenario's motion
DURATION = 10.0  # [s] of it
NAMES = (*RIGID, *DEFORMATION)
UNITS = np.array([np.rad2deg(1.0)] * 3 + [1e3] * 12)  # degrees and mm, as told


class _Band(NamedTuple):
    """Points (3, n) of the band of each finger at the grasp, and which nodes they are."""

    nodes: dict[str, np.ndarray]
    before: dict[str, Array]

    @classmethod
    def of(cls, grasped: GraspState) -> "_Band":
        nodes = {f: around(b.nodes.T, b.nodes[b.touching].T) for f, b in grasped.bubbles.items()}
        return cls(nodes, {f: b.nodes[nodes[f]].T for f, b in grasped.bubbles.items()})


def errors(seed: int) -> tuple[dict[str, Array], float]:
    """By finger (n, 15) [deg, mm]: turn, shift at the band's middle, deformation; and the mean share that slides.

    Raises:
        SeedError: the membrane of this seed cannot be grasped, or the estimator does not see it.
    """
    scenario = on_membrane(load_scenario("long_cylinder", *FOLDERS), seed)
    moved = replace(scenario.trajectory, scale=SCALE * scenario.trajectory.scale, duration=DURATION)
    scenario = replace(scenario, trajectory=moved)
    renderer = renderer_of(scenario, seed)
    assert isinstance(renderer, HeldRenderer)
    estimator = estimator_for(scenario, "rigid_fit", renderer)
    band, sliding = _Band.of(renderer.hold.state), list[float]()
    out: dict[str, list[Array]] = {finger: [] for finger in band.nodes}
    for stamp, X_CT in poses(moved, seed):
        estimate = estimator.update(renderer.render(X_CT, stamp), stamp)
        state = renderer.hold.state
        sliding.append(state.sliding_share)
        for told in estimate.membrane:
            before, after = band.before[told.finger], state.bubbles[told.finger].nodes[band.nodes[told.finger]].T
            X, middle = rigid_motion(before, after), before.mean(axis=1)
            shift = (told.X_CM - X)[:3, :3] @ middle + (told.X_CM - X)[:3, 3]
            turn = rotation_error(told.X_CM[:3, :3], X[:3, :3])
            error = np.concatenate((turn, shift, told.deformation - deformation(X, before, after)))
            out[told.finger].append(error)
    if not all(len(told) > 1 for told in out.values()):
        raise SeedError("the estimator told no motion of a membrane")
    return {finger: UNITS * np.array(told) for finger, told in out.items()}, float(np.mean(sliding))


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

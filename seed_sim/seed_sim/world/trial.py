# SPDX-License-Identifier: Apache-2.0
"""One task in one world: what the suite finds out first, then the task, scored by true and by believed force."""

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seed_control.tasks import Task
from seed_control.tasks.task import Phase
from seed_core.errors import SeedError
from seed_core.spatial import Array
from seed_core.wrench_settings import WrenchModelName
from seed_sim.closed_loop.evaluate import check_task, load_both
from seed_sim.closed_loop.progress import Progress
from seed_sim.closed_loop.recording import Recording, rms, score, scored_phase
from seed_sim.closed_loop.relative_poses import FROM_IMAGES, refuse_calibrate
from seed_sim.closed_loop.run import START_HEIGHT, play
from seed_sim.scenario import Scenario, on_membrane
from seed_sim.world.belief import Belief
from seed_sim.world.cell import make_plant, make_steering
from seed_sim.world.parameters import Kind, World
from seed_sim.world.procedures.find_out import STEPS, check_model, find_out

SWING = 0.5  # [N] rms of force faster than a second that counts as a limit cycle
_SMOOTH = 1.0  # [s] over which slower force is averaged
LOOK_HEIGHT, LOOK_TILT, LOOK_TIME = 0.03, 15.0, 0.8  # [m], [deg], [s] of the look at the tool in free space
WITHIN = 2.0  # [standard deviations]


@dataclass(frozen=True)
class Trial:
    """One run: its score, what was recorded, and what was believed."""

    result: dict[str, Any]
    recording: Recording
    belief: Belief


def run_trial(
    task: str | Path | Task,
    world: World,
    seed: int,
    *,
    law: str = "seed",
    estimator: str = "rigid_fit",
    force: float | None = None,
    scenario: str | Path | Scenario | None = None,
    model: WrenchModelName | None = None,
    arm_sensor: bool = False,
    belief: Belief | None = None,
    progress: Progress | None = None,
) -> Trial:
    """Find out what can be found out about a world, and play the task in it; deterministic but for times.

    Args:
        task: name, path or task.
        world: that nobody knows.
        seed: of the plant's and the images' noise.
        law, estimator: of the control. model: what the wrench is computed from;
            default: membranes where there are any, else a hysteretic spring.
        force: [N] replaces the size of every force in the task.
        scenario: what the world departs from; default: the task's own.
        arm_sensor: the arm has a force/torque reading of its own.
        belief: found before, in this very world; default: find it out now.
        progress: is told what is being found out, then the phase of the task and the simulated time.

    Raises:
        SeedError: unknown names, or values that cannot be used.
    """
    task, scenario = load_both(task, scenario, force)
    check_task(task, scenario, law)
    check_kind(world.kind, scenario, model, estimator)
    scenario = _in_world(scenario, world, estimator, arm_sensor)
    model = model or ("membrane" if world.kind == "membrane" else "hysteretic")
    began = time.perf_counter()
    if belief is None:
        method = estimator if estimator in FROM_IMAGES else "rigid_fit"
        belief = find_out(scenario, world, seed, method, model, progress)
    task = with_look(task)
    # held as firmly as the identification has found to be needed
    plant = make_plant(replace(scenario, membrane=belief.scenario.membrane), world, seed, task)
    recording = Recording([])
    try:
        steering = make_steering(plant, belief, world, seed, law=law, estimator=estimator)
        recording = play(task, plant, steering, progress)
        scored = score(recording, scored_phase(task)) | beliefs(recording, scored_phase(task))
    except SeedError as error:
        scored = {"finished": False, "error": str(error)}
    result = {
        "task": task.name,
        "scenario": scenario.name,
        "law": law,
        "estimator": estimator,
        "model": getattr(belief.wrench_model(), "name", "bushing"),
        "world": world.kind,
        "draw": world.seed,
        **scored,
        "message": recording.message,
        "problems": list(belief.problems),
        "found": belief.figures,
        "seconds": {**belief.seconds, "all": time.perf_counter() - began},
    }
    return Trial(result, recording, belief)


def _in_world(scenario: Scenario, world: World, estimator: str, arm_sensor: bool) -> Scenario:
    """What a world departs from: with its membranes, where it has any, and the arm's sensor. Raises SeedError."""
    if world.kind == "membrane":
        scenario = on_membrane(scenario, world.seed, firm=True)
    if estimator in FROM_IMAGES and not ("calibrate" in STEPS[world.kind] and world.procedures.run):
        refuse_calibrate(scenario, "a world of membranes, or with one perturbation,")
    if arm_sensor:
        m = scenario.measurement
        scenario = replace(scenario, measurement=replace(m, arm_sensor=replace(m.arm_sensor, present=True)))
    return scenario


def check_kind(kind: Kind, scenario: Scenario, model: WrenchModelName | None, estimator: str) -> None:
    """Raises SeedError: the scenario's grasp, or the model of the wrench, is none of a world of this kind."""
    if estimator in FROM_IMAGES and any(scenario.grasp.taken_under):
        raise SeedError(
            f"scenario '{scenario.name}': grasp.taken_under = {list(scenario.grasp.taken_under)} N: a hidden world's "
            "grasp is taken without load: leave it out, or give --world known (of one that hangs: --perturb hanging)"
        )
    if kind != "membrane" and scenario.grasp.kind == "membrane":
        raise SeedError(
            f"scenario '{scenario.name}': grasp.kind = membrane: the grasp of this world is a spring; give --membranes "
            "for hidden worlds with membranes, or --world known for these"
        )
    if model is not None:
        check_model(kind, model)


def with_look(task: Task) -> Task:
    """The task with a look at the hanging tool before it: up, tilted and back, as the controller's checks want it.

    A task that draws stays as it is: its strokes come after its first phase.
    """
    if task.draw is not None:
        return task
    x, y, z = task.phases[0].to or (0.0, 0.0, 0.0)
    low = (x, y, max(z, START_HEIGHT))
    high = (x, y, low[2] + LOOK_HEIGHT)
    tilted = (LOOK_TILT, 0.0, 0.0)
    look = (
        Phase("start", low),
        Phase("look", high, dwell=LOOK_TIME),
        Phase("look tilted", high, tilt=tilted, dwell=LOOK_TIME),
        Phase("look upright", high, tilt=(0.0, 0.0, 0.0), dwell=LOOK_TIME),
    )
    return replace(task, phases=look + task.phases)


def beliefs(recording: Recording, phase: str) -> dict[str, Any]:
    """Believed force against the true one, over the samples that count; what was reported, and when.

    `within`: whether the error of belief, rms, is at most two stated deviations, rms; None where none is stated.
    `reports`: what the controller said for the first time, and when, in seconds from first contact.
    """
    contact = recording.contact_time
    out: dict[str, Any] = {"reports": _reports(recording, contact), "swing": None, "believed_z": None, "stated_z": None}
    keep = recording.scored(phase)
    if not keep.any():
        return out
    true, believed = recording["force"][keep, 2], recording["believed_force"][keep, 2]
    wanted, stated = recording["wanted_force"][keep, 2], recording["stated_force"][keep, 2]
    error = _rms(believed - true)
    swing = _swing(true, recording["t"][keep])
    deviation = _rms(stated)
    return out | {
        "believed_z": {"rmse": _rms(believed - wanted), "error": error, "bias": float(np.nanmean(believed - true))},
        "stated_z": deviation if np.isfinite(deviation) else None,
        "within": bool(error <= WITHIN * deviation) if np.isfinite(deviation) else None,
        "swing": {"rms": swing, "seen": swing > SWING},
        "nees": _nees(recording, keep),
    }


def _reports(recording: Recording, contact: float | None) -> list[dict[str, Any]]:
    """Reasons, contradictions and doubts as they come up, each once, numbers in them aside."""
    seen: set[str] = set()
    out = []
    for t, mode, told in zip(*(recording.rows.get(name, ()) for name in ("t", "mode", "told")), strict=True):
        for text in told:
            kind = "".join(c for c in text if not c.isdigit() and c not in ".-+")
            if kind not in seen:
                seen.add(kind)
                after = float(t - contact) if contact is not None else None
                out.append({"after": after, "mode": mode, "text": text})
    return out


def _swing(force: Array, t: Array) -> float:
    """Rms [N] of what is faster than a moving mean."""
    n = max(int(_SMOOTH / max(float(np.median(np.diff(t))), 1e-6)), 1)
    if len(force) < 2 * n:
        return 0.0
    slow = np.convolve(force, np.ones(n) / n, mode="valid")
    return float(np.std(force[n // 2 : n // 2 + len(slow)] - slow))


def _nees(recording: Recording, keep: NDArray[np.bool_]) -> float | None:
    """Mean of e^T C^-1 e over the wrench's six components: 6 if the stated covariance is honest; None without one."""
    squares = []
    for e, C in zip(recording["wrench_error"][keep], recording["wrench_covariance"][keep], strict=True):
        if np.isfinite(e).all() and np.isfinite(C).all() and C.any():
            squares.append(float(e @ np.linalg.pinv(C, hermitian=True) @ e))
    return float(np.mean(squares)) if squares else None


def _rms(values: Array) -> float:
    good = values[np.isfinite(values)]
    return rms(good) if len(good) else float("nan")

# SPDX-License-Identifier: Apache-2.0
"""The evaluation of a task in closed loop, for SEED and for its baselines: one call, one score."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from seed_control.parameters import LAWS as CONTROL_LAWS
from seed_control.tasks import Task, check_fits, check_tool, load_task
from seed_core.errors import SeedError
from seed_core.wrench_model import WrenchModel
from seed_sim.closed_loop.baselines import BASELINES, WELDED, BaselineSteering
from seed_sim.closed_loop.progress import Progress
from seed_sim.closed_loop.recording import Recording, score, scored_phase
from seed_sim.closed_loop.relative_poses import Poses
from seed_sim.closed_loop.run import SeedSteering, Steering, parameters_of, play, start_pose
from seed_sim.closed_loop.surface_score import surface_score
from seed_sim.plant.holes.score import insertion_of
from seed_sim.plant.plant import Plant
from seed_sim.replay.film import Film
from seed_sim.scenario import Scenario, load_scenario, on_membrane, shipped_scenarios

LAWS = (*CONTROL_LAWS, *BASELINES)
SEED = 7  # of a run for which none is named


def scenario_of(task: Task) -> str:
    """Name of the scenario that a task is simulated in when none is named: that of its tool's name, or nominal."""
    return task.tool if task.tool in shipped_scenarios() else "nominal"


def load_both(
    task: str | Path | Task, scenario: str | Path | Scenario | None, force: float | None
) -> tuple[Task, Scenario]:
    """A task with the size [N] of its forces, and its scenario; names and files are loaded, what is loaded is kept.

    Raises:
        SeedError: a name is unknown, or a file cannot be used.
    """
    if not isinstance(task, Task):
        task = load_task(task, force)
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario_of(task) if scenario is None else scenario)
    return task, scenario


def check_task(task: Task, scenario: Scenario, law: str) -> None:
    """Raises SeedError: the task is made for another tool, or asks for more than the controller may be asked for."""
    if law in BASELINES:
        check_tool(task, scenario.tool)
    else:
        check_fits(task, scenario.tool, parameters_of(scenario, law))


@dataclass(frozen=True)
class Evaluation:
    """One run: its score (the object of `./seed evaluate --json`), what was recorded, and the plant at its end."""

    result: dict[str, Any]
    recording: Recording
    plant: Plant


def evaluate(
    task: str | Path | Task = "squeegee",
    *,
    law: str = "seed",
    estimator: str = "truth",
    force: float | None = None,
    seed: int = SEED,
    scenario: str | Path | Scenario | None = None,
    membrane: int | None = None,
    poses: Poses | None = None,
    wrench_model: WrenchModel | None = None,
    film: Film | None = None,
    progress: Progress | None = None,
) -> Evaluation:
    """Play a task once in closed loop and score it; deterministic per seed but for `real_time_factor`.

    Args:
        task: name, path or task.
        law: one of LAWS: a control law of seed_control, or a baseline.
        estimator: of the relative pose, one of `relative_poses.ESTIMATORS`; baselines use none.
        force: [N] replaces the size of every force in the task.
        seed: draws the table, the arm's errors and all noise.
        scenario: name, file or scenario; default: the task's own.
        membrane: draws two membranes with mechanics in place of the scenario's grasp, see `scenario.on_membrane`.
        poses: an estimator of your own in place of the one that `estimator` names; has `next_image`, `take_image` and
            `arrived`, as `Poses` of `closed_loop/relative_poses.py` says: a `PoseSource` lacks `measure` alone.
        wrench_model: one of your own in place of the one that the scenario names; not for baselines, nor are poses.
        film: keeps moments of the run to look at, or None.
        progress: is told the share of the task, the name of its phase and the simulated time.

    Returns:
        The score with the recording of the run.

    Raises:
        SeedError: unknown names, or values that cannot be used.
    """
    task, scenario = load_both(task, scenario, force)
    if membrane is not None:
        scenario = on_membrane(scenario, membrane, firm=True)
    if law not in LAWS:
        raise SeedError(f"law '{law}' is unknown; known: {', '.join(LAWS)}")
    if law in BASELINES and (poses is not None or wrench_model is not None):
        raise SeedError(f"law '{law}' is a baseline, which goes by neither poses nor a wrench_model")
    check_task(task, scenario, law)
    began = time.perf_counter()
    X_WE = start_pose(scenario, task)
    plant = Plant(scenario, seed, task.frame.pose, X_WE, welded=law in WELDED, film=film)
    steering: Steering
    if law in BASELINES:
        steering, estimator = BaselineSteering(plant, task, law), "none"
    else:
        steering = SeedSteering(plant, scenario, law, estimator, seed, poses, wrench_model)
        estimator = estimator if poses is None else type(poses).__name__
    recording = play(task, plant, steering, progress)
    wall_time = time.perf_counter() - began
    result = {
        "task": task.name,
        "scenario": scenario.name,
        "law": law,
        "seed": seed,
        "estimator": estimator,
        **score(recording, scored_phase(task)),
        "insertion": insertion_of(plant, recording, task),
        "message": recording.message,
        "surface": surface_score(recording, task),
        "membrane": _of_membranes(plant, membrane),
        "real_time_factor": plant.time / max(wall_time, 1e-9),
    }
    return Evaluation(result, recording, plant)


def _of_membranes(plant: Plant, seed: int | None) -> dict[str, Any] | None:
    """How the membranes fared; None where the grasp is another."""
    hold = plant.membranes
    if hold is None:
        return None
    return {"seed": seed, "solves": hold.solves, "unsettled": hold.unsettled, "most_sliding": hold.most_sliding}

# SPDX-License-Identifier: Apache-2.0
"""One run of one method in one case: the plant of that seed, the method's steering, its scores."""

from typing import Any, NamedTuple

import numpy as np

from seed_core.errors import FailedError
from seed_sim.closed_loop.recording import Recording
from seed_sim.closed_loop.run import play, start_pose
from seed_sim.comparison.bumps import BumpyTable
from seed_sim.comparison.cases import SWING_RATE, Case, case_named
from seed_sim.comparison.methods import Settings, method_named
from seed_sim.comparison.score import SCORES, scores_of
from seed_sim.plant.arm import MovingTable
from seed_sim.plant.plant import Plant

TRACED = 10  # every tenth seed keeps its force over time
BEFORE, EVERY = 0.2, 2  # [s] before contact from which on, and of how many steps one


class Run(NamedTuple):
    """What is to be run."""

    method: str
    case: str
    seed: int

    @property
    def key(self) -> str:
        """For a file of results."""
        return f"{self.method}|{self.case}|{self.seed}"


def recorded(run: Run, settings: Settings) -> tuple[Recording, Case]:
    """Play it. Raises FailedError where the plant diverges."""
    case, method = case_named(run.case), method_named(run.method)
    scenario, task = case.scenario(run.seed), case.task()
    plant = Plant(scenario, run.seed, task.frame.pose, start_pose(scenario, task), welded=method.rigid)
    if case.bumps.size:
        plant.arm.error = BumpyTable(plant.arm, case.bumps)
    if case.swing:
        phase = np.random.default_rng([run.seed, 0x5A]).uniform()
        plant.arm.error = MovingTable(plant.arm.error, case.swing, SWING_RATE, -phase / SWING_RATE)
    return play(task, plant, method.build(plant, scenario, task, run.seed, settings)), case


def scored(run: Run, settings: Settings) -> dict[str, Any]:
    """Its scores with how it ended; a plant that diverges is a failure of the method's."""
    row: dict[str, Any] = {"method": run.method, "case": run.case, "seed": run.seed, "settings": dict(settings)}
    try:
        recording, case = recorded(run, settings)
    except FailedError as error:
        force = case_named(run.case).force
        return row | dict.fromkeys(SCORES) | {"rms": force, "p90": force, "finished": False, "message": str(error)}
    if run.seed % TRACED == 0:
        row["trace"] = _trace(recording)
    return row | scores_of(recording, case.force) | {"finished": recording.finished, "message": recording.message}


def _trace(recording: Recording) -> dict[str, list[float]]:
    """Force over time at a hundredth of a second, from shortly before contact to the lift, for pictures."""
    keep = recording["phase"] < len(recording.phases) - 1
    start = (recording.contact_time or 0.0) - BEFORE
    keep &= recording["t"] >= start
    rows = np.flatnonzero(keep)[::EVERY]
    force, wanted = -recording["force"][rows, 2], -recording["wanted_force"][rows, 2]
    t = recording["t"][rows] - start - BEFORE
    return {name: np.round(v, 3).tolist() for name, v in (("t", t), ("force", force), ("wanted", wanted))}

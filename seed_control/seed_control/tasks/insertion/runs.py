# SPDX-License-Identifier: Apache-2.0
"""Which run a step of a task needs."""

import numpy as np

from seed_control.tasks.insertion.insert import InsertRun
from seed_control.tasks.insertion.search import SearchRun
from seed_control.tasks.path import Path
from seed_control.tasks.steps import Step, StepRun
from seed_core.spatial import Array

_JOINS = 0.01  # [m] from its start, where a tip that landed beside it comes back onto its path


def run_of(step: Step, start: Array, R_start: Array, R_end: Array, X_W: Array, before: StepRun | None) -> StepRun:
    """The run of a step from the tip's place `start` (3,) and rotation R_start (3, 3) to R_end, in the work frame X_W.

    before: the run that has ended.
    """
    phase = step.phase
    own = phase.search is not None or phase.insert is not None
    if own and before is not None:
        if before.R_seen is not None and before.p_seen is not None:
            start, R_start, R_end = before.p_seen, before.R_seen, before.R_seen  # torque has left the reference
        start = start - before.beside  # a tip that landed beside its place searches about that place
    if phase.search is not None:
        return SearchRun(step, start, R_start, R_end, X_W, before)
    if phase.insert is not None:
        plate = before.plate if isinstance(before, SearchRun) else None
        return InsertRun(step, start, R_start, R_end, X_W, plate)
    points = [start, *step.points]
    if before is not None and phase.control is not None:
        points[1:1] = _back(start, before.beside, step)
    return StepRun(step, Path(np.array(points), phase.speed, phase.acceleration), R_start, R_end, X_W)


def _back(start: Array, beside: Array, step: Step) -> list[Array]:
    """Where a path is joined, if at all, by a tip that has landed beside its start [m]."""
    if not step.points or not beside.any():
        return []
    way = np.array(step.points[0]) - (start - beside)
    length = float(np.sqrt(way @ way))
    return [start - beside + _JOINS / length * way] if length > _JOINS else []

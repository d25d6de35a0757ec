# SPDX-License-Identifier: Apache-2.0
"""Plays a task: set-points by time and by the controller's state. Cancelled or failed, it leaves the tool lifted."""

from dataclasses import dataclass, replace

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState
from seed_control.tasks.contact_stop import FoundPlace, StopRun
from seed_control.tasks.insertion.insert import InsertRun
from seed_control.tasks.insertion.search import SearchRun
from seed_control.tasks.path import Path
from seed_control.tasks.steps import Step, StepRun, steps_of
from seed_control.tasks.surface_run import SurfaceRun
from seed_control.tasks.task import Phase, Task
from seed_core.spatial import Array, inverse_pose, length, rotation_from_rpy

_LIFT_SPEED = 0.05  # [m/s]
_JOINS = 0.01  # [m] from its start, where a tip that landed beside it comes back onto its path


@dataclass(frozen=True)
class TaskStatus:
    """What to send now, and how far the task is.

    Attributes:
        setpoint: for the controller; None when there is nothing (more) to send.
        phase: name of the running phase; 'lift after cancel' and the like while it ends early.
        progress: 0 to 1.
        done: nothing more will come: finished, failed or cancelled, tool lifted where the arm could move.
        failed, cancelled: how it ended, or is ending.
        index: of the running phase among the player's `phases`, whose names may repeat; None before the first, and
            while it ends early.
    """

    setpoint: HybridSetpoint | None
    phase: str
    progress: float
    done: bool = False
    failed: bool = False
    cancelled: bool = False
    message: str = ""
    index: int | None = None


class TaskPlayer:
    """One run of one task. Call `step` at the control rate with the controller's newest state.

    Attributes:
        found: where steps `contact_stop` have touched something, in order.
    """

    def __init__(self, task: Task, waits: bool = True) -> None:
        """waits: for a controller that is not enabled at the first step; otherwise the task fails then."""
        self.task, self._waits = task, waits
        self._steps = steps_of(task)
        self._X_W = task.frame.pose
        self._R_tip = rotation_from_rpy(np.deg2rad(task.tip_rpy))
        self._tilted = self._R_tip  # by the newest tilt, in the work frame or in the surface's axes
        self._index = -1  # of the running step; their number while the tool is lifted early
        self._run: StepRun | None = None
        self._status = TaskStatus(None, "waiting", 0.0)
        self._ending = ""  # why the task ends early
        self._cancelled = False
        self._searches = 0  # once more, where an insertion found no way in
        self.found: tuple[FoundPlace, ...] = ()
        self._last: float | None = None
        self._before = np.cumsum([0.0, *(s.expected_time for s in self._steps)])

    @property
    def phase(self) -> str:
        """Name of the running phase."""
        return self._status.phase

    @property
    def phases(self) -> list[str]:
        """Names of all steps in order."""
        return [s.phase.name for s in self._steps]

    def cancel(self, reason: str = "cancelled") -> None:
        """End early: the next steps lift the tool off, then the status is done."""
        self._cancelled = True
        self._end_early(reason)

    def step(self, t: float, state: ControllerState) -> TaskStatus:
        """Status at time t [s], with the set-point to send."""
        if not self._status.done:
            dt = 0.0 if self._last is None else max(t - self._last, 0.0)
            self._last = t
            self._status = self._advance(dt, state)
        return self._status

    def _advance(self, dt: float, state: ControllerState) -> TaskStatus:
        if self._run is None and self._ending:
            return self._ended(self._ending)
        if state.X_W_tip is None or not state.enabled or state.mode == "holding":
            if self._run is None and self._waits:
                return self._status
            holds = f"arm holds: {state.reason or 'the controller stopped'}"
            return self._ended(f"{self._ending}; {holds}" if self._ending else holds)
        if self._run is None:
            self._run = self._next(state.X_W_tip)
        ended = self._run.advance(dt, state)
        if ended == "again" and not self._ending and self._search_again():
            ended = "done"
        if ended in ("timeout", "failed", "again") and not self._ending:
            phase = self._run.step.phase
            waited = f"phase '{phase.name}' waited {phase.timeout:g} s for '{phase.until}'"
            self._end_early(self._run.why or (f"{waited}: {state.reason}" if state.reason else waited))
        elif ended:
            if isinstance(self._run, StopRun) and self._run.found is not None:
                self.found = (*self.found, self._run.found)
            if self._index >= len(self._steps):
                return self._ended(self._ending)
            if not self._ending and self._index + 1 == len(self._steps):
                return TaskStatus(None, "done", 1.0, done=True, message="; ".join(["finished", *map(str, self.found)]))
            self._run = self._next(state.X_W_tip)
        return TaskStatus(
            self._run.setpoint(),
            self._run.step.phase.name,
            self._progress(),
            failed=bool(self._ending) and not self._cancelled,
            cancelled=self._cancelled,
            message=self._ending,
            index=self._index if self._index < len(self._steps) else None,
        )

    def _search_again(self) -> bool:
        """Go back to the search before an insertion that found no way in, as often as it says."""
        assert self._run is not None
        searches = [i for i, step in enumerate(self._steps[: self._index]) if step.phase.search is not None]
        insert = self._run.step.phase.insert
        if not searches or insert is None or self._searches >= insert.searches:
            return False
        self._searches += 1
        self._index = searches[-1] - 1
        return True

    def _ended(self, message: str) -> TaskStatus:
        """Done early: failed, if it was not cancelled."""
        return TaskStatus(None, self.phase, self._progress(), True, not self._cancelled, self._cancelled, message)

    def _end_early(self, reason: str) -> None:
        if self._status.done or self._ending:
            return
        self._ending = reason
        if self._run is not None:
            self._run.finish = True

    def _next(self, X_W_tip: Array) -> StepRun:
        """The next step, or the lift that ends the task early; X_W_tip (4, 4) is measured."""
        X_tip = inverse_pose(self._X_W) @ X_W_tip  # in the work frame
        start, R_start = X_tip[:3, 3], self._run.R_end if self._run else X_tip[:3, :3]
        if self._run is not None:  # on from the last reference, but from where it is measured where force ruled
            P, last = self._run.force_projector, self._run.position
            start = last - P @ last + P @ start
        axes = self._run.axes if self._run else np.eye(3)
        if self._ending:
            if self._status.setpoint is not None:  # where a turn that is broken off has come to
                R_start = self._X_W[:3, :3].T @ self._status.setpoint.X_W_tip[:3, :3]
            self._index = len(self._steps)
            path = Path([start, start + self.task.lift * axes[:, 2]], _LIFT_SPEED, 0.2)
            lift = Phase(f"lift after {'cancel' if self._cancelled else 'failure'}")
            return StepRun(Step(lift), path, R_start, R_start, self._X_W)
        self._index += 1
        return self._run_of(self._steps[self._index], start, R_start, axes)

    def _run_of(self, step: Step, start: Array, R_start: Array, axes: Array) -> StepRun:
        """The run that a step needs, from start (3,) [m] and R_start (3, 3) of the tip, in the work frame.

        axes: (3, 3) of the surface, as the steps before have found them.
        """
        phase, before = step.phase, self._run
        R_end = R_start if before is not None else self._R_tip
        if phase.tilt is not None:
            self._tilted = self._R_tip @ rotation_from_rpy(np.deg2rad(phase.tilt))
            R_end = axes @ self._tilted if phase.along == "surface" else self._tilted
        if phase.contact_stop is not None:
            return StopRun(step, start, R_start, R_end, self._X_W)
        if phase.along == "surface" and phase.control is not None:
            return SurfaceRun(step, start, R_start, axes, self._tilted, self._X_W)
        if (phase.search is not None or phase.insert is not None) and before is not None:
            if before.R_seen is not None and before.p_seen is not None:
                start, R_start, R_end = before.p_seen, before.R_seen, before.R_seen  # torque has left the reference
            start = start - before.beside  # a tip that landed beside its place searches about that place
        run: StepRun
        if phase.search is not None:
            run = SearchRun(step, start, R_start, R_end, self._X_W, before)
        elif phase.insert is not None:
            plate = before.plate if isinstance(before, SearchRun) else None
            run = InsertRun(step, start, R_start, R_end, self._X_W, plate)
        else:
            if phase.along == "surface":
                to = [tuple((start + axes @ p).tolist()) for p in np.array(step.points).reshape(-1, 3)]
                step = replace(step, points=tuple(to))
            points = [start, *step.points]
            if before is not None and phase.control is not None:
                points[1:1] = _back(start, before.beside, step)
            path = Path(np.array(points), phase.speed, phase.acceleration)
            run = StepRun(step, path, R_start, R_end, self._X_W)
        run.axes = axes
        return run

    def _progress(self) -> float:
        if self._run is None or self._index < 0:
            return 0.0
        i = min(self._index, len(self._steps) - 1)
        share = self._run.share if self._index < len(self._steps) else 0.0
        return float((self._before[i] + share * (self._before[i + 1] - self._before[i])) / self._before[-1])


def _back(start: Array, beside: Array, step: Step) -> list[Array]:
    """Where a path is joined, if at all, by a tip that has landed beside its start [m]."""
    if not step.points or not beside.any():
        return []
    way = np.array(step.points[0]) - (start - beside)
    size = length(way)
    return [start - beside + _JOINS / size * way] if size > _JOINS else []

# SPDX-License-Identifier: Apache-2.0
"""Plays a task: set-points by time and by the controller's state. Cancelled or failed, it leaves the tool lifted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState
from seed_control.tasks.path import Path
from seed_control.tasks.script import Step, steps_of
from seed_control.tasks.step_run import StepRun, expected_time
from seed_control.tasks.task import Phase, Task
from seed_core.spatial import Array, rotation_from_rpy

_LIFT_SPEED = 0.05  # [m/s]


@dataclass(frozen=True)
class TaskStatus:
    """What to send now, and how far the task is.

    Attributes:
        setpoint: for the controller; None when there is nothing (more) to send.
        phase: name of the running phase; 'lift after cancel' and the like while it ends early.
        progress: 0 to 1.
        done: nothing more will come: finished, failed or cancelled, tool lifted where the arm could move.
        failed, cancelled: how it ended, or is ending.
    """

    setpoint: HybridSetpoint | None
    phase: str
    progress: float
    done: bool = False
    failed: bool = False
    cancelled: bool = False
    message: str = ""


class TaskPlayer:
    """One run of one task. Call `step` at the control rate with the controller's newest state."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self._steps = steps_of(task)
        self._X_W = task.frame.pose
        self._R_tip = rotation_from_rpy(np.deg2rad(task.tip_rpy))
        self._index = -1
        self._run: StepRun | None = None
        self._status = TaskStatus(None, "waiting", 0.0)
        self._ending = ""  # why the task ends early
        self._cancelled = False
        self._paused = False
        self._last: float | None = None
        weights = [expected_time(s) for s in self._steps]
        self._before = np.concatenate([[0.0], np.cumsum(weights)])

    @property
    def phase(self) -> str:
        """Name of the running phase."""
        return self._status.phase

    @property
    def phases(self) -> list[str]:
        """Names of all steps in order."""
        return [s.phase.name for s in self._steps]

    def pause(self) -> None:
        """Stand still on the path; forces are kept."""
        self._paused = True

    def resume(self) -> None:
        """Go on from where `pause` stopped."""
        self._paused = False

    def cancel(self, reason: str = "cancelled") -> None:
        """End early: the next steps lift the tool off, then the status is done."""
        self._cancelled = True
        self._end_early(reason)

    def step(self, t: float, state: ControllerState) -> TaskStatus:
        """Status at time t [s], with the set-point to send."""
        if self._status.done:
            return self._status
        dt = 0.0 if self._last is None else max(t - self._last, 0.0)
        self._last = t
        if state.X_W_tip is None or not state.enabled or state.mode == "holding":
            return self._stopped(state)
        if self._run is None:
            self._next(state)
        assert self._run is not None
        ended = self._run.advance(0.0 if self._paused and not self._ending else dt, state)
        if ended == "timeout" and not self._ending:
            phase = self._run.step.phase
            self._end_early(f"phase '{phase.name}' waited {phase.timeout:g} s for '{phase.until}'")
        elif ended:
            self._next(state)
        return self._report()

    def _stopped(self, state: ControllerState) -> TaskStatus:
        """The controller does not move: before the start wait for it, afterwards the task has failed."""
        if self._run is None and not self._ending:
            return self._status
        why = state.reason or "the controller stopped"
        self._status = TaskStatus(
            None,
            self.phase,
            self._progress(),
            True,
            not self._cancelled,
            self._cancelled,
            f"{self._ending + '; ' if self._ending else ''}arm holds: {why}",
        )
        return self._status

    def _end_early(self, reason: str) -> None:
        if self._status.done or self._ending:
            return
        self._ending = reason
        if self._run is not None:
            self._run.finish = True

    def _next(self, state: ControllerState) -> None:
        """Go to the next step, or to the lift that ends the task early, or to the end."""
        lifting = self._index >= len(self._steps)
        if lifting or (not self._ending and self._index + 1 == len(self._steps)):
            ok = not self._ending
            self._status = TaskStatus(
                None,
                "done" if ok else self.phase,
                1.0 if ok else self._progress(),
                True,
                not ok and not self._cancelled,
                self._cancelled,
                self._ending or "finished",
            )
            return
        if self._ending:
            self._index = len(self._steps)
            self._run = self._lift(state)
            return
        self._index += 1
        self._run = self._begin(self._steps[self._index], state)

    def _lift(self, state: ControllerState) -> StepRun:
        start = self._start(state)
        end = start + np.array((0.0, 0.0, self.task.lift))
        path = Path([start, end], _LIFT_SPEED, 0.2)
        R = self._run.R_end if self._run else self._local(state)[:3, :3]
        word = "cancel" if self._cancelled else "failure"
        phase = Phase(f"lift after {word}")
        return StepRun(Step(phase), path, R, R, self._X_W)

    def _begin(self, step: Step, state: ControllerState) -> StepRun:
        phase = step.phase
        start = self._start(state)
        path = Path(np.array([start, *step.points]), phase.speed, phase.acceleration)
        R0 = self._run.R_end if self._run else self._local(state)[:3, :3]
        R1 = R0 if self._run else self._R_tip
        if phase.tilt is not None:
            R1 = self._R_tip @ rotation_from_rpy(np.deg2rad(phase.tilt))
        return StepRun(step, path, R0, R1, self._X_W)

    def _local(self, state: ControllerState) -> Array:
        assert state.X_W_tip is not None
        X = self._X_W
        return np.asarray(np.linalg.inv(X) @ state.X_W_tip)

    def _start(self, state: ControllerState) -> Array:
        """Where the next path begins, in the work frame: on the last reference, but measured where force ruled."""
        measured = self._local(state)[:3, 3]
        if self._run is None:
            return measured
        P = self._run.force_projector
        return np.asarray(self._run.position - P @ self._run.position + P @ measured)

    def _progress(self) -> float:
        if self._run is None or self._index < 0:
            return 0.0
        i = min(self._index, len(self._steps) - 1)
        share = self._run.share if self._index < len(self._steps) else 0.0
        weight = self._before[i + 1] - self._before[i]
        return float((self._before[i] + share * weight) / self._before[-1])

    def _report(self) -> TaskStatus:
        if not self._status.done:
            assert self._run is not None
            word = "paused" if self._paused and not self._ending else self._ending
            self._status = TaskStatus(
                self._run.setpoint(),
                self._run.step.phase.name,
                self._progress(),
                False,
                bool(self._ending) and not self._cancelled,
                self._cancelled,
                word,
            )
        return self._status

# SPDX-License-Identifier: Apache-2.0
"""Plays a task: set-points by time and by the controller's state. Cancelled or failed, it leaves the tool lifted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seed_control.setpoints import HybridSetpoint
from seed_control.state import ControllerState
from seed_control.tasks.path import Path
from seed_control.tasks.script import Step, steps_of
from seed_control.tasks.task import AXES, Control, Phase, Task
from seed_core.spatial import Array, Wrench, make_pose, rotation_from_rpy, so3_exp, so3_log

_TURN_SPEED = 0.3  # [rad/s] of the reference
_LIFT_SPEED = 0.05  # [m/s]
_TYPICAL = 1.5  # [s] that a phase with a condition counts for in the progress


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
        self._run: _Run | None = None
        self._status = TaskStatus(None, "waiting", 0.0)
        self._ending = ""  # why the task ends early
        self._cancelled = False
        self._paused = False
        self._last: float | None = None
        weights = [_expected(s) for s in self._steps]
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

    def _lift(self, state: ControllerState) -> _Run:
        start = self._start(state)
        end = start + np.array((0.0, 0.0, self.task.lift))
        path = Path([start, end], _LIFT_SPEED, 0.2)
        R = self._run.R_end if self._run else self._local(state)[:3, :3]
        word = "cancel" if self._cancelled else "failure"
        phase = Phase(f"lift after {word}")
        return _Run(Step(phase), path, R, R, self._X_W)

    def _begin(self, step: Step, state: ControllerState) -> _Run:
        phase = step.phase
        start = self._start(state)
        path = Path(np.array([start, *step.points]), phase.speed, phase.acceleration)
        R0 = self._run.R_end if self._run else self._local(state)[:3, :3]
        R1 = R0 if self._run else self._R_tip
        if phase.tilt is not None:
            R1 = self._R_tip @ rotation_from_rpy(np.deg2rad(phase.tilt))
        return _Run(step, path, R0, R1, self._X_W)

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


class _Run:
    """One step being played; everything in the work frame until the set-point."""

    def __init__(self, step: Step, path: Path, R_start: Array, R_end: Array, X_W: Array) -> None:
        self.step, self.path, self.R_end, self._X_W = step, path, R_end, X_W
        self._R_start = R_start
        self._turn = so3_log(R_start.T @ R_end)
        angle = float(np.sqrt(self._turn @ self._turn))
        self.duration = max(path.duration, angle / _TURN_SPEED)
        self._t = self._waited = self._held = 0.0
        self.finish = False
        self.share = 0.0
        self.position, self.velocity = path.at(0.0)
        control = step.phase.control
        self.force_projector = _projector(control, self._R_start)
        self._wrench = Wrench(np.array(control.torque), np.array(control.force)) if control else Wrench.zero()
        self._first = self._first_setpoint(control)

    def advance(self, dt: float, state: ControllerState) -> str:
        """Go on by dt [s]; 'done', 'timeout' or '' while it runs."""
        phase = self.step.phase
        self._t += dt
        self.position, self.velocity = self.path.at(self._t) if dt > 0.0 else (self.position, np.zeros(3))
        self.share = min(self._t / max(self.duration, _TYPICAL if phase.until != "arrived" else 1e-9), 1.0)
        if self.finish:
            return "done"
        if self._t < self.duration:
            return ""
        self._waited += dt
        met = {"arrived": True, "contact": state.in_contact, "settled": state.settled}[phase.until]
        self._held = self._held + dt if met else 0.0
        if met and self._held >= phase.dwell:
            return "done"
        return "timeout" if self._waited > phase.timeout + phase.dwell else ""

    def setpoint(self) -> HybridSetpoint:
        """The set-point of this moment."""
        share = min(self._t / self.duration, 1.0) if self.duration > 0.0 else 1.0
        R = self.R_end if share >= 1.0 else self._R_start @ so3_exp(share * self._turn)
        X_W_tip = self._X_W @ make_pose(R, self.position)
        return self._first.moved(X_W_tip, self._X_W[:3, :3] @ self.velocity)

    def _first_setpoint(self, control: Control | None) -> HybridSetpoint:
        X_W_tip = self._X_W @ make_pose(self._R_start, self.position)
        if control is None:
            return HybridSetpoint(X_W_tip)
        return HybridSetpoint(
            X_W_tip=X_W_tip,
            wrench=self._wrench,
            force_projector=_projector(control, None),
            torque_axes=control.flags(control.torque_axes),
            contact_resists=control.flags(control.contact_resists),
            task_frame="tool" if control.frame == "tool" else "surface",
            R_W_task=self._X_W[:3, :3],
            approach_speed=control.approach_speed,
        )


def _projector(control: Control | None, R_tip: Array | None) -> Array:
    """Force directions as a projector in the control's frame; in the work frame when R_tip (3, 3) is given."""
    P = np.zeros((3, 3))
    for axis in control.force_directions if control else ():
        n = np.array(AXES[axis])
        if control is not None and control.frame == "tool" and R_tip is not None:
            n = R_tip @ n
        P += np.outer(n, n)
    return P


def _expected(step: Step) -> float:
    points = np.array(step.points).reshape(-1, 3)
    length = float(np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)).sum()) if len(points) > 1 else 0.1
    waiting = _TYPICAL if step.phase.until != "arrived" else 0.0
    return waiting + step.phase.dwell + (length / step.phase.speed if len(points) else 0.0)

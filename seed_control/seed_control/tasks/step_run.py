# SPDX-License-Identifier: Apache-2.0
"""One step of a task being played: where on its path it is, what it asks of the controller, and when it is over."""

from __future__ import annotations

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState
from seed_control.tasks.path import Path
from seed_control.tasks.script import Step
from seed_control.tasks.task import AXES, Control
from seed_core.spatial import Array, Wrench, make_pose, so3_exp, so3_log

_TURN_SPEED = 0.3  # [rad/s] of the reference
_TYPICAL = 1.5  # [s] that a phase with a condition counts for in the progress


class StepRun:
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


def expected_time(step: Step) -> float:
    """How long the step will take [s], for the progress."""
    points = np.array(step.points).reshape(-1, 3)
    length = float(np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)).sum()) if len(points) > 1 else 0.1
    waiting = _TYPICAL if step.phase.until != "arrived" else 0.0
    return waiting + step.phase.dwell + (length / step.phase.speed if len(points) else 0.0)

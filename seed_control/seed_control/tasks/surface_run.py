# SPDX-License-Identifier: Apache-2.0
"""A step whose path, force and attitude go along the surface, which is found while the tool moves over it."""

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState
from seed_control.tasks.path import Path
from seed_control.tasks.steps import Step, StepRun, TipImages, first_setpoint
from seed_core.spatial import Array, length, make_pose, so3_exp, so3_log

_TURN_SPEED = 0.45  # [rad/s] at which the tool's attitude follows the normal, at most
_FOLLOWING = 1.2  # [rad/s] how fast it settles, without a lag where the normal turns evenly

_UPRIGHT, _LEANING = np.deg2rad((12.0, 30.0))  # up to where it goes at full pace, and from where on it waits


class SurfaceRun(StepRun):
    """The reference goes in the tangent plane, and is set back onto the surface where it leaves it.

    Its axes are carried along the surface: they turn with the normal and not about it, so a path is as straight as the
    surface lets it be. Where the normal turns faster than the tool can, the path slows down: a tool that leans far does
    not touch with its tip.
    """

    def __init__(self, step: Step, start: Array, R_start: Array, axes: Array, R_tip: Array, X_W: Array) -> None:
        """From start (3,) [m] on, with the tip at R_start (3, 3), in the work frame at X_W (4, 4).

        Args:
            axes: (3, 3) of the surface, as far as it is known. R_tip: (3, 3) wanted of the tip in these.
        """
        phase = step.phase
        points = [(0.0, 0.0, 0.0), *([phase.to] if phase.to else [])]
        super().__init__(step, Path(points, phase.speed, phase.acceleration), R_start, R_start, X_W)
        self.axes, self._R_tip = axes, R_tip
        self.position, self._gone = start.copy(), np.zeros(3)
        self._images = TipImages(X_W)  # beside those of the path
        self._since, self._turning = 0.0, np.zeros(3)  # [s], [rad/s] in the work frame
        self._first = first_setpoint(phase.control, X_W, make_pose(R_start, start), "found")

    def _go(self, dt: float, state: ControllerState) -> None:
        self._since += dt
        if (X := self._images.new(state)) is not None:
            self._look(X[:3, 3], state)
        gone, velocity = self.path.at(self._t)
        self.position = self.position + self.axes @ (gone - self._gone)
        self._gone, self.velocity = gone, self.pace * (self.axes @ velocity) if dt > 0.0 else np.zeros(3)

    def _look(self, tip: Array, state: ControllerState) -> None:
        """What a new image says of the surface: its normal, and where the tip (3,) is on it."""
        if state.in_contact:
            n = self._images.to_work[:3, :3] @ state.R_W_task[:, 2]
            self.axes = carried(self.axes, n)
            self.force_projector = np.outer(n, n)
            self.position = self.position + float(n @ (tip - self.position)) * n
        dt, self._since = min(self._since, 0.1), 0.0
        left = so3_log(self.axes @ self._R_tip @ self.R_end.T)
        lean = length(left)
        self.pace = min(max((_LEANING - lean) / (_LEANING - _UPRIGHT), 0.0), 1.0)
        self._turning = capped(self._turning + _FOLLOWING**2 * dt * left, _TURN_SPEED)
        self.R_end = so3_exp(dt * capped(self._turning + 2.0 * _FOLLOWING * left, _TURN_SPEED)) @ self.R_end

    def setpoint(self) -> HybridSetpoint:
        R_W = self._X_W[:3, :3]
        X_W_tip = self._X_W @ make_pose(self.R_end, self.position)
        return self._pressing().moved(X_W_tip, R_W @ self.velocity, R_W @ self.axes)


def capped(v: Array, longest: float) -> Array:
    """v (3,), made shorter where it is longer."""
    return v * min(longest / max(length(v), 1e-12), 1.0)


def carried(axes: Array, n: Array) -> Array:
    """The axes (3, 3) turned so that z is n (3,), and not about it."""
    turn = np.cross(axes[:, 2], n)
    sine, cosine = length(turn), float(axes[:, 2] @ n)
    if sine < 1e-12:
        return axes
    return np.asarray(so3_exp(turn * (np.arctan2(sine, cosine) / sine)) @ axes)

# SPDX-License-Identifier: Apache-2.0
"""Pushing in: compliance about the tip by the law, depth and wrench watched here, jams and wedges answered."""

from dataclasses import replace

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState
from seed_control.tasks.insertion.sections import Insert
from seed_control.tasks.insertion.stuck import Push, StuckWatch
from seed_control.tasks.path import Path
from seed_control.tasks.steps import Ending, Step, StepRun
from seed_core.spatial import Array, length, make_pose, so3_exp, so3_log

_SHARE = 0.35  # of an image in the pose that the next try starts from
_ANCHOR = 0.15  # [s] after which the reference is put where the tip is: force control has left it
_GIVE, _GIVE_TURN = 5e-4, 0.1  # [m/N], [rad/(N m)] by which the reference gives way at each anchor
_BACK_SPEED = 0.01  # [m/s]
_MOUTH = 1.5e-3  # [m] of depth below which it is not in the hole: what was found was something else
_BEYOND = 5e-3  # [m] more than the depth: what is below is no hole of this kind


class InsertRun(StepRun):
    """An insertion being played: pushing, and backing off in between."""

    def __init__(self, step: Step, start: Array, R_start: Array, R_end: Array, X_W: Array, plate: float | None) -> None:
        """As a `StepRun`, from the tip's place `start` (3,) in the work frame.

        plate: height [m] of the hole's mouth in the work frame; None: where the tip is.
        """
        insert, control = step.phase.insert, step.phase.control
        assert insert is not None
        assert control is not None
        super().__init__(step, Path([start], step.phase.speed, step.phase.acceleration), R_start, R_end, X_W)
        self._insert: Insert = insert
        force = np.array(control.force)
        R_force = R_start if control.frame == "tool" else np.eye(3)
        self._axis: Array = R_force @ force / np.sqrt(force @ force)  # in the work frame, into the hole
        self._mouth = (
            float(self._axis @ start) if plate is None else float(self._axis[2] * plate + self._axis[:2] @ start[:2])
        )
        self._keyed = len(control.torque_axes) == 3
        self._watch = StuckWatch(length(force), insert.stuck)
        self._place, self._R = start.copy(), R_start  # smoothed
        self._pushing = self._current = replace(self._first, touches=True)  # a slack peg touches as well
        self._anchored = 0.0
        self._retreat: Path | None = None
        self._since = 0.0  # [s] of the retreat
        self._push: Push | None = None  # the newest
        self._tries = 0
        self._told = ""
        self.force_projector = np.zeros((3, 3))  # `position` is where the tip is, over some images

    @property
    def depth(self) -> float:
        """[m] of the tip below the mouth, smoothed."""
        return float(self._axis @ self._place) - self._mouth

    def advance(self, dt: float, state: ControllerState) -> Ending:
        self._t += dt
        if self.finish:
            return "done"
        push = self._new_push(state)
        self._push = push or self._push
        self.share = min(max(self.depth / self._insert.depth, 0.0), 1.0)
        if self.depth > self._insert.depth + _BEYOND:
            return self._fail(
                f"the tip went {1e3 * self.depth:.1f} mm deep, {1e3 * self._insert.depth:g} mm are wanted"
            )
        if self._t > self.step.phase.timeout:
            return self._fail(
                f"{1e3 * self.depth:.1f} of {1e3 * self._insert.depth:g} mm within {self.step.phase.timeout:g} s"
            )
        if self._retreat is not None:
            self._back(dt)
            return ""
        if self.depth > self._insert.depth - self._insert.tolerance:
            return "done"
        if push is not None and self._watch.update(push):
            return self._answer()
        if self._t - self._anchored > _ANCHOR:
            self._anchor()
        return ""

    def setpoint(self) -> HybridSetpoint:
        return self._current

    def _new_push(self, state: ControllerState) -> Push | None:
        """What a new image tells; None without one."""
        if state.filtered is None or (X := self._tips.new(state)) is None:
            return None
        self._place = self._place + _SHARE * (X[:3, 3] - self._place)
        self._R = self._R @ so3_exp(_SHARE * so3_log(self._R.T @ X[:3, :3]))
        self.position = self._place
        to_work = self._tips.to_work[:3, :3] @ state.R_W_task
        force, moment = to_work @ state.filtered.force, to_work @ state.filtered.torque
        axial = float(self._axis @ force)
        across = np.eye(3) - np.outer(self._axis, self._axis)
        about = np.eye(3) if self._keyed else across  # friction alone turns a round peg
        return Push(self._t, self.depth, axial, across @ force, about @ moment)

    def _anchor(self) -> None:
        """The reference goes to where the tip is, and on away from what it presses sideways.

        While too little force is felt to count as contact, the law holds place and angle: so they give way as well.
        """
        self._anchored = self._t
        if self._push is not None:
            self.R_end = so3_exp(-_GIVE_TURN * self._push.moment) @ self._R
            self._current = self._at(self._place - _GIVE * self._push.lateral)

    def _at(self, place: Array) -> HybridSetpoint:
        """Pushing, with the reference at a place (3,) in the work frame."""
        return self._pushing.moved(self._X_W @ make_pose(self.R_end, place), np.zeros(3))

    def _answer(self) -> Ending:
        """Stuck: back off, mend what the wrench complains of, try again."""
        i, watch = self._insert, self._watch
        self._told = (
            f"{watch.kind} at {1e3 * self.depth:.1f} of {1e3 * i.depth:g} mm, lateral over axial force "
            f"{watch.ratio:.2f}, moment over axial force {1e3 * watch.lever:.1f} mm"
        )
        self._tries += 1
        if self.depth < _MOUTH:
            self.why = f"phase '{self.step.phase.name}': no way in: {self._told}: check hole, part and work frame"
            return "again"
        if self._tries > i.tries:
            return self._fail(f"stuck after {i.tries} tries: {self._told}")
        turn = np.zeros(3)
        if watch.kind == "jam":  # the tool presses its moment on the hole: turned back, it presses less
            size = length(watch.moment)
            turn = -np.deg2rad(i.correction) * watch.moment / size if size else turn
        else:
            turn = np.deg2rad(i.turn) * (1.0 if self._tries % 2 else -1.0) * self._axis
        back = i.back_off * (0.5 if watch.kind == "jam" else 1.0)
        self.R_end = self._R = so3_exp(turn) @ self._R
        self._retreat, self._since = Path([self._place, self._place - back * self._axis], _BACK_SPEED, 0.2), 0.0
        return ""

    def _back(self, dt: float) -> None:
        """Backing off, by position."""
        assert self._retreat is not None
        self._since += dt
        place, velocity = self._retreat.at(self._since)
        R = self._X_W[:3, :3]
        self._current = HybridSetpoint(self._X_W @ make_pose(self.R_end, place), velocity=R @ velocity)
        if self._since > self._retreat.duration + 0.3:
            self._retreat = None
            self._watch.restart()
            self._anchored = self._t
            self._current = self._at(place)

    def _fail(self, why: str) -> Ending:
        self.why = f"phase '{self.step.phase.name}': {why}: check hole, part and work frame"
        return "failed"

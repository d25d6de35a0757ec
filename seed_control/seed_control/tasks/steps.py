# SPDX-License-Identifier: Apache-2.0
"""A task as a list of steps, and one step being played: its place on the path, its set-point, and when it is over."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint, TaskFrame
from seed_control.state import ControllerState
from seed_control.tasks.font import strokes_of_text
from seed_control.tasks.landing import Landing
from seed_control.tasks.pace import Pace
from seed_control.tasks.path import Path
from seed_control.tasks.task import Control, Drawing, Phase, Task
from seed_core.spatial import Array, Wrench, inverse_pose, length, make_pose, so3_exp, so3_log
from seed_core.vector3 import Vector3

# How a step has ended; '' while it runs. 'again': an insertion found no way in, so that the search is to be repeated.
Ending = Literal["", "done", "timeout", "failed", "again"]
_TURN_SPEED = 0.3  # [rad/s] of the reference
_SEEN = 0.1  # of an image in the rotation that is seen
_TYPICAL = 1.5  # [s] that a phase with a condition counts for in the progress
_LEAST = 0.1  # [s] that any phase counts for
_FORCE_STEP = 1e-3  # share of the force by which it changes at least: each change is judged anew
_NEARER = 5e-4  # [m] by which an approach gets on; less may be noise


@dataclass(frozen=True)
class Step:
    """A phase with the points of its path in the work frame, each (x, y, z) [m]; empty: stay."""

    phase: Phase
    points: tuple[Vector3, ...] = ()

    @property
    def expected_time(self) -> float:
        """How long it will take [s], for the progress."""
        points, phase = np.array(self.points).reshape(-1, 3), self.phase
        way = float(np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)).sum()) if len(points) > 1 else 0.1
        waiting = _TYPICAL if phase.until != "arrived" else 0.0
        return max(waiting + phase.dwell + (way / phase.speed if len(points) else 0.0), _LEAST)


def steps_of(task: Task) -> list[Step]:
    """All steps of the task in order: phases as they stand, a drawing's strokes before the last one."""
    steps = [Step(p, (*p.through, p.to) if p.to else ()) for p in task.phases]
    return steps if task.draw is None else [*steps[:-1], *_drawing(task.draw), steps[-1]]


def _drawing(drawing: Drawing) -> list[Step]:
    ox, oy = drawing.origin
    strokes = [[(x + ox, y + oy) for x, y in s] for s in drawing.strokes]  # in the work frame
    if drawing.text:
        strokes = strokes_of_text(drawing.text, drawing.height, drawing.origin, drawing.font)
    forces = drawing.forces or (None,) * len(strokes)
    up, travel = drawing.clearance, drawing.travel_speed
    out: list[Step] = []
    for number, (stroke, force) in enumerate(zip(strokes, forces, strict=True), start=1):
        control = drawing.control.scaled_to(force) if force else drawing.control
        name = f"stroke {number}/{len(strokes)}"
        over, raised = (*stroke[0], up), (*stroke[-1], up)
        line: tuple[Vector3, ...] = tuple((x, y, 0.0) for x, y in stroke)
        out += [
            Step(Phase(f"{name} over", over, speed=travel), (over,)),
            Step(Phase(f"{name} touch", control=control.at_start(), until="settled", dwell=0.15)),
            Step(Phase(f"{name} draw", line[-1], speed=drawing.speed, control=control), line),
            Step(Phase(f"{name} raise", raised, speed=travel), (raised,)),
        ]
    return out


class TipImages:
    """The measured tip in the work frame, image by image.

    Attributes:
        to_work: (4, 4) pose of W in the work frame.
    """

    def __init__(self, X_W: Array) -> None:
        """X_W: (4, 4) pose of the work frame."""
        self.to_work = inverse_pose(X_W)
        self._newest: Array | None = None

    def new(self, state: ControllerState) -> Array | None:
        """The tip (4, 4) in an image that was not seen here before; None without one."""
        if state.X_W_tip is None or state.X_W_tip is self._newest:
            return None
        self._newest = state.X_W_tip
        return np.asarray(self.to_work @ state.X_W_tip)


class StepRun:
    """One step being played; everything in the work frame until the set-point.

    Attributes:
        position: (3,) [m], velocity: (3,) [m/s] of the reference.
        force_projector: (3, 3) onto the force directions at the start.
        share: of the step, 0 to 1.
        pace: at which it goes along its path, as a share of what was asked for.
        finish: set to end it at once.
        why: it failed.
        R_seen, p_seen: (3, 3), (3,) [m] of the tip where torque rules, smoothed over the images; None elsewhere.
        axes: (3, 3) of the surface, z out of it, as a step along it has found them.
    """

    axes = np.eye(3)

    def __init__(self, step: Step, path: Path, R_start: Array, R_end: Array, X_W: Array) -> None:
        """From R_start (3, 3) to R_end of the tip, in the work frame at X_W (4, 4)."""
        self.step, self.path, self.R_end, self._X_W = step, path, R_end, X_W
        self._R_start, self._turn = R_start, so3_log(R_start.T @ R_end)
        angle = length(self._turn)
        self.duration = max(path.duration, angle / _TURN_SPEED)
        self._t = self._waited = self._held = self.share = 0.0
        self.pace, self._pace = 1.0, Pace(step.phase.acceleration / step.phase.speed)
        self.finish, self.why = False, ""
        self.R_seen: Array | None = None
        self.p_seen: Array | None = None
        self._tips = TipImages(X_W)
        self.position, self.velocity = path.at(0.0)
        self._first = first_setpoint(step.phase.control, X_W, make_pose(R_start, self.position))
        self._force_share = 1.0  # of the phase's force, that `_first` asks for
        P = self._first.force_projector
        self.force_projector = R_start @ P @ R_start.T if self._first.task_frame == "tool" else P
        p, landing = step.phase, Landing(self.position, self.force_projector)
        presses = p.control is not None and p.along == "work" and not (p.search or p.insert or p.contact_stop)
        self._landing = landing if presses and landing.stands(np.array(step.points).reshape(-1, 3)) else None
        force = self._first.wrench.force
        force = X_W[:3, :3] @ (R_start @ force if self._first.task_frame == "tool" else force)
        self._towards = force / max(length(force), 1e-12)
        self._nearest = -np.inf  # [m] along it, of the tip in an approach

    @property
    def beside(self) -> Array:
        """By how much (3,) [m] the tip landed beside its place, and so the reference."""
        return self._landing.beside if self._landing is not None else np.zeros(3)

    def advance(self, dt: float, state: ControllerState) -> Ending:
        """Go on by dt [s]; how it has ended, if it has."""
        phase = self.step.phase
        self._t += dt * self.pace
        if self._landing is not None:
            self._landing.step(dt, state.in_contact)
        if (X := self._tips.new(state)) is not None:
            if self._landing is not None:
                self._landing.image(X[:3, 3], state.in_contact)
            if phase.control is not None and phase.control.torque_axes:
                self._see(X)
        self._go(dt, state)
        self.share = min(self._t / max(self.duration, _TYPICAL if phase.until != "arrived" else 1e-9), 1.0)
        if self.finish:
            return "done"
        if self._t < self.duration:
            return ""
        self._waited = 0.0 if self._gets_nearer(state) else self._waited + dt
        met = {"arrived": True, "contact": state.in_contact, "settled": state.settled}[phase.until]
        self._held = self._held + dt if met else 0.0
        if met and self._held >= phase.dwell:
            return "done"
        return "timeout" if self._waited > phase.timeout + phase.dwell else ""

    def _gets_nearer(self, state: ControllerState) -> bool:
        """Whether an approach, slow for a small force in a stiff grasp, still gets on; `max_free_travel` bounds it."""
        if state.mode != "approach" or state.X_W_tip is None:
            return False
        way = float(self._towards @ state.X_W_tip[:3, 3])
        if way < self._nearest + _NEARER:
            return False
        self._nearest = way
        return True

    def _see(self, X: Array) -> None:
        """Take in the tip of a new image (4, 4), in the work frame."""
        R, p = X[:3, :3], X[:3, 3]
        if self.R_seen is None or self.p_seen is None:
            self.R_seen, self.p_seen = R, p
        self.R_seen = self.R_seen @ so3_exp(_SEEN * so3_log(self.R_seen.T @ R))
        self.p_seen = self.p_seen + _SEEN * (p - self.p_seen)

    def _go(self, dt: float, state: ControllerState) -> None:
        """Move the reference on by dt [s]."""
        if dt == 0.0:
            self.velocity = np.zeros(3)
            return
        if self.step.phase.control is not None and self.step.phase.search is None:  # a search may lean as it likes
            self.pace = self._pace.update(dt, state)
        place, velocity = self.path.at(self._t)
        self.position = place + self.beside
        self.velocity = self.pace * velocity

    def _pressing(self) -> HybridSetpoint:
        """The first set-point, with the force of this place of the path."""
        control = self.step.phase.control
        if control is not None and control.profile:
            share = control.share_at(self.path.share(self._t))
            if abs(share - self._force_share) > _FORCE_STEP:
                self._first = self._first.with_force_times(share / self._force_share)
                self._force_share = share
        return self._first

    def setpoint(self) -> HybridSetpoint:
        """The set-point of this moment."""
        share = min(self._t / self.duration, 1.0) if self.duration > 0.0 else 1.0
        R = self.R_end if share >= 1.0 else self._R_start @ so3_exp(share * self._turn)
        X_W_tip = self._X_W @ make_pose(R, self.position)
        return self._pressing().moved(X_W_tip, self._X_W[:3, :3] @ self.velocity)


def first_setpoint(control: Control | None, X_W: Array, X_tip: Array, frame: TaskFrame = "surface") -> HybridSetpoint:
    """Where a step begins: tip at X_tip (4, 4) in the work frame at X_W (4, 4); frame: of what is not the tool's."""
    X_W_tip = X_W @ X_tip
    if control is None:
        return HybridSetpoint(X_W_tip)
    return HybridSetpoint(
        X_W_tip=X_W_tip,
        wrench=Wrench(np.array(control.torque), np.array(control.force)),
        force_projector=np.diag(np.array(control.flags(control.force_directions), dtype=float)),
        torque_axes=control.flags(control.torque_axes),
        contact_resists=control.flags(control.contact_resists),
        task_frame="tool" if control.frame == "tool" else frame,
        R_W_task=X_W[:3, :3],
        approach_speed=control.approach_speed,
        press_speed=control.press_speed,
    )

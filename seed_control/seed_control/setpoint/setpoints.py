# SPDX-License-Identifier: Apache-2.0
"""What a user asks of the controller. Each set-point checks itself; a refusal carries a number, SP01 to SP08.

Every wrench here is what the tool does to the environment, about the tip: pressing a table with 10 N is the force
(0, 0, -10) in the world's axes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np

from seed_core.errors import SeedError
from seed_core.spatial import Array, SpatialError, Wrench, check_pose

TaskFrame = Literal["world", "tool", "surface", "found"]
TASK_FRAMES = ("world", "tool", "surface", "found")
AxisFlags = tuple[bool, bool, bool]  # which of x, y, z
NO_AXES: AxisFlags = (False, False, False)
_PROJECTOR_TOLERANCE = 1e-6
_FASTEST = 0.5  # [m/s] of a set-point along its path
_FORCE_TOLERANCE = 1e-6  # [N]


class SetpointError(SeedError):
    """A set-point that cannot be followed. `code` is the number of the refusal, such as 'SP03'."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(f"{code}: {message}")
        self.code = code


@dataclass(frozen=True, eq=False)
class WrenchSetpoint:
    """Algorithm 2, not hybrid: all six components of the wrench of the tool on the environment, about the tip.

    Attributes:
        wrench: torque [N m] and force [N], written in `frame`.
        frame: 'world', or 'tool' (the axes of the tip frame).
        contact_resists: about which of T's axes the contact resists rotation. A torque needs all three (Algorithm 2
            keeps turning a tool that nothing holds); with none of them the orientation is held and the torque is
            what the contact makes of it.
        stamp: when it was sent [s], or None.
    """

    kind: ClassVar = "wrench"
    wrench: Wrench
    frame: TaskFrame = "world"
    contact_resists: AxisFlags = NO_AXES
    stamp: float | None = None

    def __post_init__(self) -> None:
        _check_frame(self.frame, ("world", "tool"))
        object.__setattr__(self, "wrench", _checked_wrench(self.wrench))


@dataclass(frozen=True, eq=False)
class RelativePoseSetpoint:
    """The displacement of the grasp itself: pose X_TC (4, 4) of the gripper's frame C in the tool's frame T."""

    kind: ClassVar = "relative_pose"
    X_TC: Array
    stamp: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "X_TC", _checked_pose(self.X_TC, "X_TC"))


@dataclass(frozen=True, eq=False)
class HybridSetpoint:
    """Force along some directions, torque about some axes, position and angle for the rest.

    Attributes:
        X_W_tip: (4, 4) wanted pose of the tool's tip frame in the world; what is not force or torque follows it.
        wrench: wanted torque [N m] and force [N] about the tip, in the task frame.
        force_projector: (3, 3) = I - S in the task frame, onto the force-controlled directions. Zeros: all position.
        torque_axes: which of T's axes x, y, z are torque-controlled (Assumption 3); the others hold their angle.
        task_frame: 'world', 'tool' (moves with the tool's tip frame), 'surface' (R_W_task, new with each set-point) or
            'found' (z along the surface's normal as it is found in contact, x as near to R_W_task's as can be; its z is
            what is expected before).
        R_W_task: (3, 3) axes of the task frame in the world; identity for 'world', ignored for 'tool'.
        contact_resists: about which of T's axes the contact resists rotation (a line, a face, a hole).
        velocity: (3,) [m/s] of the wanted tip position in the world; lets the law lead the servo's lag.
        approach_speed: [m/s] at which to walk towards contact; None means the controller's default.
        press_speed: [m/s] at most, building up the force in contact; None means the controller's default.
        touches: the tool is known to touch, however little it presses: contact is not looked for.
        stamp: when it was sent [s], or None.
    """

    kind: ClassVar = "hybrid"
    X_W_tip: Array
    wrench: Wrench = field(default_factory=Wrench.zero)
    force_projector: Array = field(default_factory=lambda: np.zeros((3, 3)))
    torque_axes: AxisFlags = NO_AXES
    task_frame: TaskFrame = "world"
    R_W_task: Array = field(default_factory=lambda: np.eye(3))
    contact_resists: AxisFlags = NO_AXES
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    approach_speed: float | None = None
    press_speed: float | None = None
    touches: bool = False
    stamp: float | None = None

    def __post_init__(self) -> None:
        _check_frame(self.task_frame, TASK_FRAMES)
        put = object.__setattr__
        put(self, "wrench", _checked_wrench(self.wrench))
        put(self, "force_projector", _checked_projector(self.force_projector))
        put(self, "R_W_task", _checked_rotation(self.R_W_task, self.task_frame))
        self._put_place(self.X_W_tip, self.velocity)
        self._check_selection()

    def moved(self, X_W_tip: Array, velocity: Array, R_W_task: Array | None = None) -> HybridSetpoint:
        """The same set-point at another place: cheap, for paths; everything but the arguments is shared."""
        out = object.__new__(HybridSetpoint)
        vars(out).update(vars(self))
        if R_W_task is not None:
            object.__setattr__(out, "R_W_task", _checked_rotation(R_W_task, self.task_frame))
        out._put_place(X_W_tip, velocity)
        return out

    def with_force_times(self, times: float) -> HybridSetpoint:
        """The same set-point with its force so many times as large."""
        out = object.__new__(HybridSetpoint)
        vars(out).update(vars(self))
        wrench = Wrench(self.wrench.torque, times * self.wrench.force)
        object.__setattr__(out, "wrench", _checked_wrench(wrench))
        return out

    def differs_in_place_only(self, other: HybridSetpoint | None) -> bool:
        """Whether the other asks for the same load and rotation, so that neither need be judged again.

        One that was moved from the other may have other axes R_W_task.
        """
        if other is None or not np.array_equal(self.X_W_tip[:3, :3], other.X_W_tip[:3, :3]):
            return False
        if self.wrench is other.wrench:  # each set-point has a copy of its own: one was moved from the other
            return True
        return (
            (self.task_frame, self.torque_axes, self.approach_speed, self.press_speed, self.touches)
            == (other.task_frame, other.torque_axes, other.approach_speed, other.press_speed, other.touches)
            and np.array_equal(self.wrench, other.wrench)
            and np.array_equal(self.force_projector, other.force_projector)
            and np.array_equal(self.R_W_task, other.R_W_task)
        )

    def _put_place(self, X_W_tip: Array, velocity: Array) -> None:
        object.__setattr__(self, "X_W_tip", _checked_pose(X_W_tip, "X_W_tip"))
        checked = _checked_vector(velocity, "velocity", "m/s")
        object.__setattr__(self, "velocity", checked)
        if float(checked @ checked) > _FASTEST**2:
            speed = float(np.linalg.norm(checked))
            raise SetpointError("SP08", f"velocity = {speed:.3g} m/s must be at most {_FASTEST:g}: is it in m/s?")

    def _check_selection(self) -> None:
        stray = self.wrench.force - self.force_projector @ self.wrench.force
        if np.abs(stray).max() > _FORCE_TOLERANCE:
            raise SetpointError(
                "SP06",
                f"force {np.round(self.wrench.force, 3)} N has a part {np.round(stray, 3)} N along position-controlled "
                "directions; a direction carries force or position, not both: widen force_projector or drop that part",
            )
        for name, on, resists in zip("xyz", self.torque_axes, self.contact_resists, strict=True):
            if on and not resists:
                raise SetpointError(
                    "SP07",
                    f"torque about T's {name} without a contact that resists rotation about it: the tool would keep "
                    f"turning; set contact_resists[{'xyz'.index(name)}] if a line, face or hole holds it, or "
                    "hold the angle",
                )
        for name, speed in (("approach_speed", self.approach_speed), ("press_speed", self.press_speed)):
            if speed is not None and not 0.0 < speed <= 0.25:
                raise SetpointError("SP08", f"{name} = {speed} m/s must be above 0 and at most 0.25")


Setpoint = WrenchSetpoint | RelativePoseSetpoint | HybridSetpoint


def _check_frame(frame: str, known: tuple[str, ...]) -> None:
    if frame not in known:
        raise SetpointError("SP01", f"task frame '{frame}' is unknown; known: {', '.join(known)}")


def _frozen(values: Array) -> Array:
    values.setflags(write=False)
    return values


def _checked_vector(value: Array, name: str, unit: str) -> Array:
    out = np.array(value, dtype=float)
    if out.shape != (3,):
        raise SetpointError("SP02", f"{name} has shape {out.shape}; it needs (3,) [{unit}]")
    if not np.isfinite(out).all():
        raise SetpointError("SP03", f"{name} = {out} {unit} must be finite")
    return _frozen(out)


def _checked_wrench(wrench: Wrench) -> Wrench:
    torque = _checked_vector(wrench.torque, "wrench.torque", "N m")
    return Wrench(torque, _checked_vector(wrench.force, "wrench.force", "N"))


def _checked_pose(X: Array, name: str) -> Array:
    try:
        return _frozen(check_pose(X, name).copy())
    except SpatialError as error:
        raise SetpointError("SP04", str(error)) from error


def _checked_projector(P: Array) -> Array:
    out = np.array(P, dtype=float)
    if out.shape != (3, 3) or not np.isfinite(out).all():
        raise SetpointError("SP05", "force_projector must be a finite (3, 3) matrix")
    off = max(np.abs(out - out.T).max(), np.abs(out @ out - out).max())
    if off > _PROJECTOR_TOLERANCE:
        raise SetpointError(
            "SP05",
            f"force_projector is no projector: it differs from its transpose or its square by {off:.2g}, at most "
            f"{_PROJECTOR_TOLERANCE:g} is allowed; build it as the sum of n n^T over unit force directions",
        )
    return _frozen(out)


def _checked_rotation(R: Array, frame: str) -> Array:
    X = np.eye(4)
    out = np.array(R, dtype=float)
    if out.shape != (3, 3):
        raise SetpointError("SP02", f"R_W_task has shape {out.shape}; it needs (3, 3)")
    X[:3, :3] = out
    _checked_pose(X, "R_W_task")
    if frame == "world" and np.abs(out - np.eye(3)).max() > _PROJECTOR_TOLERANCE:
        raise SetpointError(
            "SP01", "task_frame 'world' has the axes of the world; use 'surface' or 'found' to give R_W_task"
        )
    return _frozen(out)

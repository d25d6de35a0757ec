# SPDX-License-Identifier: Apache-2.0
"""The task file: what it may contain, with units; errors name file and line. docs/tasks.md describes the format."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from seed_control.tasks.font import check_text
from seed_control.tasks.insertion.sections import Insert, Search
from seed_core.config import ConfigError, field
from seed_core.errors import SeedError
from seed_core.spatial import Array, pose_from_rpy
from seed_core.vector3 import ZERO, Vector3

Shares = tuple[float, ...]
SHARES = 0.1, 10.0  # of a force, at least and at most, along a path
WAYS = ("x", "-x", "y", "-y", "z", "-z")
CONDITIONS = ("arrived", "contact", "settled")
_LEAST_TOUCH, _MOST_TOUCH = 0.5, 20.0  # [N] of a contact_stop


class TaskError(SeedError):
    """A task that cannot be found or played."""


@dataclass(frozen=True)
class WorkFrame:
    """Where the task's work lies in the world: origin on the nominal surface, z out of it."""

    position: Vector3 = field(ZERO, unit="m", quantity=True, low=-3, high=3, doc="origin in the world")
    rpy: Vector3 = field(ZERO, unit="deg", quantity=True, low=-360, high=360, doc="fixed-axis roll, pitch, yaw")

    @property
    def pose(self) -> Array:
        """X (4, 4) of the work frame in the world."""
        return pose_from_rpy(np.deg2rad(self.rpy), self.position)


@dataclass(frozen=True)
class Control:
    """Which directions carry force and which axes torque; the rest follow the path."""

    force: Vector3 = field(
        unit="N", quantity=True, low=-200, high=200, doc="of the tool on the environment, work frame"
    )
    profile: Shares = field(
        (), low=SHARES[0], high=SHARES[1], doc="shares of the force at two or more places, evenly apart along the path"
    )
    torque: Vector3 = field(ZERO, unit="N m", quantity=True, low=-20, high=20, doc="about the tip, work frame")
    force_directions: tuple[str, ...] = field(("z",), doc="axes of the work frame (or of the tool) that carry force")
    torque_axes: tuple[str, ...] = field((), doc="axes of T that carry torque")
    contact_resists: tuple[str, ...] = field((), doc="axes of T about which the contact resists rotation")
    frame: str = field("work", choices=("work", "tool"), doc="axes of force, torque and force_directions")
    approach_speed: float | None = field(None, unit="m/s", quantity=True, low=1e-3, high=0.1, doc="towards contact")
    press_speed: float | None = field(None, unit="m/s", quantity=True, low=1e-3, high=0.25, doc="in contact, at most")

    def __post_init__(self) -> None:
        for name in ("force_directions", "torque_axes", "contact_resists"):
            for axis in getattr(self, name):
                if axis not in ("x", "y", "z"):
                    raise ConfigError(f"{name} has '{axis}'; known: x, y, z")
        for i, axis in enumerate("xyz"):
            if self.force[i] != 0.0 and axis not in self.force_directions:
                raise ConfigError(
                    f"force has {self.force[i]:g} N along {axis}, which is not among force_directions: a direction "
                    "carries force or position"
                )
        if self.profile and not any(self.force):
            raise ConfigError(
                "profile has shares of a force of 0 N: give force the size that they are shares of", "profile"
            )
        if len(self.profile) == 1:
            raise ConfigError("profile has one share: give the force itself, or two shares or more")
        for axis in self.torque_axes:
            if axis not in self.contact_resists:
                raise ConfigError(
                    f"torque_axes has {axis}, but contact_resists does not: nothing would stop the rotation"
                )

    def scaled_to(self, size: float) -> Control:
        """The same control with a force of another size [N]."""
        norm = sqrt(sum(v * v for v in self.force))
        if norm == 0.0:
            return self
        x, y, z = (v * size / norm for v in self.force)
        return replace(self, force=(x, y, z))

    def share_at(self, way: float) -> float:
        """Share of the force at a share of the path, 0 to 1."""
        n = len(self.profile) - 1
        if n < 1:
            return 1.0
        i = min(max(int(n * way), 0), n - 1)
        return self.profile[i] + (n * way - i) * (self.profile[i + 1] - self.profile[i])

    def at_start(self) -> Control:
        """The same control with the force at the start of its profile, and no profile."""
        return self._times(self.share_at(0.0))

    def at_most(self) -> Control:
        """The same control with the largest force of its profile, and no profile."""
        return self._times(max(self.profile, default=1.0))

    def _times(self, share: float) -> Control:
        x, y, z = (v * share for v in self.force)
        return replace(self, force=(x, y, z), profile=())

    def flags(self, axes: tuple[str, ...]) -> tuple[bool, bool, bool]:
        """Which of x, y, z are among the axes."""
        return "x" in axes, "y" in axes, "z" in axes


@dataclass(frozen=True)
class ContactStop:
    """Going until something is touched, or over a surface until it ends."""

    towards: str = field("-z", choices=WAYS, doc="axis of the work frame along which it goes and presses")
    force: float = field(2.0, unit="N", quantity=True, low=_LEAST_TOUCH, high=_MOST_TOUCH, doc="with which it touches")
    reach: float = field(0.04, unit="m", quantity=True, low=1e-3, high=0.5, doc="within which something must be found")
    edge: str = field("", choices=("", *WAYS), doc="go on this way over the surface, until it falls away")
    drop: float = field(0.0015, unit="m", quantity=True, low=5e-4, high=0.02, doc="of the tip that is an edge")

    def __post_init__(self) -> None:
        if self.edge and self.edge[-1] == self.towards[-1]:
            raise ConfigError(f"edge = {self.edge} lies along towards = {self.towards}: give a way across it")

    def scaled_to(self, size: float) -> ContactStop:
        """The same with another force [N]. Raises TaskError: it touches with more or less than it may."""
        if not _LEAST_TOUCH <= size <= _MOST_TOUCH:
            raise TaskError(
                f"force = {size:g} N: contact_stop touches with {_LEAST_TOUCH:g} to {_MOST_TOUCH:g} N: "
                "give a force within these, or write the phases' forces in a copy of the task"
            )
        return replace(self, force=size)


@dataclass(frozen=True)
class Phase:
    """One piece: a straight path (or none) under one control, until a condition holds for `dwell`."""

    name: str = field(doc="shown as progress")
    to: Vector3 | None = field(None, unit="m", quantity=True, low=-2, high=2, doc="end of the path, work frame")
    along: str = field(
        "work",
        choices=("work", "surface"),
        doc="axes of path, force and tilt: the work frame's, or the surface's own as it is found; `to` is then a way",
    )
    through: tuple[Vector3, ...] = field((), unit="m", low=-2, high=2, doc="corners of the path before its end")
    tilt: Vector3 | None = field(
        None,
        unit="deg",
        quantity=True,
        low=-90,
        high=90,
        doc="rpy of the tip at the end, relative to tip_rpy; stays until changed",
    )
    speed: float = field(0.05, unit="m/s", quantity=True, low=1e-4, high=0.25, doc="along the path")
    acceleration: float = field(0.2, unit="m/s^2", quantity=True, low=1e-3, high=5.0, doc="along the path")
    control: Control | None = field(None, doc="force and torque; none: position only")
    contact_stop: ContactStop | None = field(None, doc="go until something is touched, and tell where")
    search: Search | None = field(None, doc="slide over a plate until a hole is found")
    insert: Insert | None = field(None, doc="push into the hole that was found")
    until: str = field("arrived", choices=CONDITIONS, doc="what ends the phase")
    dwell: float = field(0.0, unit="s", quantity=True, low=0.0, high=600.0, doc="how long the condition must hold")
    timeout: float = field(
        10.0,
        unit="s",
        quantity=True,
        low=0.1,
        high=3600.0,
        doc="beyond the path's own time, and an approach that gets nearer; then the task fails and lifts",
    )

    def __post_init__(self) -> None:
        if self.contact_stop is not None and (self.to or self.control or self.search or self.insert):
            raise ConfigError("contact_stop brings its own way and force: leave out to, control, search and insert")
        self._check_end()
        if self.along != "work" and (self.contact_stop or self.search or self.insert):
            raise ConfigError("contact_stop, search and insert go along the work frame: leave out along")
        if self.control is not None and self.control.profile and self.to is None:
            raise ConfigError("profile goes along the path: say where it ends, by to")
        if self.through and self.to is None:
            raise ConfigError("through needs to: where the path ends")
        if self.through and self.along != "work":
            raise ConfigError("through has places in the work frame: it needs along: work")
        if self.search is not None and self.insert is not None:
            raise ConfigError("a phase is either search or insert: give two phases")
        for name, section in (("search", self.search), ("insert", self.insert)):
            if section is not None and (self.control is None or not any(self.control.force)):
                raise ConfigError(f"{name} needs a control with the force to press with")
            if section is not None and self.to is not None:
                raise ConfigError(f"{name} goes its own way: leave out to")

    def _check_end(self) -> None:
        """Raises ConfigError: until or dwell say what this phase does not wait for."""
        waits, search = self.until != "arrived", self.search
        ended_by = "until" if waits else "dwell"
        if self.contact_stop is not None and (waits or self.dwell):
            raise ConfigError("contact_stop ends where something is found: leave out until and dwell", ended_by)
        if self.insert is not None and (waits or self.dwell):
            raise ConfigError("insert ends at its depth: leave out until and dwell", ended_by)
        if search is not None and search.pattern == "here" and not waits:
            raise ConfigError("a search with pattern: here stays where it is: say until: settled, or contact")
        if search is not None and search.pattern != "here" and (waits or self.dwell):
            raise ConfigError(
                f"a search with pattern: {search.pattern} ends where the hole is found: leave out until and dwell",
                ended_by,
            )
        if self.until == "settled" and self.control is None:
            raise ConfigError("until: settled waits for a force: say which, by control", "until")

    def scaled_to(self, size: float) -> Phase:
        """The same phase with a force of another size [N]. Raises TaskError: its contact_stop cannot touch with it."""
        control = self.control.scaled_to(size) if self.control else None
        contact_stop = self.contact_stop.scaled_to(size) if self.contact_stop else None
        return replace(self, control=control, contact_stop=contact_stop)


@dataclass(frozen=True)
class Drawing:
    """Pen strokes; each becomes the phases over, touch, draw, raise."""

    control: Control = field(doc="force while drawing")
    strokes: tuple[tuple[tuple[float, float], ...], ...] = field((), unit="m", low=-1, high=1, doc="polylines of x, y")
    forces: tuple[float, ...] = field((), unit="N", low=0.1, high=100, doc="one per stroke; empty: the control's")
    text: str = field("", doc="text in a single-stroke font, instead of strokes")
    font: str = field("futural", doc="name of a Hershey font")
    height: float = field(0.03, unit="m", quantity=True, low=0.002, high=0.5, doc="of capital letters")
    origin: tuple[float, float] = field(
        (0.0, 0.0), unit="m", quantity=True, low=-2, high=2, doc="start of the base line"
    )
    speed: float = field(0.02, unit="m/s", quantity=True, low=1e-4, high=0.25, doc="while drawing")
    travel_speed: float = field(0.1, unit="m/s", quantity=True, low=1e-4, high=0.25, doc="between strokes")
    clearance: float = field(0.01, unit="m", quantity=True, low=1e-3, high=0.2, doc="of the tip between strokes")

    def __post_init__(self) -> None:
        if bool(self.text) == bool(self.strokes):
            raise ConfigError("a drawing needs either strokes or a text, not both and not neither")
        if self.text:
            check_text(self.text, self.font)
        if self.forces and not any(self.control.force):
            raise ConfigError(
                "forces are sizes along control.force, and that is 0 N: say there which way it presses, as 0 0 -1 N",
                "forces",
            )
        for number, stroke in enumerate(self.strokes, start=1):
            if len(stroke) < 2:
                raise ConfigError(
                    f"stroke {number} has {len(stroke)} point(s), a line needs two: for a dot use a phase with "
                    "control, until: settled and a dwell"
                )
        if self.forces and len(self.forces) != len(self.strokes):
            raise ConfigError(
                f"forces has {len(self.forces)} values for {len(self.strokes)} strokes: one each, or none"
            )


@dataclass(frozen=True)
class Task:
    """A whole task file."""

    name: str = field(doc="name of the task")
    description: str = field("", doc="one line")
    tool: str = field("", doc="name of the tool that the task is made for")
    frame: WorkFrame = field(WorkFrame(), doc="work frame")
    tip_rpy: Vector3 = field(
        (180.0, 0.0, 0.0), unit="deg", quantity=True, low=-360, high=360, doc="tip in the work frame"
    )
    lift: float = field(0.05, unit="m", quantity=True, low=0.005, high=0.3, doc="along the work frame's z on cancel")
    phases: tuple[Phase, ...] = field((), doc="what to do, in order")
    draw: Drawing | None = field(None, doc="strokes or text; played before the last phase")

    def __post_init__(self) -> None:
        if not self.phases:
            raise ConfigError("a task needs at least one phase")
        if self.draw is not None and len(self.phases) < 2:
            raise ConfigError("a task that draws needs a first phase (to approach) and a last one (to lift)")

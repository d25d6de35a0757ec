# SPDX-License-Identifier: Apache-2.0
"""A task made of a demonstration: free ways, presses until the force is there, and paths with the force along them."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from seed_control.parameters import ControllerParameters
from seed_control.tasks.task import SHARES, Control, Phase, Task, WorkFrame
from seed_control.teach.demonstration import STEP, TURNING, Demonstration, TeachError
from seed_control.teach.frame import MOVING, work_frame
from seed_control.teach.pieces import Level, Span, corners, levels, moves, rested, speed_of, touches
from seed_control.teach.settings import TeachSettings
from seed_core.spatial import Array, inverse_pose
from seed_core.vector3 import Vector3

CLEAR = 0.004  # [m] above the surface: what is nearer belongs to touching and letting go
ABOVE = 0.015  # [m] from which a touch begins, and to which the tool is let go
RELEASE = 0.03  # [m/s] at most: the tool springs back as the contact opens, slowly enough for cameras to follow
PRESSING = 0.005  # [m/s] at least along the surface while the force comes
FREE = 0.1  # [m/s] at most on the way to the start
SLOW = 0.003  # [m/s] below which the tip stands
PAUSE = 0.8  # [s] from which standing is a part of what was shown
LONGEST = 600.0  # [s] of a pause: the longest dwell of a task
LEVEL = 0.5  # [s] from which a force is one that was meant
SHORTEST = 0.3  # [s] of a touch
ACCELERATION = 0.2  # [m/s^2]
KNOT = 0.25  # [s] between places at which a force is told
EVEN = 0.1  # [N], rms, below which a force that wavers is even: noise of the estimates leaves 0.07 N
STANDS = 0.0015  # [m] around their mean, within which what is left of noise leaves the samples of a tip that stands
STAYED = 0.003  # [m] between touching and pressing, within which a tip has come down in one place
LEVER = 0.5  # length of a torque axis that lies across both tool and normal, from which on it counts as a lever's
SIDE_STIFFNESS = ControllerParameters().side_stiffness  # [N/m]


class TaughtTask(NamedTuple):
    """What came of a demonstration.

    Attributes:
        task: that plays again.
        forces: [N] of its pieces, in order.
        length: of its path in contact [m]. corners: of that path.
        uneven: by how much the touched points leave a plane [m].
    """

    task: Task
    forces: tuple[float, ...]
    length: float
    corners: int
    uneven: float


def make_task(shown: Demonstration, name: str, tool: str, settings: TeachSettings | None = None) -> TaughtTask:
    """The task of a demonstration; name: of the task, tool: that was held.

    Raises:
        TeachError: what was shown has gaps or jumps, is too short, or presses in no one direction.
    """
    settings = settings or TeachSettings()
    shown.check(settings)
    return _Maker(shown.even(), settings).task(name, tool)


class _Maker:
    """Cuts an even demonstration into phases."""

    def __init__(self, shown: Demonstration, settings: TeachSettings) -> None:
        self._settings = settings
        size = np.linalg.norm(shown.forces, axis=1)
        self._touched = touches(size, settings.touch, round(SHORTEST / STEP))
        X_W, self._uneven = work_frame(shown, self._touched)
        X = inverse_pose(X_W) @ shown.X_W_tip
        self._X_W, self._p = X_W, X[:, :3, 3]
        for a, b in self._touched:
            self._p[a:b] = rested(self._p[a:b], STANDS, round(SHORTEST / STEP))
        self._press = -(shown.forces @ X_W[:3, 2])  # [N] into the surface
        self._R = self._held(Rotation.from_matrix(X[:, :3, :3]))
        self._aim = self._aimed(shown)
        self._tilt = Rotation.identity()  # of the tip so far, relative to the task's
        self._forces: list[float] = []
        self._length, self._corners = 0.0, 0

    def _held(self, R: Rotation) -> Rotation:
        """The tip's rotations, relative to their mean; about axes that the contact resists they are not held."""
        a, b = self._touched[0] if self._touched else (0, len(self._p))
        self._R_tip = R[a:b].mean()
        turns = (self._R_tip.inv() * R).as_rotvec()
        turns[:, ["xyz".index(axis) for axis in self._settings.resists]] = 0.0
        return Rotation.from_rotvec(turns)

    def _aimed(self, shown: Demonstration) -> Array:
        """Where the reference of a controlled path has to be (n, 3) [m] for the tip to go as it was shown.

        Across its path a tool that torque turns gives way to a side force, here friction, by `side_stiffness`.
        """
        aim, R = self._p.copy(), self._X_W[:3, :3].T @ shown.X_W_tip[:, :3, :3]
        speed = np.linalg.norm(np.gradient(aim[:, :2], STEP, axis=0), axis=1, keepdims=True)
        slides = shown.forces @ self._X_W[:3, :3] * (speed > MOVING)  # a tip that sticks may press aside by chance
        force = uniform_filter1d(slides, round(TURNING / STEP), axis=0, mode="nearest")
        for axis in self._settings.resists:
            side = np.cross(R[:, :, "xyz".index(axis)], R[:, :, 2]) * (1.0, 1.0, 0.0)
            size = np.linalg.norm(side, axis=1, keepdims=True)
            e = np.where(size > LEVER, side / np.maximum(size, LEVER), 0.0)
            aim += np.sum(force * e, axis=1, keepdims=True) * e / SIDE_STIFFNESS
        return aim

    def task(self, name: str, tool: str) -> TaughtTask:
        """All phases."""
        phases: list[Phase] = []
        before = 0
        for number, (a, b) in enumerate(self._touched, start=1):
            suffix = f" {number}" if len(self._touched) > 1 else ""
            pieces = levels(self._press[a:b], self._settings.force, round(LEVEL / STEP))
            phases += self._free((before, a), f"approach{suffix}", "end", self._landing(a, pieces[0]))
            phases += self._contact(a, pieces, suffix)
            x, y, _ = phases[-1].to or self._p[b - 1]
            phases.append(self._phase(f"release{suffix}", (b - 1, b), (x, y, ABOVE), RELEASE))
            before = b
        phases += self._free((before, len(self._p)), "leave" if self._touched else "move", "start", None)
        if not phases:
            raise TeachError("the tip neither moved nor touched anything: there is nothing to play")
        first = phases[0]
        phases[0] = replace(first, speed=min(first.speed, FREE))
        rpy = np.rad2deg(_rpy(Rotation.from_matrix(self._X_W[:3, :3])))
        task = Task(
            name=name,
            description=f"taught: {len(self._forces)} forces, {1e3 * self._length:.0f} mm in contact",
            tool=tool,
            frame=WorkFrame(_vector(self._X_W[:3, 3]), _vector(rpy, 3)),
            tip_rpy=_vector(np.rad2deg(_rpy(self._R_tip)), 3),
            phases=_numbered(phases),
        )
        return TaughtTask(task, tuple(self._forces), self._length, self._corners, self._uneven)

    # free ways
    def _free(self, span: Span, name: str, near: str, landing: Array | None = None) -> Iterator[Phase]:
        """Without contact; near: which end of it is at the surface, from which it keeps clear; landing: (2,) there."""
        a, b = span
        if self._touched:
            low = CLEAR if near == "end" else ABOVE
            clear = np.flatnonzero(self._p[a:b, 2] > low) + a
            a, b = (int(clear[0]), int(clear[-1]) + 1) if len(clear) else (a, a)
        if near == "end" and b - a < 2:  # it was shown from the surface on
            x, y = landing if landing is not None else self._p[-1][:2]
            yield self._phase(name, (span[1], span[1] + 1), (x, y, ABOVE), FREE)
            return
        if near == "end" and a == 0:
            yield self._phase("begin", (a, a + 1), _vector(self._p[a]), FREE)
        if b - a < 2:
            return
        way = list(self._free_paths((a, b), name))
        if landing is not None and way and (end := way[-1].to) is not None:  # friction keeps a tip where it lands
            over = _vector(np.array((*landing, CLEAR)))
            way[-1] = replace(way[-1], through=(*way[-1].through, end), to=over)
        yield from way

    # contact
    def _landing(self, a: int, first: Level) -> Array:
        """Where (2,) the tip comes down that touches at sample a: where it presses, if it stayed there."""
        touch, there = self._p[a, :2], self._p[a + first.there, :2]
        return there if np.linalg.norm(there - touch) < STAYED else touch

    def _contact(self, a: int, pieces: list[Level], suffix: str) -> Iterator[Phase]:
        """A press, then paths with the force that was shown along them, and what is done where the tip stands."""
        for piece in pieces:
            if piece.size <= 0.0:
                raise TeachError(
                    f"the force pulls {-piece.size:.1f} N away from the surface {self._time(a + piece.start):.1f} s "
                    "after the start: only pressing can be taught"
                )
            self._forces.append(round(piece.size, 2))
        start, end = a + pieces[0].there, a + pieces[-1].end
        points = self._aim[start:end] * (1.0, 1.0, 0.0)
        yield self._press_to((a, start), f"press{suffix}", self._control(pieces[0].size))
        stretches = moves(points, STEP, SLOW, round(PAUSE / STEP))
        for number, ((i, j), moving) in enumerate(stretches, start=1):
            word = f"{suffix} {number}" if len(stretches) > 1 else suffix
            if moving:
                yield from self._path((start + i, start + j), points[i:j], f"wipe{word}", True)
                continue
            for piece in pieces:
                first, there = max(start + i, a + piece.start), max(start + i, a + piece.there)
                last = min(start + j, a + piece.end)
                if (last - there) * STEP > LONGEST:
                    raise TeachError(
                        f"the tip stands for {(last - there) * STEP:.0f} s, {self._time(there):.0f} s after the start, "
                        f"at most {LONGEST:g} s can be taught: lead the arm on sooner"
                    )
                if last <= there:
                    continue
                if there > first:
                    yield self._press_to((first, there), f"press{word}", self._control(piece.size))
                dwell = round((last - there) * STEP, 2)
                yield Phase(f"stay{word}", control=self._control(piece.size), dwell=dwell)

    def _press_to(self, span: Span, name: str, control: Control) -> Phase:
        """On until the force is there."""
        a, b = span
        b = max(b, a + 1)
        path = self._aim[a:b] * (1.0, 1.0, 0.0)
        speed = self._speed(path, PRESSING)
        return replace(
            self._phase(name, (a, b), _vector(path[-1]), speed), control=control, until="settled", dwell=0.15
        )

    def _control(self, size: float) -> Control:
        axes = self._settings.resists
        return Control((0.0, 0.0, -round(size, 2)), torque_axes=axes, contact_resists=axes)

    # ways
    def _free_paths(self, span: Span, name: str) -> Iterator[Phase]:
        """Where the tip moves in a span without contact."""
        a, b = span
        for (i, j), moving in moves(self._p[a:b], STEP, SLOW, round(PAUSE / STEP)):
            if moving:
                yield from self._path((a + i, a + j), self._p[a + i : a + j], name, False)

    def _path(self, span: Span, points: Array, name: str, pressed: bool) -> Iterator[Phase]:
        """Along points (n, 3) [m], those of a span, cut where the tip turns; pressed: with the force that was shown."""
        turns = self._R[span[0] : span[1]].as_rotvec()
        cuts = corners(turns, np.deg2rad(self._settings.turn))
        for k, m in pairwise(cuts):
            a, b, part = span[0] + k, span[0] + m + 1, points[k : m + 1]
            kept = part[corners(part, self._settings.path)]
            phase = self._phase(name, (a, b), _vector(kept[-1]), self._speed(part, 1e-4))
            control = self._pressing((a, b), part) if pressed else None
            through = tuple(_vector(point) for point in kept[1:-1])
            yield replace(phase, through=through, control=control, acceleration=ACCELERATION)
            if pressed:
                self._length += _length(part)
                self._corners += len(kept)

    def _pressing(self, span: Span, way: Array) -> Control:
        """The force that was shown along a way (n, 3): its mean, and its shares of that where it is not even."""
        press = self._press[span[0] : span[1]]
        control = self._control(float(np.mean(press)))
        gone = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))))
        count = round(len(way) * STEP / KNOT) + 1
        if count < 2 or gone[-1] <= 0.0:
            return control
        knots = np.linspace(0.0, 1.0, count)
        near = np.column_stack([np.interp(gone / gone[-1], knots, row) for row in np.eye(count)])  # 1 at its knot
        told = near.sum(axis=0) > 0.0  # means, since a curve of least squares swings beside a step
        shares = np.interp(knots, knots[told], (press @ near)[told] / near.sum(axis=0)[told]) / -control.force[2]
        if np.std(shares) * -control.force[2] < EVEN:
            return control
        return replace(control, profile=tuple(np.round(np.clip(shares, *SHARES), 3).tolist()))

    def _phase(self, name: str, span: Span, to: Vector3, speed: float) -> Phase:
        """A phase of samples, which ends with the tip's rotation of the last, if that is another."""
        turn = self._R[min(span[1], len(self._R)) - 1]
        tilt = None
        if np.rad2deg((self._tilt.inv() * turn).magnitude()) > self._settings.turn:
            self._tilt, tilt = turn, _vector(np.rad2deg(_rpy(turn)), 3)
        return Phase(name, (round(to[0], 6), round(to[1], 6), round(to[2], 6)), tilt=tilt, speed=round(speed, 4))

    def _speed(self, path: Array, low: float) -> float:
        return speed_of(_length(path), len(path) * STEP, ACCELERATION, low, 0.25)

    def _time(self, sample: int) -> float:
        return sample * STEP


def _numbered(phases: list[Phase]) -> tuple[Phase, ...]:
    """The phases, with those that share a name numbered from the second on: pieces of one way, forces of one stand."""
    out, seen = list[Phase](), Counter[str]()
    for phase in phases:
        seen[phase.name] += 1
        number = seen[phase.name]
        out.append(replace(phase, name=f"{phase.name} {number}") if number > 1 else phase)
    return tuple(out)


def _length(points: Array) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _rpy(R: Rotation) -> Array:
    return np.asarray(R.as_euler("xyz"))


def _vector(values: Array, digits: int = 6) -> Vector3:
    x, y, z = (round(float(v), digits) + 0.0 for v in values)
    return x, y, z

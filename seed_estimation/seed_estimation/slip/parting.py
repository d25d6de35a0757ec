# SPDX-License-Identifier: Apache-2.0
"""Fingers whose markers part: a tool is rigid, so what sticks to it goes as far on one side as on the other.

Friction and grip are never quite alike. A tool that slides along an axis that depth does not see takes one membrane
further than the other, and both are seen to stop apart. A load that comes slowly parts them as well, for a patch slides
from its edge inwards long before it lets go; but a drag that ends does not. The images would rather have the tool
turned than apart, which depth knows better: the gap between the fingers' displacements is taken at the turn that depth
sees.

Nor do membranes turn apart about y on a tool that sticks.

A tool that sticks makes a gap, too: by images of unequal times, by a scale of depth that is wrong, and by depth that
is late. Along x and along z alike, with the turn about z and about x; about y no turn counts:

    gap = constant + lever turn + skew speed + late (turn's speed)

The four are learned while the tool sticks, by a Kalman filter for each axis that stays some frames behind.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array
from seed_estimation.rigid_fit.residuals import motion_vector
from seed_estimation.slip.markers import Markers, Observation

# Turn about y at the patch's reach, shift along x and z: [m/s] of dragged markers, and [m] by which the gap differs
FAST, PARTED = np.array((0.008, 0.012, 0.012)), np.array((2.5e-4, 2e-4, 2e-4))
LATELY, STOPPED = 0.2, 0.25  # [s] that is looked back for a drag; share of its speed when it has stopped
SURE = 2.0  # deviations by which the gap differs from what it should be
FRAMES, BEHIND = 2, 3  # in a row; by which what is learned stays behind
# What may be at first: [m], [m] of lever (a depth that is 5 % off in scale), [s] of skew, [m s] of depth that is late
FIRST = np.array((2e-4, 1e-2, 1.2e-2, 4e-4))
DRIFT = np.array((3e-5, 1e-4, 1e-4, 1e-5))  # of them, per root of a second
NOISE = 2e-5  # [m] of the gap, beside that of depth's turn
# [s] of skewed images and of late depth beyond what is learned, which goes as the tool moves: fast motion is no
# multiple of slow motion. A tool that slides leaves its membranes at rest.
SKEWED, LATE = 0.012, 0.012
DOUBTED = 1e-4  # [m] that the constant may have changed by, per frame that does not fit
LEAP = 1.2e-3  # [m] off their way, and the other finger's, by which markers go that were found a pitch further
ACROSS = np.array((2, 0))  # turns about z and x, by which a tool takes one finger's patch further along x and z


class Gap(NamedTuple):
    """Between both fingers' markers along or about one axis in one frame.

    Attributes:
        stamp: of the frame [s].
        size: [m]. variance: of its noise [m^2].
        of: (4,) what it goes with: 1, the turn [rad], the speed [m/s] and the turn's speed [rad/s].
        margin: [m] by which a tool that moves may make another gap than was learned.
        bound: [m] beyond that and its deviations, from which on it is another gap.
        stops: whether the markers have just been dragged along that axis, and now rest.
    """

    stamp: float
    size: float
    variance: float
    of: Array
    margin: float
    bound: float
    stops: bool


class UsualGap:
    """The gap along or about one axis while the tool sticks."""

    def __init__(self) -> None:
        self._value, self._P = np.zeros(4), np.diag(FIRST**2)
        self._waiting: deque[Gap] = deque()
        self._side, self._count = 0.0, 0

    def restart(self) -> None:
        """The constant may be any from now on."""
        self._waiting.clear()
        self._P[0], self._P[:, 0], self._count = 0.0, 0.0, 0
        self._P[0, 0] = 1.0

    def unlike(self, gap: Gap) -> bool:
        """Whether a drag has just ended, and the gap has surely been another than usual for some frames since."""
        off, deviation = self._off(gap)
        parted = gap.stops and abs(off) > gap.bound + SURE * deviation + gap.margin
        side = math.copysign(1.0, off) if parted else 0.0
        self._count = self._count + 1 if side and side == self._side else int(side != 0.0)
        self._side = side
        if self._waiting and gap.stamp <= self._waiting[-1].stamp:
            self._waiting.clear()  # the clock was set back: what drifts does not become surer by that
        self._waiting.append(gap)
        if len(self._waiting) > BEHIND:
            self._learn(self._waiting.popleft())
        return self._count >= FRAMES

    def _off(self, gap: Gap) -> tuple[float, float]:
        """By how much a gap differs from what it should be [m], and the deviation of that."""
        return gap.size - float(gap.of @ self._value), math.sqrt(float(gap.of @ self._P @ gap.of) + gap.variance)

    def _learn(self, gap: Gap) -> None:
        off, deviation = self._off(gap)
        if abs(off) < gap.bound + SURE * deviation + gap.margin:
            gain = self._P @ gap.of / (deviation**2 + gap.margin**2)
            self._value = self._value + gain * off
            self._P = self._P - np.outer(gain, gap.of @ self._P)
        else:
            self._P[0, 0] += DOUBTED**2
        self._P = self._P + np.diag(DRIFT**2) * (self._waiting[0].stamp - gap.stamp)


class _Motion(NamedTuple):
    """Up to a time; entries of each: about y, along x, along z.

    Attributes:
        stamp: [s].
        turn: (3,) of the tool [rad] that goes with the gap: 0, about z, about x.
        speed: (3,) of the markers [m/s].
        rate: (3,) of the turn [rad/s].
    """

    stamp: float
    turn: Array
    speed: Array
    rate: Array


class Parting:
    """Of both fingers in one grasp."""

    def __init__(self) -> None:
        self._usual = (UsualGap(), UsualGap(), UsualGap())
        self._motions: deque[_Motion] = deque()

    def parts(self, markers: Sequence[Markers], turn: Array, by_depth: Array, deviation: Array) -> bool:
        """Whether the markers of both fingers, found in this frame, part as on a tool that slides.

        turn (2,): of the tool about z and x since the grasp [rad]; by_depth, deviation: the same as depth sees it.
        """
        a, b = (_steps(m.seen) for m in markers)
        if not (len(a) and len(b)):
            self._motions.clear()
            return False
        now, before = markers[0].seen[-1].stamp, markers[0].seen[-2].stamp
        turn = np.concatenate(((0.0,), turn))
        speed, rate = 0.5 * (a[-1] + b[-1]) / (now - before), np.zeros(3)
        if self._motions and now > self._motions[-1].stamp:
            rate = (turn - self._motions[-1].turn) / (now - self._motions[-1].stamp)
        self._motions.append(_Motion(now, turn, speed, rate))
        while not 0.0 <= now - self._motions[0].stamp <= LATELY:
            self._motions.popleft()
        if _leaps(a, b) or _leaps(b, a):
            for usual in self._usual:
                usual.restart()
            return False
        apart = abs(markers[0].side - markers[1].side)
        size = _moved(markers[0], by_depth) - _moved(markers[1], by_depth)
        variance = NOISE**2 + np.square(apart * np.concatenate(((0.0,), deviation)))
        speeds = np.abs([m.speed for m in self._motions])
        rates = np.abs([m.rate for m in self._motions])
        margin = SKEWED * speeds[-FRAMES - 1 :].max(axis=0) + LATE * apart * rates[-FRAMES - 1 :].max(axis=0)
        fastest = speeds.max(axis=0)
        stops = (fastest > FAST) & (speeds[-1] < STOPPED * fastest)
        of = np.stack((np.ones(3), turn, speed, rate), axis=1)
        gaps = [Gap(now, *each) for each in zip(size, variance, of, margin, PARTED, stops, strict=True)]
        unlike = [usual.unlike(gap) for usual, gap in zip(self._usual, gaps, strict=True)]  # all learn
        return any(unlike)


def _moved(markers: Markers, by_depth: Array) -> Array:
    """Displacement (3,) [m] of the tool by one finger's markers, were it turned about z and x as depth sees it."""
    z, x = by_depth - motion_vector(markers.X_CT)[ACROSS]
    return np.asarray(markers.seen[-1].displacement + markers.side * np.array((0.0, z, -x)))


def _steps(seen: Sequence[Observation]) -> Array:
    """(k, 3) [m] from frame to frame, of the last k <= 2."""
    return np.diff([s.displacement for s in list(seen)[-3:]], axis=0)


def _leaps(steps: Array, other: Array) -> bool:
    """Whether a finger's markers have gone further than at their speed, or with the other's, or both."""
    return len(steps) > 1 and min(_off(steps[-1], steps[-2]), _off(steps[-1], other[-1])) > LEAP


def _off(point: Array, end: Array) -> float:
    """[m] of a point from the line from 0 to `end`."""
    share = float(point @ end) / max(float(end @ end), 1e-18)
    return math.dist(point, min(max(share, 0.0), 1.0) * end)

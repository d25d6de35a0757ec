# SPDX-License-Identifier: Apache-2.0
"""The spring's wrench against the tool's own weight, whenever the tool hangs free.

At rest in free space the spring carries the weight: w_spring + w_weight = 0, about T's origin in T, in any attitude.
An offset of the pose shows at once, a wrong stiffness in proportion to the weight, and both apart as the arm turns.

Whether the tool hangs free is known late and not for certain: a touch is told only once it is strong enough. So a
sample waits before it counts. A correction learns from it only if the difference was the same where the tip had been
before, some way off along it, which a touch would have changed, and if it is still there after the wait: a support that
carries the tool (a holder, the hand that gave it) lets go of it as the arm moves off.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from seed_control.monitor.contradiction import WindowTest
from seed_control.wrench.estimate import Measurement
from seed_core.hand import GRAVITY, Tool
from seed_core.spatial import Array, Wrench, length, skew
from seed_core.wrench_settings import ReferenceSettings

WAIT = 0.4  # [s] before a sample counts: a touch is contact by then
CLEAR = 5e-3  # [m] that the tip comes away from where it touched before it counts as free again
TRAVEL = 4e-3  # [m] of the tip along a difference, from which on a touch would have changed it
PLACES, APART = 100, 1e-3  # of the tip in the air that are remembered, [m] from one to the next
COMPARED = 5  # of them, the last that lie so far off
STAYS = 0.25  # of a difference, by which it may change and be the same still, beyond one deviation
MOVED = 5e-3  # [m] of the grasp's centre since it was taken, before which the tool may still stand in its holder
GOES = 0.5  # of a difference, by which it shrinks where a support has let go, beyond one deviation
_SETTLED = 2.0  # [N] per second by which a hanging tool's spring may change
_FLOOR = np.array((0.01, 0.01, 0.01, 0.05, 0.05, 0.05)) ** 2  # of a tool that swings a little


class FreeSpaceSample(NamedTuple):
    """One moment in free space.

    Attributes:
        spring: (6,) as the model tells it, uncorrected, in T. load: (6,) what the weight asks for.
        random, systematic: (6, 6) covariances of their difference.
        verified: a touch or a support is ruled out.
    """

    m: Measurement
    spring: Array
    load: Array
    random: Array
    systematic: Array
    verified: bool


class WeightCheck:
    """`update` ten times a second; `reason` says what does not agree.

    Attributes:
        passed: the samples that have become certain by the last update.
    """

    def __init__(self, settings: ReferenceSettings, tool: Tool) -> None:
        self._tool = tool
        self._tolerance = settings.force_tolerance  # [N]
        self._test = WindowTest(settings.force_tolerance, settings.torque_tolerance)
        self._mass = settings.mass_deviation * tool.mass * GRAVITY  # [N]
        self._lever = 1e-3 * settings.centre_deviation  # [m]
        self._waiting: deque[FreeSpaceSample] = deque()
        self._places: deque[tuple[Array, Array]] = deque(maxlen=PLACES)  # tip in W [m], the force's difference in T
        self._touched: tuple[Array, Array] | None = None  # tip and direction of the last touch
        self.passed: list[FreeSpaceSample] = []
        self.new_grasp()

    def new_grasp(self) -> None:
        """Nothing is known of it, nor has it been moved."""
        self._taken_at: Array | None = None  # (3,) [m] of its centre in W, when it is first seen
        self._moved = False
        self.reset()

    def reset(self) -> None:
        """What was found is told no longer."""
        self._waiting.clear()
        self._test.reset()
        self._places.clear()
        self._before: tuple[float, Array] | None = None
        self.passed, self.reason = [], ""

    def free(self, m: Measurement, in_contact: bool) -> bool:
        """Whether the tool seems to hang free, as far as is known now."""
        if in_contact:
            force = m.on_environment.force
            self._touched = m.tip, force / max(length(force), 1e-9)
        elif self._touched is not None:
            tip, into = self._touched
            if float((tip - m.tip) @ into) > CLEAR:
                self._touched = None
        return self._touched is None

    def update(self, m: Measurement, spring: Wrench, weight: Wrench, random: Array, in_contact: bool) -> None:
        """Take in a measurement.

        Args:
            spring: as the model tells it, uncorrected, about T's origin in T. weight: of the tool, likewise.
            random: (6, 6) covariance of the spring's wrench by the pose.
        """
        self.passed = []
        if self._tool.mass == 0.0:
            return
        told = spring.vector()
        place = m.X_WC[:3, 3]
        if self._taken_at is None:
            self._taken_at = place.copy()
        self._moved |= length(place - self._taken_at) > MOVED
        if self._before is not None and m.stamp < self._before[0]:  # the clock was set back
            self._waiting.clear()
            self._test.reset()
            self._before = None
        before, self._before = self._before, (m.stamp, told)
        if not self.free(m, in_contact):
            self._waiting.clear()
            self._test.reset()
            self._places.clear()
            return  # the reason stays: what was found while it hung free is not mended by pressing
        load = -weight.vector()
        if not self._places or length(m.tip - self._places[-1][0]) > APART:
            self._places.append((m.tip, (told - load)[3:]))
        noise = 4.0 * np.sqrt(random.diagonal()[3:])
        if before is None or (np.abs(told - before[1])[3:] > _SETTLED * (m.stamp - before[0]) + noise).any():
            return
        no_touch = self._same_elsewhere(m, (told - load)[3:], random[3:, 3:])
        self._waiting.append(FreeSpaceSample(m, told, load, random, self._systematic(weight), no_touch))
        while self._waiting and self._waiting[0].m.stamp <= m.stamp - WAIT:
            self._take(self._waiting.popleft(), told - load)
        if not self._test.significant:
            self.reason = ""
        elif self._moved and self._test.to_be_told(m.stamp):
            self.reason = (
                "while the tool hangs free or is still carried, the grasp's wrench differs from the tool's weight of "
                f"{self._tool.mass * GRAVITY:.2f} N {self._test.told()}: does something touch it, "
                "is tool.mass right, the stiffness, and was the grasp taken free of load?"
            )

    def _same_elsewhere(self, m: Measurement, d: Array, random: Array) -> bool:
        """Whether a difference of the force d (3,) in T was the same where the tip had been, along it, before."""
        size = length(d)
        tips, forces = (np.array(of) for of in zip(*self._places, strict=True))
        away = np.abs((tips - m.tip) @ (m.X_WT[:3, :3] @ d)) > TRAVEL * size
        before = forces[away][-COMPARED:]
        if not len(before):
            return False
        return abs(float((before.mean(axis=0) - d) @ d)) <= STAYS * size**2 + float(np.sqrt(d @ random @ d))

    def _take(self, s: FreeSpaceSample, now: Array) -> None:
        """A sample that has waited; now: (6,) the difference at present."""
        difference = s.spring - s.load
        d = difference[3:]
        noise = float(np.sqrt(d @ s.random[3:, 3:] @ d))
        change = float((now[3:] - d) @ d)  # along the difference, times its size
        stays = abs(change) <= STAYS * float(d @ d) + noise
        if float(d @ d) > self._tolerance**2 and change < -GOES * float(d @ d) - noise:
            self._test.reset()  # what was found of a tool that something carried says nothing of one that hangs
        self._test.add(s.m.stamp, difference, s.random, s.systematic)
        self.passed.append(s._replace(verified=stays and s.verified))

    def _systematic(self, weight: Wrench) -> Array:
        """(6, 6) by mass and centre of mass."""
        C = np.diag(_FLOOR)
        w = weight.vector() * (self._mass / max(self._tool.mass * GRAVITY, 1e-9))
        C += np.outer(w, w)
        shift = self._lever * skew(weight.force)
        C[:3, :3] += shift @ shift.T
        return C

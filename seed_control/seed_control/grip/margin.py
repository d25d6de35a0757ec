# SPDX-License-Identifier: Apache-2.0
"""The slip margin of a grasp: 1 far from slipping, 0 as it slides; with its standard deviation.

Two patches with friction mu, each pushed with N, bear a force f along them and a torque tau about their normal up to
their limit surface (Goyal, Ruina & Papadopoulos, Wear 143, 1991). By the ellipsoid for it (Howe & Cutkosky, Int. J.
Robotics Research 15, 1996), with a radius r of the patch,

    load = sqrt(|f|^2 + (tau / r)^2),    margin = 1 - load / (2 mu N).

Force along the normal and torque across it are borne by pressure, not by friction: on simulated membranes they slide
nothing. With x = 1 / mu the margin is linear in x, so a scalar Kalman filter learns friction from what the membranes
show of slip: a patch that creeps along its edge has little margin left, one that sticks has some. How much is a band,
not a line (cylinders let go later than boxes), so only what contradicts the band teaches anything.
"""

from math import hypot, isfinite, nan, sqrt
from typing import NamedTuple

import numpy as np

from seed_control.grip.settings import GripSettings
from seed_core.spatial import Array, Wrench

# Share of the motion that the membrane does not follow, and the used share of friction between which it then lies; on
# three simulated membranes with box and cylinder (docs/grip.md).
_CREEP = (0.03, 0.10, 0.25)
_USED_AT_LEAST = (0.0, 0.65, 0.95)
_FOLLOWED = (0.02, 0.05, 0.10)
_USED_AT_MOST = (0.85, 0.95, 1.1)
_BAND = 0.1  # deviation of both
_FORGOTTEN = 0.15  # [s] in which a creep that does not go on is forgotten: after a slip it stays where it came to
_RECENT = 1.0  # [s] of the load's peak
_FALLS = 0.9  # of its peak: a load that falls leaves creep behind, and the motion that it is a share of shrinks
_WANDER = 0.02  # [1/sqrt(s)] relative, of friction
_REFUTED = 0.3  # relative deviation of friction that a slide adds
_LEAST_LOAD = 0.5  # [N] below which nothing is learnt
_LEAST_GRIP = 0.05  # [N]
_EXTREMES = 0.1, 5.0  # of friction


class SlipSigns(NamedTuple):
    """What images show of slip.

    Attributes:
        slip: share of the tool's motion that the membrane does not follow. incipient: the same at the patch's edge;
            not a number where they are not told: then nothing is learnt from a tool that seems to stick.
        gross: the tool slides.
    """

    slip: float = nan
    incipient: float = nan
    gross: bool = False


class Margin(NamedTuple):
    """At the time of an image.

    Attributes:
        value, deviation: of the margin [1].
        load: [N] that friction has to bear, with deviation. friction: Coulomb's coefficient as learnt.
        need: [N/N] grip of each finger that just bears a load of one newton, with deviation.
    """

    stamp: float
    value: float
    deviation: float
    load: float
    load_deviation: float
    friction: float
    need: float
    need_deviation: float


class SlipMargin:
    """One grasp; `restart` with a new one."""

    def __init__(self, settings: GripSettings) -> None:
        self._settings = settings
        self.restart()

    def restart(self) -> None:
        """Nothing is known of friction but the settings'."""
        s = self._settings
        self._x = 1.0 / s.friction
        self._P = (s.friction_deviation * self._x) ** 2
        self._stamp = nan
        self._settled = self._most = 0.0
        self._gross = False

    def update(self, stamp: float, spring: Wrench, covariance: Array, grip: float, signs: SlipSigns) -> Margin:
        """The margin at an image.

        Args:
            stamp: [s] of the image.
            spring: load of the grasp on the tool about T's origin, written in C, whose y is the fingers' axis.
            covariance: (6, 6) of its (torque, force).
            grip: [N] push of each finger.
            signs: of slip.
        """
        r = self._settings.patch_radius
        turning = float(spring.torque[1]) / r
        load = sqrt(float(spring.force[0]) ** 2 + float(spring.force[2]) ** 2 + turning**2)
        slope = np.array((0.0, turning / r, 0.0, spring.force[0], 0.0, spring.force[2])) / max(load, 1e-6)
        deviation = sqrt(max(float(slope @ covariance @ slope), 0.0))
        a = load / (2.0 * max(grip, _LEAST_GRIP))  # used share of friction = a x
        dt = max(stamp - self._stamp, 0.0) if isfinite(self._stamp) else 0.0
        self._stamp = stamp
        self._most = max(load, self._most * (1.0 - min(dt / _RECENT, 1.0)))
        self._learn(a if load > max(_LEAST_LOAD, 2.0 * deviation) else 0.0, load < _FALLS * self._most, dt, signs)
        spread = hypot(a * sqrt(self._P), self._x * deviation / (2.0 * max(grip, _LEAST_GRIP)))
        return Margin(
            stamp, min(max(1.0 - a * self._x, 0.0), 1.0), spread, load, deviation,
            1.0 / self._x, 0.5 * self._x, 0.5 * sqrt(self._P),
        )  # fmt: skip

    def _learn(self, a: float, falls: bool, dt: float, signs: SlipSigns) -> None:
        self._P += (_WANDER * self._x) ** 2 * dt
        told = [share for share in (signs.slip, signs.incipient) if isfinite(share)]
        creep = max(told, default=0.0)
        fresh = creep - self._settled
        self._settled += fresh * (1.0 if fresh < 0.0 else min(dt / _FORGOTTEN, 1.0))
        slid, self._gross = signs.gross and not self._gross, signs.gross
        if a <= 0.0:
            return
        if slid:  # what was believed of friction is refuted
            self._P += (_REFUTED * self._x) ** 2
        used = a * self._x
        low = 1.0 if slid else float(np.interp(fresh, _CREEP, _USED_AT_LEAST))
        high = float(np.interp(creep, _FOLLOWED, _USED_AT_MOST))
        if used < low and not falls:
            self._correct(a, low - used)
        elif told and used > high:
            self._correct(a, high - used)

    def _correct(self, a: float, difference: float) -> None:
        gain = self._P * a / (a * a * self._P + _BAND**2)
        self._P *= 1.0 - gain * a
        self._x = min(max(self._x + gain * difference, 1.0 / _EXTREMES[1]), 1.0 / _EXTREMES[0])

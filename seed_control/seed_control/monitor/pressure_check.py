# SPDX-License-Identifier: Apache-2.0
"""The pressures in both bubbles against those of the identification, and whether the sensors tell them at all.

A stiffness or a membrane's map holds at the pressures at which it was identified. Another membrane, another grip, a
leak and a reading in other units show here; so does a sensor that falls silent or sticks.
"""

from collections.abc import Sequence
from math import inf, isfinite

from seed_core.estimate import MembraneMotion, RelativePoseEstimate
from seed_core.membrane.map import pressure_reason

SILENT = 1.0  # [s] without a reading
_ALIKE = 25  # readings in a row that are the very same, of a sensor that has shown noise ...
_TIMES_LONGER = 5  # ... and so many times more than ever before
_ALWAYS, _MOVED = 60, 3e-4  # readings that never changed, while the imprint's depth did by this much [m]


class PressureCheck:
    """`update` with each estimate; `reason` says what is wrong with a pressure, '' while nothing is."""

    def __init__(self, identified: Sequence[float] = (), needed: bool = False) -> None:
        """identified: pressures [hPa] of the grips; empty: unknown. needed: the wrench is computed from them."""
        self._identified = [p for p in identified if p > 0.0]
        self._needed = needed
        self._fingers: dict[str, _Finger] = {}
        self.reason = ""

    def update(self, estimate: RelativePoseEstimate) -> None:
        """Take in an estimate with what its membranes tell; one that tells of none has no pressure to be wrong."""
        if not (self._needed or self._identified):
            return
        reasons = []
        for motion in estimate.membrane:
            finger = self._fingers.setdefault(motion.finger, _Finger(estimate.stamp))
            reasons += [finger.silent(motion, estimate.stamp, self._needed), finger.stuck(motion)]
            reasons.append(why_off(motion.finger, motion.pressure, self._identified))
        self.reason = next(filter(None, reasons), "")


def why_off(finger: str, pressure: float, identified: Sequence[float]) -> str:
    """Why a pressure [hPa] does not go with those of the identified grips; '' if it does, or one of both is unknown."""
    if not (identified and isfinite(pressure)):
        return ""
    return pressure_reason(finger, pressure, min(max(pressure, min(identified)), max(identified)))


class _Finger:
    """One sensor's readings so far."""

    def __init__(self, t: float) -> None:
        self._told = t  # [s] when it was last heard
        self._heard = False
        self._value, self._same, self._longest, self._changes = inf, 0, 0, 0
        self._low, self._high = inf, -inf  # depth of the imprint [m] since the value is the same

    def silent(self, motion: MembraneMotion, t: float, needed: bool) -> str:
        if isfinite(motion.pressure):
            self._told, self._heard = t, True
        self._told = min(self._told, t)  # a clock may be set back
        since = t - self._told
        if since <= SILENT or not (self._heard or needed):
            return ""
        return f"pressure of the {motion.finger} bubble is silent: none for {since:.1f} s, at most {SILENT:g} s"

    def stuck(self, motion: MembraneMotion) -> str:
        p, depth = motion.pressure, motion.indentation
        if not isfinite(p):
            return ""
        if p == self._value:
            self._same += 1
        else:
            self._longest = max(self._longest, self._same)
            self._changes += self._value < inf
            self._value, self._same, self._low, self._high = p, 0, inf, -inf
        if isfinite(depth):
            self._low, self._high = min(self._low, depth), max(self._high, depth)
        lively = self._changes >= _ALIKE and self._same >= max(_ALIKE, _TIMES_LONGER * self._longest)
        deaf = self._same >= _ALWAYS and self._high - self._low > _MOVED
        if not (lively or deaf):
            return ""
        return (
            f"pressure of the {motion.finger} bubble is stuck at {p:.5g} hPa: {self._same} readings were the very same"
        )

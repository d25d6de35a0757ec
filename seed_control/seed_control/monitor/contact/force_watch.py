# SPDX-License-Identifier: Apache-2.0
"""Whether the force that is estimated in contact is the wanted one: told where it is off, a hold where it is too large.

What comes from outside (a table that moves, a tool that is pushed) shows here though every estimate is right.
"""

from collections import deque
from math import inf, sqrt

_SPAN = 1.0  # [s] over which the error counts
_SHARE, _LEAST = 0.2, 0.5  # of the wanted force, and [N]: an error that is told ...
_RIGHT = 0.7  # ... until it is less than so much of that: one that comes and goes stays told
_NOISE = 4.0  # deviations of the estimated force
_IMAGES = 3  # in a row beyond the bound
_BUILDS = 0.7  # [s] that the force may take to be built up, or to follow another one that is wanted
_FALLS = 15.0  # [N/s] at which a force may fall to a smaller one that is wanted


class ForceWatch:
    """`update` with each image in contact, `clear` without.

    Attributes:
        warning: how far the force is off, '' while it is not.
        reason: why to hold, '' while nothing is wrong.
    """

    def __init__(self, most: float) -> None:
        """most: [N] by which the estimated force may be above the wanted one."""
        self._most = most
        self._errors: deque[tuple[float, float]] = deque(maxlen=2000)  # [s], [N^2] less the noise
        self.warning = self.reason = ""
        self._over = 0  # images in a row
        self._since: float | None = None  # [s] when contact began
        self._built = False
        self._wanted: deque[tuple[float, list[float]]] = deque()  # [s], [N] by direction: when the last ones came
        self._allowed: list[float] = []  # [N] by direction
        self._stamp = inf  # [s] of the image before

    def clear(self) -> None:
        """Contact is over, or the controller was enabled anew."""
        self._begin()
        self.reason, self._over, self._allowed, self._stamp = "", 0, [], inf

    def _begin(self) -> None:
        self._errors.clear()
        self._wanted.clear()
        self.warning, self._since, self._built = "", None, False

    def update(self, stamp: float, along: list[float], wanted: list[float], deviation: float, settled: bool) -> None:
        """Take in an image in contact.

        Args:
            along, wanted: estimated and wanted force along each direction [N]. deviation: of the estimate [N].
            settled: the force has been built up.
        """
        if stamp < self._stamp:  # the first, or the clock was set back
            self.clear()
            self._stamp = stamp
        if self._wanted and len(self._wanted[-1][1]) != len(wanted):  # another direction touches
            self._begin()
        if self._since is None:
            self._since = stamp
        errors = self._errors_of(stamp, along, wanted)
        fall, sizes = _FALLS * (stamp - self._stamp), [abs(w) for w in wanted]
        # What other directions bore before they were to carry force has to fall, too.
        before = self._allowed if len(self._allowed) == len(sizes) else [abs(f) for f in along]
        self._allowed = [max(w, a - fall) for w, a in zip(sizes, before, strict=True)]
        self._stamp = stamp
        over = max(
            (f if w > 0.0 else -f if w else abs(f)) - a for f, w, a in zip(along, wanted, self._allowed, strict=True)
        )
        self._over = self._over + 1 if over > max(self._most, _NOISE * deviation) else 0
        if self._over >= _IMAGES:
            self.reason = (
                f"the force is {over:.1f} N above the wanted one, more than max_excess_force = {self._most:g} N: "
                "something presses against the tool, or the surface moves"
            )
        self._built = self._built or settled or stamp - self._since > _BUILDS
        if not self._built:
            return
        self._errors.append((stamp, max(e * e for e in errors) - deviation * deviation))
        while stamp - self._errors[0][0] > _SPAN:
            self._errors.popleft()
        if stamp - self._errors[0][0] < 0.8 * _SPAN:
            return
        error = sqrt(max(sum(e for _, e in self._errors) / len(self._errors), 0.0))
        size = max(sizes)
        self.warning = (
            f"the force is off by {error:.1f} N (wanted {size:.1f} N): the surface moves, or is rougher than can be "
            "followed at this speed"
            if error > max(_SHARE * size, _LEAST) * (_RIGHT if self.warning else 1.0)
            else ""
        )

    def _errors_of(self, stamp: float, along: list[float], wanted: list[float]) -> list[float]:
        """[N] by direction: beyond all that was wanted lately, as streamed set-points change all the time."""
        if not self._wanted or wanted != self._wanted[-1][1]:
            self._wanted.append((stamp, wanted))
        while len(self._wanted) > 1 and self._wanted[1][0] <= stamp - _BUILDS:
            self._wanted.popleft()
        return [f - min(max(f, min(ws)), max(ws)) for f, *ws in zip(along, *(w for _, w in self._wanted), strict=True)]

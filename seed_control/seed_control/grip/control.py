# SPDX-License-Identifier: Apache-2.0
"""A grip that keeps the slip margin: it tightens at once, ahead of a load that rises, and relaxes slowly.

What is wanted of each finger is N = load x need / (1 - margin), the load foretold to when the gripper will have
answered, need and load with one standard deviation to the safe side. Whatever is missing or wrong, the grip is kept as
it is or tightened, never relaxed; `hold` says why the arm has to hold, too.
"""

from collections import deque
from math import exp, hypot, inf, isfinite, nan
from typing import NamedTuple

from seed_control.grip.margin import Margin
from seed_control.grip.settings import GripSettings

_TRUST, _TRUST_RATE = 0.7, 0.35  # gains of the filter of the load and of its rate, per image
_MEAN = 0.16  # [s] of the load that is there to stay
_FRAME = 0.022  # [s] between images, about
_MOST_AHEAD = 1.0  # by this share of itself a load is foretold to rise at most
_GAP = 0.2  # of 100 ms between images: longer ones tell no rate
_NEAR, _NEAR_SHARE = 0.4, 0.2  # [N], [1] within which a command counts as answered
_AT_AN_END = 2e-4  # [m] from min_width or max_width
_REST = 0.02  # share by which a need may fall short without being less
_SET_BACK = 0.5  # [s] by which time goes back only where a clock was set
_GIVEN_BACK = 0.05  # [s] in which a grip for a load that did not come decays by e
_FORCES = 200  # that were heard last: the images of a slip come later than they
_AFTER_SLIP = 1.3  # times the grip that let the tool slide


class GripCommand(NamedTuple):
    """What the gripper is to do.

    Attributes:
        force: [N] of each finger. width: [m]; not a number while no width was heard.
        hold: why the arm has to hold; '' for nothing.
    """

    force: float
    width: float
    hold: str


class GripControl:
    """One gripper. Feed `heard` and `image`, ask `command`; time is an argument.

    Attributes:
        wanted: [N] of each finger; not a number before the gripper was heard.
    """

    def __init__(self, settings: GripSettings) -> None:
        self.settings = settings
        self.wanted = nan
        self._width = self._force = nan
        self._heard = -inf  # [s]
        self._forces: deque[tuple[float, float]] = deque(maxlen=_FORCES)  # [s], [N]
        self._answered = inf  # [s] when the gripper was near the command last
        self._load = self._rate = self._mean = 0.0  # [N], [N/s], [N]
        self._stamp = -inf
        self._kept = 0.0  # [N] for loads that have come
        self._needed = self._relaxed = self._told = -inf  # [s] when so much was needed, it relaxed, images came last
        self._overload = ""
        self._sliding = False
        self._now = -inf  # [s]

    def _at(self, t: float) -> None:
        """It is t [s]; where the clock was set back, all that has happened counts as of now."""
        if t < self._now - _SET_BACK:
            self._heard, self._answered, self._needed, self._relaxed, self._told = (
                min(then, t) for then in (self._heard, self._answered, self._needed, self._relaxed, self._told)
            )
            self._now = t
            self._forces.clear()
        self._now = max(t, self._now)

    def heard(self, t: float, width: float, force: float) -> None:
        """What the gripper reports at t [s]: width [m] and push of each finger [N]."""
        self._at(t)
        if not (isfinite(width) and isfinite(force)):
            return
        self._width, self._force, self._heard = width, force, t
        self._forces.append((t, force))
        if not isfinite(self.wanted):
            self.wanted = self._kept = self._bounded(force)
        if abs(self.wanted - force) <= max(_NEAR, _NEAR_SHARE * self.wanted) or self._at_an_end():
            self._answered = t

    def rest(self, t: float) -> None:
        """Nothing is sent at t [s]: the grip is the one that was heard, and no answer is due."""
        self._at(t)
        if isfinite(self._force):
            self.wanted = self._kept = self._bounded(self._force)
            self._needed = self._answered = t

    def _at_an_end(self) -> bool:
        """Whether less grip is wanted, and the fingers open no further."""
        return self.wanted < self._force and self._width >= self.settings.max_width - _AT_AN_END

    def image(self, margin: Margin, t: float) -> None:
        """The margin of a new image, at time t [s]. Nothing is wanted before the gripper was heard."""
        self._at(t)
        if not isfinite(self.wanted):
            return
        if not all(map(isfinite, margin)):
            self._overload = "the load on the grasp is not known: see the covariance of relative_pose"
            return
        if margin.stamp < self._stamp - _SET_BACK:
            self._stamp = -inf
        s, dt = self.settings, margin.stamp - self._stamp
        wanted, kept = self.wanted, self._kept
        if 0.0 < dt < _GAP:
            off = margin.load - (self._load + self._rate * dt)
            self._load += self._rate * dt + _TRUST * off
            self._rate += _TRUST_RATE * off / dt
        elif dt > 0.0:
            self._load, self._rate = margin.load, 0.0
        self._stamp = max(margin.stamp, self._stamp)
        self._mean += (margin.load - self._mean) * min(max(dt, 0.0) / _MEAN, 1.0)
        load = max(self._load, 0.0)
        rises = max(self._rate - _TRUST_RATE * margin.load_deviation / _FRAME, 0.0)  # noise foretells nothing
        ahead = load + min(rises * (max(t - margin.stamp, 0.0) + s.latency), _MOST_AHEAD * max(load, 1.0))
        doubt = 1.0 + hypot(margin.load_deviation / max(load, 1.0), margin.need_deviation / margin.need)
        share = margin.need * doubt / (1.0 - s.margin)
        self._want(self._mean * share, t)
        self.wanted = max(self._kept, self._bounded(ahead * share), self._given_back(t))
        if t - self._heard > s.answer_time:
            self.wanted, self._kept = max(self.wanted, wanted), max(self._kept, kept)
        need = self._mean * margin.need * doubt
        most = s.max_force * (1.0 - 0.5 * s.margin)
        self._overload = "" if need <= most else (
            f"the grasp cannot bear what pulls at the tool: {load:.1f} N with a friction of {margin.friction:.2f} need "
            f"{need / (1.0 - s.margin):.1f} N of grip, max_force is {s.max_force:g} N; take load off, or grip a tool "
            "that is rougher or lighter"
        )  # fmt: skip

    def slipped(self, t: float, stamp: float) -> None:
        """The tool slides in an image of stamp [s], and nobody can tell the load: a third more grip than then."""
        self._at(t)
        if not self._sliding and isfinite(self._force):
            slid = next((force for then, force in reversed(self._forces) if then <= stamp), self._force)
            self._want(_AFTER_SLIP * max(slid, self.settings.least_force), t)
            self.wanted = max(self.wanted, self._kept)
        self._sliding = True

    def sticks(self) -> None:
        """The tool does not slide."""
        self._sliding = False

    def _want(self, grip: float, t: float) -> None:
        """The grip [N] that the present load needs: at once if it is more, slowly if it is less."""
        wanted = self._bounded(grip)
        if not wanted < self._kept * (1.0 - _REST):
            self._needed, self._kept = t, max(wanted, self._kept)
        elif t - self._needed > self.settings.relax_after and not self._sliding:
            dt = min(max(t - self._relaxed, 0.0), 0.1) if self._relaxed > self._needed else 0.0
            self._kept = max(wanted, self._kept * (1.0 - self.settings.relax_rate * dt))
        self._relaxed = t

    def _given_back(self, t: float) -> float:
        """What is left [N] of a grip for a load that was foretold and did not come."""
        dt, self._told = t - self._told, t
        return self.wanted * exp(-min(max(dt, 0.0), 1.0) / _GIVEN_BACK)

    def _bounded(self, grip: float) -> float:
        return min(max(grip, self.settings.least_force), self.settings.max_force)

    def command(self, t: float) -> GripCommand:
        """What to send at t [s], and whether the arm must hold."""
        self._at(t)
        s, width = self.settings, nan
        if isfinite(self.wanted):
            width = self._width - (self.wanted - self._force) / s.force_per_width
            width = min(max(width, s.min_width), s.max_width)
        return GripCommand(self.wanted, width, self._why_hold(t))

    def _why_hold(self, t: float) -> str:
        s = self.settings
        if not isfinite(self.wanted):
            return "the gripper was not heard yet: gripper/width and gripper/force are missing; start the gripper"
        if (silent := t - self._heard) > s.answer_time:
            return (
                f"the gripper does not answer: nothing of gripper/width and gripper/force for {silent:.1f} s, "
                f"{s.answer_time:g} s is the most; look at its power and its node"
            )
        if (late := t - self._answered) > s.answer_time:
            if self.wanted > self._force and self._width <= s.min_width + _AT_AN_END:
                return (
                    f"the fingers are {1e3 * self._width:.1f} mm apart and close no further (min_width is "
                    f"{1e3 * s.min_width:g} mm): they grip with {self._force:.1f} N where {self.wanted:.1f} N are "
                    "needed; take load off, or look whether the tool is still there"
                )
            return (
                f"the gripper does not follow: it grips with {self._force:.1f} N where {self.wanted:.1f} N were asked "
                f"for {late:.1f} s ago ({s.answer_time:g} s is the most); look at its force limit and its node"
            )
        return self._overload

# SPDX-License-Identifier: Apache-2.0
"""How far an approach may go along each force direction without reaching the force that is wanted there.

Gripper and tip are both kept within the bound. The gripper is known at each step, and may go further than a tool that
something stops. The tip is seen in the images; it goes further than the gripper where it lets go of what it rubbed on.
The way is kept while something else is followed: see left_way.py.
"""

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from math import copysign

from seed_control.command.left_way import LeftWay
from seed_control.law.contact import ForceShare
from seed_control.law.directions import SAME_DIRECTION
from seed_core.spatial import Array
from seed_core.vector3 import ZERO, Vector3, as_vector3, dot, minus, norm, plus_scaled

_REACHED = 0.7  # share of the wanted force from which on a rise shows that the way is not free: half, and the noise
_RISE = 0.1  # share by which it has to rise
_OVER = 0.2  # share below which contact is over, and a rise is to be seen anew
_PRESSES = 0.4  # share from which on something is in the way, and gives way
_TOO_MUCH = 1.2  # share from which on it goes back
_UNSEEN = 1.5e-3  # [m] of the tip's way that noise and lean as contact ended may hide
_RUBS = 1.0  # friction, at most, that a force across a direction may make along it
_FOLLOWS = 0.3  # share of a change of the tip's place that one image is believed
_SEEN = 0.25  # [s] by which the filtered force of an image may be older than the command
_LONG = 2.0  # [s] without the wanted force, which is told ...
_STAYS = 0.5, 0.7  # [s], and share of them, for which the force has to be there until that is over
_LEAST = 1e-3  # [m] of motion between steps that is a new start, not a motion
_IN_ALL = 2.0  # bounds, beyond what each direction may: so far along directions of before that are none now


class _Way:
    """Along one direction: where it began [m], how much of the force has been reached since, and where it is now."""

    def __init__(self, place: Vector3, along: Vector3, gone: float) -> None:
        """At a place [m], of which so much of the way [m] was gone before."""
        start = plus_scaled(place, -gone, along)
        self.starts = start, start  # the two ends of where the command was when the force was last there
        self.best, self.last, self.went, self.along = 0.0, place, ZERO, along  # went: [m] in the last step
        self.share = 0.0  # of the wanted force, in the last image
        self.touched = False  # the force has been there at all
        self.reached, self.stays = False, 0.0  # whether that is the wanted force, and for which part of `_STAYS` it was
        self.time = 0.0  # [s] without the wanted force: friction of a tip that slips reaches it for a moment
        self.tip: Vector3 | None = None  # [m] from the gripper to the tip, at the start
        self.deflection = 0.0  # [m] now, by what is in the way

    def begin(self, places: Sequence[Vector3], tip: Vector3) -> None:
        """From one of these places on the way is counted, with the tip there [m] as the gripper sees it."""
        along = partial(dot, self.along)
        self.starts = min(places, key=along), max(places, key=along)
        self.tip = tip

    def gone(self) -> float:
        """The way [m] so far."""
        return max((dot(self.along, minus(self.last, start)) for start in self.starts), key=abs)

    def wait(self, dt: float) -> None:
        """A step of dt [s] on."""
        self.stays += min(dt / _STAYS[0], 1.0) * (self.reached - self.stays)
        self.time = 0.0 if self.stays >= _STAYS[1] else self.time if self.reached else self.time + dt


class FreeTravel:
    """`image` with each image, `step` with each command.

    Attributes:
        warning: along which direction the force has not been reached for long; '' for none.
    """

    def __init__(self, bound: float, stopping: Callable[[float], float]) -> None:
        """bound: [m]. stopping: the way [m] in which the command comes to rest from a speed [m/s]."""
        self._bound, self._stopping = bound, stopping
        self._ways: list[_Way] = []
        self._left = LeftWay(bound)  # along directions that are none now
        self._place: Vector3 | None = None  # [m] of the command at the step before, which was ...
        self._own = True  # ... by a place that was asked for, where no force was wanted
        self._recent: deque[tuple[float, Vector3]] = deque([(0.0, ZERO)])  # [s] since the start, place
        self._tip: Vector3 | None = None  # [m] from the gripper to the tip: by the images, and ...
        self._relaxed = ZERO  # [m] ... where nothing touches it
        self.warning = ""

    def restart(self) -> None:
        """Every direction is to be counted from where the command is next."""
        self._ways, self._place, self.warning = [], None, ""
        self._left.forget()
        self._recent.clear()

    def image(self, shares: Sequence[ForceShare], p_Ctip: Vector3, relaxed: Vector3) -> None:
        """Take in an image.

        The gripper is further than a tool that something stops. A tool that rubs lags as well, but is not stopped: it
        may come after at any time, so that what friction can explain is no part of what the gripper may go further.

        Args:
            shares: of the wanted force that the filtered estimate has, by direction.
            p_Ctip: [m] from the gripper to the tip, in W. relaxed: where that is while nothing touches the tool.
        """
        tip = self._tip or p_Ctip
        self._tip, self._relaxed = plus_scaled(tip, _FOLLOWS, minus(p_Ctip, tip)), relaxed
        if len(shares) != len(self._ways) or not self._recent:
            self._leave()
            return
        for way, (share, there, whole, rubs, touches) in zip(self._ways, shares, strict=True):
            way.share = share
            way.tip = way.tip or self._tip  # enabled while it rubs, the tool lags already
            way.deflection = min(max(share - _RUBS * rubs, 0.0), _REACHED) * whole
            if share < _OVER:
                way.best = 0.0
            risen = share >= _REACHED and share > way.best + _RISE
            if risen:
                way.best = share
            # Below 0.6 N no force at all is near the wanted one, and noise may be a small one.
            way.reached = touches and (risen or (there and share >= _REACHED))
            way.touched |= way.reached
            if way.reached:
                way.begin([place for _, place in self._recent], self._tip)
                self._left.forget()

    def _leave(self) -> None:
        """Nothing goes on along the directions of before: what was gone along them is kept."""
        gone = self._left.gone
        for way in self._ways:
            gone = plus_scaled(gone, way.gone(), way.along)
        if self._ways:
            self._left.leave(gone)
        self._ways = []
        self._recent.clear()

    def step(self, p_WC: Vector3, normals: Array, dt: float, own: bool = True) -> str:
        """Take in the commanded position [m] after a step of dt [s]; why to hold, '' for nothing.

        Args:
            normals: (m, 3) the directions along which a force is wanted.
            own: where no force is wanted it goes to a place that was asked for.
        """
        # The step before was one of what was followed then: across its force directions, to a place asked for.
        across = minus(p_WC, self._place or p_WC)
        for way in self._ways:
            way.went, way.last = minus(p_WC, way.last), p_WC
            across = plus_scaled(across, -dot(way.along, across), way.along)
        if self._own:
            self._left.move(across, dt)
        self._place, self._own = p_WC, own
        if len(self._ways) != len(normals) or any(
            dot(way.along, as_vector3(n)) ** 2 < SAME_DIRECTION for way, n in zip(self._ways, normals, strict=True)
        ):
            self._leave()
            for n in map(as_vector3, normals):
                before = dot(n, self._left.gone)
                self._ways.append(_Way(p_WC, n, before))
                self._left.leave(plus_scaled(self._left.gone, -before, n))
        now = self._recent[-1][0] + dt if self._recent else 0.0
        self._recent.append((now, p_WC))
        while now - self._recent[0][0] > _SEEN:
            self._recent.popleft()
        self.warning = ""
        if self._ways and norm(self._left.gone) > _IN_ALL * self._bound:
            return self._reason("all directions together", self._ways[0])
        for n, way in zip(normals, self._ways, strict=True):
            way.along = along = as_vector3(n)
            moved = dot(along, way.went)
            speed = 0.0 if abs(moved) > _LEAST else moved / dt
            ahead = 0.0 if not speed else speed * dt + copysign(self._stopping(abs(speed)) + _UNSEEN, speed)
            gone = [dot(along, minus(p_WC, start)) for start in way.starts]
            reached = [*gone, *(g + ahead for g in gone)]  # now, and at rest after a step more
            tip = lets_go = 0.0  # [m] by which the tip has gone further than the gripper, and will if it lets go
            if way.tip and self._tip:
                tip, lets_go = (dot(along, minus(p, way.tip)) for p in (self._tip, self._relaxed))
            bound, pressed = self._bound, self._bound + way.deflection
            if not all(abs(g + lets_go) <= pressed and abs(g + tip) <= bound for g in reached):  # nor what is no number
                return self._reason(f"{_words(along)} of the base", way)
            way.wait(dt)
            if way.time > _LONG:
                self.warning = (
                    f"the wanted force along {_words(along)} of the base has not been reached for {way.time:.0f} s and "
                    f"{1e3 * max(map(abs, gone)):.0f} mm"
                )
        return ""

    def _reason(self, along: str, way: _Way) -> str:
        """Why to hold at the bound."""
        share = way.share
        bound = f"max_free_travel = {1e3 * self._bound:.0f} mm along {along}"
        if share < _PRESSES and way.touched:
            return f"contact is lost, and there is none within {bound}: the surface has ended or fallen away"
        if share < _PRESSES:
            start = "start nearer to the surface, or check the force's sign (what the tool does to it) and the estimate"
            return f"no contact within {bound}: {start}"
        if share > _TOO_MUCH:
            return (
                f"the force stays at {share:.0%} of the wanted one though the gripper gave way over {bound}: poses are "
                "wrong, or the surface follows: initialize the grasp free of load"
            )
        return (
            f"the force stays at {share:.0%} of the wanted one over {bound}: the tool slides in the grasp, or the "
            "surface gives way: grip more firmly, or ask for less force"
        )


def _words(n: Vector3) -> str:
    return f"({n[0]:.2f}, {n[1]:.2f}, {n[2]:.2f})"

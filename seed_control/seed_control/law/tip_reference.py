# SPDX-License-Identifier: Apache-2.0
"""The gripper's wanted place at every step between two images: along the path, and with bounded speed along forces."""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

from seed_control.command.limiter import AT_REST
from seed_control.law.force_change import ForceChange
from seed_core.spatial import Array
from seed_core.vector3 import ZERO, Vector3, as_vector3, dot, minus, plus, plus_scaled

_SLOWEST = 1e-3  # [m/s]


class HeightReference(NamedTuple):
    """Along one force direction: wanted height of the undeflected tip, and the bounds on its speed.

    Attributes:
        normal: the direction, in W.
        offset, gradient: with the tip's wanted place, height = offset + gradient . tip [m].
        speed: [m/s], at most.
        reach: [m] that may be covered within one loop time.
        back: [m/s], at most, against the force that is wanted; no less than `speed`.
        pushes: 1 where the force is wanted along the normal, -1 against it, 0 where none is.
        rate: [m/s] at which the wanted height rises since the newest image came.
        deflection: [m] of the grasp along the normal that the wanted force needs.
        change: how a change of that goes; None: as any other motion.
        quick: [m/s] at which such a change may press further; it is taken back at `back`.
    """

    normal: Vector3
    offset: float
    gradient: Vector3
    speed: float
    reach: float = inf
    back: float = 0.0
    pushes: int = 0
    rate: float = 0.0
    deflection: float = 0.0
    change: ForceChange | None = None
    quick: float = 0.0


class TipReference:
    """Moves the undeflected tip along its height references; elsewhere it follows the path.

    Attributes:
        undeflected: commanded place of the tip if the grasp were not deflected [m].
        known: the part of its motion that a change of the wanted force has brought.
    """

    def __init__(self) -> None:
        self.known = AT_REST
        self.undeflected = self._to_undeflected = self._lever = ZERO
        self._tip = self._velocity = ZERO
        self._references: Sequence[HeightReference] = ()
        self._since = 0.0  # [s] since the newest image

    def lead(self, X_W_tip: Array, velocity: Array) -> None:
        """Where the path is now: wanted tip (4, 4), and its velocity (3,) [m/s], in W."""
        self._tip, self._velocity = as_vector3(X_W_tip[:3, 3]), as_vector3(velocity)

    def renew(self) -> None:
        """An image has come, from which on rates count."""
        self._since = 0.0

    def follow(self, references: Sequence[HeightReference], lever: Vector3, to_undeflected: Vector3) -> None:
        """What an image settles: a height reference per force direction, and the grasp.

        Args:
            lever: from T's origin to the tip, in W [m].
            to_undeflected: from the wanted tip to the undeflected one, by the deflection that is fed forward [m].
        """
        self._references, self._lever, self._to_undeflected = references, lever, to_undeflected

    def change(self, references: Sequence[HeightReference], lever: Vector3, to_undeflected: Vector3) -> None:
        """Follow these for another wanted force, with the surface as it was; other words as in `follow`."""
        for old, new in zip(self._references, references, strict=False):
            if new.change is not None and old.change is new.change and old.pushes * new.pushes > 0:
                new.change.left += new.deflection - old.deflection
        self.follow(references, lever, to_undeflected)

    def _changed(self, dt: float) -> Vector3:
        """Step [m] of dt [s] by changes of the wanted force, renewing what is known of the motion."""
        step, (v, a) = ZERO, AT_REST
        for r in self._references:
            change = r.change
            if change is not None and (change.left or change.v):
                before = change.v
                went = change.advance(dt, r.quick if r.pushes * change.left > 0.0 else r.back)
                step, v, a = (plus_scaled(x, y, r.normal) for x, y in ((step, went), (v, before), (a, change.a)))
        self.known = AT_REST if step is ZERO else (v, a)
        return step

    def target(self, dt: float, lead: float, loop_time: float, commanded: Vector3) -> Vector3:
        """Wanted gripper position p_WC [m] for this step of dt [s].

        A retreat that the limits have not let the command make need not be made good when the force is wanted again:
        the bound on pressing counts from where the command is.

        Args:
            lead: [s] by which the arm trails its command.
            loop_time: [s] from an image to the arm's answer, which bounds the approach.
            commanded: the gripper's place p_WC [m] that the limits have let it reach.
        """
        tip = plus_scaled(self._tip, lead, self._velocity)
        path = goal = plus(tip, self._to_undeflected)
        changed = self._changed(dt)
        for n, offset, gradient, speed, reach, back, pushes, rate, _, change, quick in self._references:
            going = dot(n, changed)
            now = dot(n, self.undeflected) + going
            bound = min(speed, max(reach / loop_time, _SLOWEST)) * dt
            retreat = max(bound, back * dt)
            if change is not None and pushes * going > 0.0:  # the rest waits: together they press on at `quick`
                gains = pushes * change.a > 0.0
                bound = min(bound, 0.0 if gains else max(quick * dt - pushes * going, 0.0))
            low, high = (retreat if pushes > 0 else bound), (retreat if pushes < 0 else bound)
            wanted = offset + dot(gradient, tip) + rate * self._since - (change.left if change is not None else 0.0)
            if pushes:
                ahead = pushes * (dot(n, commanded) + dot(n, self._lever) - now)
                now += pushes * min(max(ahead, 0.0), max(pushes * (wanted - now), 0.0))
            step = min(max(wanted - now, -low), high)
            goal = plus_scaled(goal, now + step - dot(n, path), n)
        self._since += dt
        self.undeflected = goal
        return minus(goal, self._lever)

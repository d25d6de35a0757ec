# SPDX-License-Identifier: Apache-2.0
"""What is sent to the arm: a flange pose that starts where the arm is and moves within the limits."""

from math import isfinite

import numpy as np

from seed_control.command.arm_follows import Behind, RecentSpeed
from seed_control.command.limiter import AT_REST, Motion, PoseLimiter, VectorLimiter
from seed_control.parameters import ControllerParameters
from seed_core.arm.quaternion import IDENTITY, Quaternion, as_quaternion, to_pose, turn_between
from seed_core.spatial import Array
from seed_core.vector3 import Vector3, as_vector3, minus, norm, transformed

BANDWIDTH = 80.0  # [rad/s] of the smoothing
TRAIL = 2.0 / BANDWIDTH  # [s] by which a smoothed command trails in steady motion
_RESTS = 2e-3  # [m], [rad]; an arm this near to the command is where it was sent

_FORGET = 2.0  # [s] of motion, for the estimate of the lag
_GUESS = 0.05**2 * 0.2  # [m^2/s]; its first guess weighs as much as 0.2 s at 50 mm/s
_STILL = 2e-3  # [m/s]; slower motion says nothing


class FlangeCommand:
    """The commanded pose. Targets are given for the gripper's frame C, whose origin is what moves smoothly.

    Limiting the flange's position and rotation apart would swing C.
    """

    def __init__(self, parameters: ControllerParameters, X_EC: Array) -> None:
        p = parameters
        self._R_CE, self._p_EC = X_EC[:3, :3].T.copy(), as_vector3(X_EC[:3, 3])
        self._limiter = PoseLimiter(
            VectorLimiter(p.max_speed, p.max_acceleration, p.max_jerk, BANDWIDTH),
            VectorLimiter(p.max_angular_speed, p.max_angular_acceleration, p.max_angular_jerk, BANDWIDTH),
            self._p_EC,
        )
        self._workspace = Workspace(p, self._p_EC)
        self._lag, self._recent = LagEstimate(p.servo_lag), RecentSpeed()
        self._q_WE = IDENTITY  # wanted
        self.started = False

    @property
    def X_WE(self) -> Array:
        """The commanded flange pose (4, 4), a copy."""
        return self._limiter.pose

    @property
    def p_WC(self) -> Vector3:
        """Where the command has C [m]."""
        return self._limiter.p

    @property
    def q_WE(self) -> Quaternion:
        """The commanded rotation of the flange."""
        return self._limiter.q

    @property
    def lead(self) -> float:
        """By how long the arm trails what is asked for [s]: its own lag, and the smoothing."""
        return self._lag.lag + TRAIL

    def start_from(self, X_WE: Array) -> None:
        """Start at the arm's pose (4, 4); a command that the arm follows stays, and comes to rest as it would."""
        if not self.started or self.behind(X_WE).beyond(_RESTS, _RESTS):
            self._limiter.reset(X_WE)
        self.started = True

    def behind(self, X_WE: Array) -> Behind:
        """How far the arm's pose (4, 4) is from the command, and how much of that is its trailing."""
        place = transformed(X_WE.tolist(), self._p_EC)
        turn = turn_between(self._limiter.q, as_quaternion(X_WE[:3, :3]))
        return Behind(place, norm(minus(self._limiter.p, place)), norm(turn), *self._recent.way(self.lead))

    def stopping(self, speed: float) -> float:
        """Way [m], at most, in which the gripper comes to rest from a speed [m/s]."""
        return self._limiter.linear.stopping(speed)

    def turning(self, speed: float) -> float:
        """Turn [rad], at most, in which it comes to rest from a speed [rad/s]."""
        return self._limiter.angular.stopping(speed)

    def set_speeds(self, linear: float, angular: float) -> None:
        """Other bounds [m/s], [rad/s] from now on; a faster command brakes within its acceleration."""
        self._limiter.linear.speed, self._limiter.angular.speed = linear, angular

    def turn_to(self, R_WC: Array) -> None:
        """Wanted rotation (3, 3) of the gripper from now on."""
        self._q_WE = as_quaternion(R_WC @ self._R_CE)

    def accepts(self, p_WC: Vector3) -> bool:
        """Whether this place of C [m], and the rotation last asked for, are numbers at all."""
        return isfinite(sum(p_WC) + sum(self._q_WE))

    def stop(self, dt: float) -> None:
        """One step of dt [s] of coming to rest."""
        self._limiter.stop(dt)
        self._moved(dt)

    def give_way(self, p_WC: Vector3, dt: float, speed: float) -> None:
        """One step of dt [s] towards a place of C [m] while it holds: it turns no more, whatever a law asks for."""
        self._limiter.shift(self._workspace.within(p_WC, self._limiter.q), dt, speed)
        self._moved(dt)

    def _moved(self, dt: float) -> None:
        self._recent.update(self._limiter.linear.v, self._limiter.angular.v, self.lead, dt)

    def compare(self, X_WE: Array, dt: float) -> None:
        """Learn from where the arm is (4, 4), a step of dt [s] later, how far it trails."""
        self._lag.update(self._limiter.p, transformed(X_WE.tolist(), self._p_EC), self._limiter.linear.v, dt)

    def towards(self, p_WC: Vector3, dt: float, speed: float, known: Motion = AT_REST) -> tuple[str, ...]:
        """One step of dt [s] towards a place of C [m], at most at speed [m/s]; names the limits that it met.

        known: part of the place's motion that is no noise, and need not be smoothed.
        """
        limiter = self._limiter
        inside = self._workspace.within(p_WC, self._q_WE)
        inside = self._workspace.within(inside, limiter.q)  # on the way there, too: a turn takes longer than a move
        limiter.advance(inside, self._q_WE, dt, speed, known if inside is p_WC else AT_REST)
        self._moved(dt)
        met: tuple[str, ...] = () if inside is p_WC else ("workspace",)
        if limiter.linear.limited:
            met += ("max_speed",)
        if limiter.angular.limited:
            met += ("max_angular_speed",)
        return met


class Workspace:
    """The box that the flange must not leave, for targets of the gripper's frame C; p_EC [m]: C in the flange."""

    def __init__(self, parameters: ControllerParameters, p_EC: Vector3) -> None:
        self._low, self._high = np.array(parameters.workspace_low), np.array(parameters.workspace_high)
        self._p_EC = p_EC
        margin = float(np.linalg.norm(p_EC))  # no rotation takes the flange further from C than this
        self._surely = (*as_vector3(self._low + margin), *as_vector3(self._high - margin))

    def within(self, p_WC: Vector3, q_WE: Quaternion) -> Vector3:
        """The target [m] itself (the same object) while the flange stays inside, else the nearest that keeps it."""
        (x, y, z), (a, b, c, d, e, f) = p_WC, self._surely
        if a <= x <= d and b <= y <= e and c <= z <= f:
            return p_WC
        p_WE = to_pose(p_WC, q_WE, self._p_EC)[:3, 3]
        inside = np.clip(p_WE, self._low, self._high)
        return p_WC if np.array_equal(inside, p_WE) else as_vector3(np.array(p_WC) + inside - p_WE)


class LagEstimate:
    """How far the arm trails its command: regression of command minus measured position on velocity; `lag` [s]."""

    def __init__(self, guess: float) -> None:
        self._top, self._bottom = guess * _GUESS, _GUESS
        self.lag = guess

    def update(self, command: Vector3, measured: Vector3, velocity: Vector3, dt: float) -> None:
        """One step: commanded and measured position [m], velocity of the command [m/s]."""
        (u, v, w), (a, b, c), (x, y, z) = velocity, command, measured
        square = u * u + v * v + w * w
        if square < _STILL * _STILL:
            return
        keep = 1.0 - min(square / 0.05**2, 1.0) * dt / _FORGET
        self._top = keep * self._top + dt * ((a - x) * u + (b - y) * v + (c - z) * w)
        self._bottom = keep * self._bottom + dt * square
        self.lag = min(max(self._top / self._bottom, 0.0), 0.3)

# SPDX-License-Identifier: Apache-2.0
"""A position-controlled arm: dead time, first-order lag, and an error of repeatability that it does not report."""

from collections import deque
from math import exp, pi, sin

import numpy as np

from seed_core.spatial import Array, make_pose, so3_exp, so3_log
from seed_sim.scenario import ServoSection
from seed_ur.kinematics import KinematicsError, URKinematics

ELBOW_UP = (pi, -1.7, 1.9, -1.8, -0.5 * pi, 0.0)  # a UR in front of its table
_MAX_JOINT_SPEED = 3.14  # [rad/s]
_RATES = (0.05, 0.5)  # [Hz] range of the frequencies of the repeatability error
_SINES = 4
_ARRIVED = 1e-24  # [rad^2] below which a rotation is at its end
_ZERO = np.zeros(3)


class Repeatability:
    """A slow, smooth error (3,) [m] that never leaves +-bound on any axis: a few sines of random rate and phase."""

    def __init__(self, bound: float, rng: np.random.Generator) -> None:
        self._amplitude = bound / _SINES
        rates = 2.0 * pi * rng.uniform(*_RATES, (3, _SINES))
        phases = rng.uniform(0.0, 2.0 * pi, (3, _SINES))
        self._sines = [list(zip(r, p, strict=True)) for r, p in zip(rates.tolist(), phases.tolist(), strict=True)]

    def at(self, t: float) -> Array:
        """The error at time t [s]."""
        if self._amplitude == 0.0:
            return np.zeros(3)
        return np.array([self._amplitude * sum([sin(w * t + phase) for w, phase in axis]) for axis in self._sines])


class MovingTable(Repeatability):
    """A table that moves up and down, seen from the table: what counts is where the tool is over it."""

    def __init__(self, error: Repeatability, amplitude: float, frequency: float, since: float) -> None:
        """amplitude [m], downwards first where it is negative; frequency [Hz]; since [s]."""
        self._error = error
        self._amplitude, self._rate, self._since = amplitude, 2.0 * pi * frequency, since

    def at(self, t: float) -> Array:
        """The error at time t [s]."""
        out = self._error.at(t)
        if t > self._since:
            out = out - (0.0, 0.0, self._amplitude * sin(self._rate * (t - self._since)))
        return out


class Arm:
    """Flange pose by time. `command` a target, `advance` by a step, read `reported` and `actual`.

    Attributes:
        error: of the flange's place, which it does not report.
        holds: it stays where it is, whatever it is sent.
    """

    def __init__(self, servo: ServoSection, X_WE: Array, rng: np.random.Generator) -> None:
        self.servo = servo
        self._queue: deque[tuple[float, Array]] = deque()
        self._kinematics = None if servo.arm == "cartesian" else URKinematics.for_model(servo.arm)
        self.error = Repeatability(1e-3 * servo.repeatability, rng)
        self.holds = False
        self._step = (0.0, 1.0)  # length of the last step [s], and the share of the way that it makes
        self.reset(X_WE)

    def reset(self, X_WE: Array) -> None:
        """Rest at X_WE (4, 4). Raises KinematicsError when it is out of reach."""
        self.reported = X_WE.copy()
        self._target = self.reported
        self._remaining = np.zeros(3)  # rotation vector from the target to where it is, in the target's axes
        self.rotation_step = np.zeros(3)  # rotation vector of the last step, in the world
        self._queue.clear()
        self._error = self.error.at(0.0)
        self.q = self._kinematics.inverse(X_WE, ELBOW_UP) if self._kinematics else np.zeros(0)
        self._q_target = self.q.copy()
        self.unreachable = 0  # commands that were not followed

    def command(self, t: float, X_WE: Array) -> None:
        """Target X_WE (4, 4), sent at time t [s]."""
        if not self.holds:
            self._queue.append((t + self.servo.dead_time, X_WE))

    def advance(self, t: float, dt: float) -> None:
        """Go to time t [s], a step of dt [s]."""
        while self._queue and self._queue[0][0] <= t:
            self._accept(self._queue.popleft()[1])
        if self._step[0] != dt:
            self._step = (dt, 1.0 - exp(-dt / self.servo.lag) if self.servo.lag > 0.0 else 1.0)
        if self._kinematics:
            self._follow_joints(self._step[1], dt)
        else:
            self._follow_pose(self._step[1])
        self.wander(t)

    def wander(self, t: float) -> None:
        """Renew the error of repeatability at t [s]; by itself where the arm is driven from outside."""
        self._error = self.error.at(t)

    def _accept(self, X_WE: Array) -> None:
        self._target = X_WE
        if not self._kinematics:
            self._remaining = so3_log(X_WE[:3, :3].T @ self.reported[:3, :3])
        else:
            try:
                self._q_target = np.array(self._kinematics.follow(X_WE, self._q_target.tolist()))
            except KinematicsError:
                self.unreachable += 1

    def _follow_pose(self, share: float) -> None:
        R_target, p = self._target[:3, :3], self.reported[:3, 3]
        if float(self._remaining @ self._remaining) > _ARRIVED:
            self.rotation_step = -share * (R_target @ self._remaining)
            self._remaining = (1.0 - share) * self._remaining
            R = R_target @ so3_exp(self._remaining)
        else:
            self.rotation_step, R = _ZERO, R_target
        self.reported = make_pose(R, p + share * (self._target[:3, 3] - p))

    def _follow_joints(self, share: float, dt: float) -> None:
        assert self._kinematics is not None
        bound = _MAX_JOINT_SPEED * dt
        self.q = self.q + np.clip(share * (self._q_target - self.q), -bound, bound)
        before, self.reported = self.reported, self._kinematics.forward(self.q)
        self.rotation_step = so3_log(self.reported[:3, :3] @ before[:3, :3].T)

    @property
    def actual(self) -> Array:
        """Where the flange really is: the reported pose and the repeatability error."""
        X = self.reported.copy()
        X[:3, 3] += self._error
        return X

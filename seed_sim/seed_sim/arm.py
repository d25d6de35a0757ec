# SPDX-License-Identifier: Apache-2.0
"""A position-controlled arm: dead time, first-order lag, and an error of repeatability that nobody reports."""

from __future__ import annotations

from collections import deque
from math import exp, sqrt

import numpy as np

from seed_core.spatial import Array, make_pose, so3_exp, so3_log
from seed_core.ur_kinematics import KinematicsError, URKinematics
from seed_sim.scenario import ServoSection

_DRIFT_TIME = 1.0  # [s] over which the repeatability error wanders
_MAX_JOINT_SPEED = 3.14  # [rad/s]


class Arm:
    """Flange pose by time. `command` a target, `advance` by a step, read `reported` and `actual`."""

    def __init__(self, servo: ServoSection, X_WE: Array, rng: np.random.Generator) -> None:
        self.servo = servo
        self._rng = rng
        self._queue: deque[tuple[float, Array]] = deque()
        self._kinematics = None if servo.arm == "cartesian" else URKinematics.for_model(servo.arm)
        self._sigma = 1e-3 * servo.repeatability
        self.reset(X_WE)

    def reset(self, X_WE: Array) -> None:
        """Rest at X_WE (4, 4)."""
        self.reported = X_WE.copy()
        self._target = X_WE.copy()
        self._queue.clear()
        self._error = self._sigma * self._rng.standard_normal(3)
        self.q = self._inverse(X_WE) if self._kinematics else np.zeros(0)
        self._q_target = self.q.copy()

    def command(self, t: float, X_WE: Array) -> None:
        """Target X_WE (4, 4), sent at time t [s]."""
        self._queue.append((t + self.servo.dead_time, X_WE))

    def advance(self, t: float, dt: float) -> None:
        """Go to time t [s], a step of dt [s]."""
        while self._queue and self._queue[0][0] <= t:
            self._target = self._queue.popleft()[1]
            if self._kinematics:
                self._q_target = self._inverse(self._target)
        share = 1.0 - exp(-dt / self.servo.lag) if self.servo.lag > 0.0 else 1.0
        if self._kinematics:
            step = share * (self._q_target - self.q)
            bound = _MAX_JOINT_SPEED * dt
            self.q = self.q + np.clip(step, -bound, bound)
            self.reported = self._kinematics.forward(self.q)
        else:
            R = self.reported[:3, :3]
            turn = so3_exp(share * so3_log(R.T @ self._target[:3, :3]))
            p = self.reported[:3, 3]
            self.reported = make_pose(R @ turn, p + share * (self._target[:3, 3] - p))
        keep = exp(-dt / _DRIFT_TIME)
        self._error = keep * self._error + self._sigma * sqrt(1.0 - keep * keep) * self._rng.standard_normal(3)

    @property
    def actual(self) -> Array:
        """Where the flange really is: the reported pose and the repeatability error."""
        X = self.reported.copy()
        X[:3, 3] += self._error
        return X

    def _inverse(self, X_WE: Array) -> Array:
        assert self._kinematics is not None
        near = getattr(self, "_q_target", None)
        near = near if near is not None and len(near) else np.array((0.0, -1.6, 1.8, -1.8, -1.57, 0.0))
        try:
            return np.asarray(self._kinematics.inverse(X_WE, near=near), dtype=float)
        except KinematicsError:
            if getattr(self, "_q_target", None) is None or not len(self._q_target):
                raise
            return np.asarray(self._q_target)  # an unreachable target is not followed

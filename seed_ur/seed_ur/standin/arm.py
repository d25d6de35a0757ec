# SPDX-License-Identifier: Apache-2.0
"""The mechanical part of the stand-in: six joints that follow one motion at a time, stepped at 500 Hz.

The servo model is plausible, not identified: per joint a critically damped second-order follower with
wn = 2 / lookahead * sqrt(gain / 300), limited to the joint's speed and to 40 rad/s^2, then a 6 ms lag from target
to actual position. A robot that is scaled down (speed slider, safety limits) does all that in a time that passes more
slowly, and looks for a new goal when the time of its last servoj is over: at 1 % every 0.2 s.
Frames: W is `base`; poses given by programs are of the TCP.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, hypot, isfinite, sqrt
from typing import Protocol

import numpy as np

from seed_core.spatial import Array, interpolate_pose, inverse_pose
from seed_ur.kinematics import KinematicsError, URKinematics
from seed_ur.pose import Pose6, matrix_from_pose, pose_from_matrix
from seed_ur.standin.options import PERIOD

JOINT_ACCELERATION = 40.0  # [rad/s^2] largest that the stand-in does
LAG = 0.006  # [s] target to actual
BRAKE = 20.0  # [rad/s^2] deceleration of a protective or emergency stop
PROGRAM_END_BRAKE = 10.0  # [rad/s^2] deceleration when a program ends while the arm moves


class Motion(Protocol):
    """What decides the joints' acceleration; `done` when nothing is left to do."""

    done: bool

    def velocity(self, arm: Arm, dt: float) -> list[float]:
        """Wanted target joint speeds (6,) [rad/s] after the next `dt` seconds."""


class Hold:
    """Slow down at a given rate and stay."""

    def __init__(self, deceleration: float = PROGRAM_END_BRAKE) -> None:
        self.deceleration = max(0.1, deceleration)
        self.done = False

    def velocity(self, arm: Arm, dt: float) -> list[float]:
        fastest = max(abs(v) for v in arm.target_qd)
        keep = max(0.0, 1.0 - self.deceleration * dt / fastest) if fastest > 0.0 else 0.0
        out = [v * keep for v in arm.target_qd]
        self.done = not any(out)
        return out


class Servo:
    """Follow a joint goal as servoj does."""

    def __init__(self, goal: Sequence[float], lookahead: float, gain: float) -> None:
        self.done = False
        self.take(goal, lookahead, gain)
        self._followed, self._left = self.goal, 0.0  # [s] of this servoj
        self._qd: list[float] | None = None  # [rad/s] target speeds by the time of the motion, which is scaled

    def take(self, goal: Sequence[float], lookahead: float, gain: float) -> None:
        """A newer goal; the last one is followed until the time of its servoj is over."""
        self.goal = list(goal)
        self.rate = 2.0 / max(0.03, lookahead) * sqrt(max(1.0, gain) / 300.0)  # [1/s]

    def velocity(self, arm: Arm, dt: float) -> list[float]:
        wn, scaling, out = self.rate, arm.scaling, []
        dt *= scaling
        if self._qd is None:
            self._qd = [v / max(scaling, 0.01) for v in arm.target_qd]
        if self._left <= 1e-9:
            self._followed, self._left = self.goal, self._left + PERIOD
        self._left -= dt
        state = zip(self._followed, arm.target_q, self._qd, arm.kinematics.model.speed, strict=True)
        for goal, q, v, limit in state:
            a = wn * wn * (goal - q) - 2.0 * wn * v
            a = max(-JOINT_ACCELERATION, min(JOINT_ACCELERATION, a))
            out.append(max(-limit, min(limit, v + a * dt)))
        self._qd = out
        return [scaling * v for v in out]


class Speed:
    """Approach given joint speeds, or the joint speeds of a given TCP velocity, with an acceleration limit."""

    def __init__(self, speed: Sequence[float], acceleration: float, duration: float, cartesian: bool) -> None:
        self.speed, self.cartesian, self.done = list(speed), cartesian, False
        self.acceleration = acceleration * (3.0 if cartesian else 1.0)  # [rad/s^2] coarse for tool accelerations
        self.left = duration if duration > 0.0 else float("inf")

    def velocity(self, arm: Arm, dt: float) -> list[float]:
        self.left -= dt
        self.done = self.left <= 0.0
        goal = arm.joint_speed_of(self.speed) if self.cartesian else self.speed
        step = self.acceleration * dt
        pairs = zip(goal, arm.target_qd, strict=True)
        return [v + max(-step, min(step, g * arm.scaling - v)) for g, v in pairs]


class Move:
    """Move along a straight line, in joints or in space, with a trapezoid of speed."""

    def __init__(self, arm: Arm, goal: Sequence[float], speed: float, acceleration: float, cartesian: bool) -> None:
        self.cartesian, self.done, self.time = cartesian, False, 0.0
        self.start, self.goal = list(arm.target_q), list(goal)
        if cartesian:
            self._X_start, self._X_goal = matrix_from_pose(arm.target_tcp_pose()), matrix_from_pose(goal)
            x, y, z, *turn = pose_from_matrix(inverse_pose(self._X_start) @ self._X_goal)
            self.length = max(hypot(x, y, z), 0.3 * hypot(*turn), 1e-9)
        else:
            self.length = max(max(abs(b - a) for a, b in zip(self.start, self.goal, strict=True)), 1e-9)
        self.acceleration = max(1e-3, acceleration)
        self.top = min(max(1e-3, speed), sqrt(self.acceleration * self.length))
        self.duration = self.length / self.top + self.top / self.acceleration

    def _share(self, t: float) -> float:
        """Share of the way after t seconds."""
        ramp = self.top / self.acceleration
        if t >= self.duration:
            return 1.0
        if t < ramp:
            return 0.5 * self.acceleration * t * t / self.length
        if t > self.duration - ramp:
            return 1.0 - 0.5 * self.acceleration * (self.duration - t) ** 2 / self.length
        return (self.top * (t - 0.5 * ramp)) / self.length

    def velocity(self, arm: Arm, dt: float) -> list[float]:
        self.time += dt * arm.scaling
        share = self._share(self.time)
        self.done = self.time >= self.duration
        if self.cartesian:
            goal: Sequence[float] = arm.inverse_of(interpolate_pose(self._X_start, self._X_goal, share), arm.target_q)
        else:
            goal = [a + share * (b - a) for a, b in zip(self.start, self.goal, strict=True)]
        return [(g - q) / dt for g, q in zip(goal, arm.target_q, strict=True)]


class Arm:
    """Joint state of the stand-in and the motion that drives it."""

    def __init__(self, kinematics: URKinematics, q: Sequence[float]) -> None:
        self.kinematics = kinematics
        self.q, self.target_q = list(map(float, q)), list(map(float, q))  # [rad]
        self.qd, self.target_qd, self.target_qdd = [0.0] * 6, [0.0] * 6, [0.0] * 6
        self.motion: Motion = Hold()
        self.slider = 1.0  # 0..1, speed slider of the pendant
        self.error = 0.0  # [rad] by which friction and load hold every joint off its target
        self.limiting = 1.0  # 0..1, what the controller scales by of itself, e.g. for a safety limit
        self.set_tcp(np.eye(4))
        self.X_WE = kinematics.forward(self.q)
        self._target_pose: Pose6 | None = None

    @property
    def scaling(self) -> float:
        """How fast the time of servoed and planned motions passes, 0..1."""
        return self.slider * self.limiting

    def step(self, dt: float) -> None:
        """Advance by dt seconds; raises KinematicsError when a straight move leaves the reach."""
        before = self.target_qd
        self.target_qd = self.motion.velocity(self, dt)
        self.target_qdd = [(b - a) / dt for a, b in zip(before, self.target_qd, strict=True)]
        self.target_q = [q + v * dt for q, v in zip(self.target_q, self.target_qd, strict=True)]
        share = 1.0 - exp(-dt / LAG)
        moved = [share * (t + self.error - q) for t, q in zip(self.target_q, self.q, strict=True)]
        self.q = [q + m for q, m in zip(self.q, moved, strict=True)]
        self.qd = [m / dt for m in moved]
        self.X_WE = self.kinematics.forward(self.q)
        self._target_pose = None

    def stop(self, deceleration: float = PROGRAM_END_BRAKE) -> None:
        """Give up whatever motion there is and slow down."""
        if not isinstance(self.motion, Hold):
            self.motion = Hold(deceleration)
        self.motion.deceleration = max(self.motion.deceleration, deceleration)

    def inverse(self, tcp_pose: Sequence[float], near: Sequence[float]) -> list[float]:
        """Joint angles (6,) that put the TCP at a pose vector."""
        if not all(np.isfinite(tcp_pose)):
            raise KinematicsError(f"get_inverse_kin: pose {tuple(tcp_pose)} must be finite")
        return self.inverse_of(matrix_from_pose(tcp_pose), near)

    def inverse_of(self, X_W_tcp: Array, near: Sequence[float]) -> list[float]:
        """Joint angles (6,) that put the TCP at X_W_tcp (4, 4)."""
        return [float(t) for t in self.kinematics.inverse(X_W_tcp @ self._tcp_inverse, near)]

    def follow(self, tcp_pose: Sequence[float]) -> list[float]:
        """As `inverse` near the target, quickly."""
        if not all(map(isfinite, tcp_pose)):
            raise KinematicsError(f"get_inverse_kin: pose {tuple(tcp_pose)} must be finite")
        return self.kinematics.follow(matrix_from_pose(tcp_pose) @ self._tcp_inverse, self.target_q)

    def set_tcp(self, X_E_tcp: Array) -> None:
        """Where the TCP is, in the flange frame."""
        self.tcp, self._tcp_inverse, self.tcp_offset = X_E_tcp, inverse_pose(X_E_tcp), pose_from_matrix(X_E_tcp)

    def joint_speed_of(self, tcp_velocity: Sequence[float]) -> list[float]:
        """Joint speeds (6,) for a TCP velocity (vx vy vz wx wy wz in W), damped near singularities."""
        v, w = np.array(tcp_velocity[:3]), np.array(tcp_velocity[3:])
        v = v + np.cross(w, self.X_WE[:3, 3] - (self.X_WE @ self.tcp)[:3, 3])
        J = self.kinematics.jacobian(self.target_q)
        qd = J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), np.concatenate((w, v)))
        return [float(t) for t in qd]

    def tcp_pose(self) -> Pose6:
        """Actual pose vector of the TCP in W."""
        return pose_from_matrix(self.X_WE @ self.tcp)

    def target_tcp_pose(self) -> Pose6:
        """Pose vector of the TCP for the target joint angles."""
        if self._target_pose is None:
            self._target_pose = pose_from_matrix(self.kinematics.forward(self.target_q) @ self.tcp)
        return self._target_pose

    def tcp_velocity(self, qd: Sequence[float]) -> tuple[float, ...]:
        """Velocity of the TCP, (vx vy vz wx wy wz) in W, for joint speeds (6,)."""
        if not any(qd):
            return (0.0,) * 6
        wx, wy, wz, vx, vy, vz = self.kinematics.twist(self.q, qd)
        rx, ry, rz = (self.X_WE[:3, :3] @ self.tcp[:3, 3]).tolist()
        return vx + wy * rz - wz * ry, vy + wz * rx - wx * rz, vz + wx * ry - wy * rx, wx, wy, wz

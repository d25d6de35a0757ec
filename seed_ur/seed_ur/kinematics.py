# SPDX-License-Identifier: Apache-2.0
"""Kinematics of UR arms: forward, analytic inverse (up to eight branches) and Jacobian.

Frames: W is UR's `base` (not `base_link`, which is turned by half a turn about z), E is `tool0`, the flange.
Plain Python in the scalar parts: at 500 Hz the overhead of small NumPy arrays would cost more than
the mathematics.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import acos, atan2, cos, hypot, pi, sin

import numpy as np

from seed_core.errors import SeedError
from seed_core.spatial import Array
from seed_core.vector3 import Vector3
from seed_ur.models import ALPHA, URModel, model

_COS_ALPHA = tuple(float(round(cos(t))) for t in ALPHA)  # exactly 0 and +-1
_SIN_ALPHA = tuple(float(round(sin(t))) for t in ALPHA)
_SINGULAR = 1e-8  # |sin q5| below which joints 4 and 6 share one axis
_WRIST = 0.02  # |sin q5| below which `follow` looks at every branch
_ROUNDING = 1e-9  # a cosine beyond 1 by less than this is rounding, not unreachability


class KinematicsError(SeedError):
    """A pose that the arm cannot take, or joint values that are no joint values."""


class URKinematics:
    """Analytic kinematics of one UR arm with published (not calibrated) lengths."""

    def __init__(self, arm: URModel) -> None:
        self.model = arm

    @classmethod
    def for_model(cls, name: str) -> URKinematics:
        """Kinematics of 'ur5e' or 'ur10e'."""
        return cls(model(name))

    def frames(self, q: Sequence[float] | Array) -> Array:
        """X_W,i of the six DH frames, (6, 4, 4), for joint angles q (6,) [rad]; the last is `tool0`."""
        x, y, z, p = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
        flat: list[float] = []
        for i in range(6):
            x, y, z, p = self._next(i, float(q[i]), x, y, z, p)
            flat += (x[0], y[0], z[0], p[0], x[1], y[1], z[1], p[1], x[2], y[2], z[2], p[2], 0.0, 0.0, 0.0, 1.0)
        return np.array(flat).reshape(6, 4, 4)

    def forward(self, q: Sequence[float] | Array) -> Array:
        """X_WE (4, 4) of `tool0` in `base` for joint angles q (6,) [rad]."""
        x, y, z, p = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
        for i in range(6):
            x, y, z, p = self._next(i, float(q[i]), x, y, z, p)
        return np.array(
            (
                (x[0], y[0], z[0], p[0]),
                (x[1], y[1], z[1], p[1]),
                (x[2], y[2], z[2], p[2]),
                (0.0, 0.0, 0.0, 1.0),
            )
        )

    def _next(self, i: int, q: float, x: Vector3, y: Vector3, z: Vector3, p: Vector3) -> tuple[Vector3, ...]:
        """Axes and origin after A_i = Rz(q) Tz(d) Tx(a) Rx(alpha)."""
        c, s = cos(q), sin(q)
        ca, sa, a, d = _COS_ALPHA[i], _SIN_ALPHA[i], self.model.a[i], self.model.d[i]
        x1 = (c * x[0] + s * y[0], c * x[1] + s * y[1], c * x[2] + s * y[2])
        y1 = (c * y[0] - s * x[0], c * y[1] - s * x[1], c * y[2] - s * x[2])
        p1 = (p[0] + d * z[0] + a * x1[0], p[1] + d * z[1] + a * x1[1], p[2] + d * z[2] + a * x1[2])
        y2 = (ca * y1[0] + sa * z[0], ca * y1[1] + sa * z[1], ca * y1[2] + sa * z[2])
        z2 = (ca * z[0] - sa * y1[0], ca * z[1] - sa * y1[1], ca * z[2] - sa * y1[2])
        return x1, y2, z2, p1

    def twist(self, q: Sequence[float] | Array, qd: Sequence[float] | Array) -> tuple[float, ...]:
        """E's angular velocity [rad/s] (3) and velocity [m/s] (3) in W for joint speeds qd (6,) [rad/s]."""
        x, y, z, p = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
        wx = wy = wz = vx = vy = vz = 0.0
        for i in range(6):
            speed = float(qd[i])
            wx, wy, wz = wx + speed * z[0], wy + speed * z[1], wz + speed * z[2]
            before = p
            x, y, z, p = self._next(i, float(q[i]), x, y, z, p)
            rx, ry, rz = p[0] - before[0], p[1] - before[1], p[2] - before[2]
            vx, vy, vz = vx + wy * rz - wz * ry, vy + wz * rx - wx * rz, vz + wx * ry - wy * rx
        return wx, wy, wz, vx, vy, vz

    def jacobian(self, q: Sequence[float] | Array) -> Array:
        """(6, 6) map from joint speeds to E's angular velocity (rows 0-2) and velocity (rows 3-5), in W."""
        frames = self.frames(q)
        axes = np.vstack(([0.0, 0.0, 1.0], frames[:5, :3, 2]))
        origins = np.vstack((np.zeros(3), frames[:5, :3, 3]))
        return np.vstack((axes.T, np.cross(axes, frames[5, :3, 3] - origins).T))

    def all_inverse(self, X_WE: Array, q6_when_singular: float = 0.0) -> list[tuple[float, ...]]:
        """Every joint vector (6,) in (-pi, pi] that reaches X_WE (4, 4); empty when out of reach.

        Where q5 is a multiple of pi only q4 + q6 or q4 - q6 is determined: q6 is then `q6_when_singular`.
        """
        out: list[tuple[float, ...]] = []
        for q1, (ex, ey, ez) in self._shoulders(X_WE):
            bend = atan2(hypot(ex, ey), ez)
            if hypot(ex, ey) < _SINGULAR:
                out.extend(self._arm(X_WE, q1, bend, q6_when_singular))
            else:
                out.extend(self._arm(X_WE, q1, bend, atan2(-ey, ex)))
                out.extend(self._arm(X_WE, q1, -bend, atan2(ey, -ex)))
        return [tuple(_wrap(t) for t in q) for q in out]

    def _shoulders(self, X_WE: Array) -> list[tuple[float, Vector3]]:
        """Both angles q1, none inside the cylinder around the base axis, each with the axis of joints 2 to 4 in E.

        That axis is (s5 c6, -s5 s6, c5).
        """
        (xx, yx, zx, px), (xy, yy, zy, py), _, _ = X_WE.tolist()
        d4, d6 = self.model.d[3], self.model.d[5]
        wx, wy = px - d6 * zx, py - d6 * zy  # where the axes of joints 5 and 6 meet, seen from above
        radius = hypot(wx, wy)
        if radius < d4:
            return []
        middle, side = atan2(wy, wx) + pi / 2, acos(d4 / radius)
        out: list[tuple[float, Vector3]] = []
        for q1 in (middle + side, middle - side):
            s1, c1 = sin(q1), cos(q1)
            out.append((q1, (s1 * xx - c1 * xy, s1 * yx - c1 * yy, s1 * zx - c1 * zy)))
        return out

    def _arm(self, X_WE: Array, q1: float, q5: float, q6: float) -> list[tuple[float, ...]]:
        """Joint vectors with the given base and hand angles: what is left is a planar arm, joints 2 to 4."""
        (xx, yx, zx, px), (xy, yy, zy, py), (xz, yz, zz, pz), _ = X_WE.tolist()
        d1, d5, d6 = self.model.d[0], self.model.d[4], self.model.d[5]
        c1, s1, c5, s5, c6, s6 = cos(q1), sin(q1), cos(q5), sin(q5), cos(q6), sin(q6)
        # origin and x axis of frame 4 from those of E
        x4 = c5 * (c6 * xx - s6 * yx) - s5 * zx
        y4 = c5 * (c6 * xy - s6 * yy) - s5 * zy
        z4 = c5 * (c6 * xz - s6 * yz) - s5 * zz
        u = c1 * (px - d6 * zx + d5 * (s6 * xx + c6 * yx)) + s1 * (py - d6 * zy + d5 * (s6 * xy + c6 * yy))
        v = pz - d6 * zz + d5 * (s6 * xz + c6 * yz) - d1
        phi = atan2(z4, c1 * x4 + s1 * y4)
        return [(q1, *planar, q5, q6) for planar in self._planar(u, v, phi)]

    def _planar(self, u: float, v: float, phi: float) -> list[Vector3]:
        """q2, q3, q4 that put the wrist at (u, v) [m] in the arm's plane with q2 + q3 + q4 = phi."""
        a2, a3 = self.model.a[1], self.model.a[2]
        c3 = (u * u + v * v - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)
        if abs(c3) > 1.0 + _ROUNDING:
            return []
        bend = acos(max(-1.0, min(1.0, c3)))
        out = []
        for q3 in (bend, -bend) if bend > 0.0 else (bend,):
            q2 = atan2(v, u) - atan2(a3 * sin(q3), a2 + a3 * cos(q3))
            out.append((q2, q3, phi - q2 - q3))
        return out

    def inverse(self, X_WE: Array, near: Sequence[float] | Array) -> Array:
        """Joint angles (6,) [rad] reaching X_WE, the branch and the turns nearest to `near` (6,).

        Raises KinematicsError when the pose is out of reach or needs a joint beyond its range.
        """
        start = [float(t) for t in near]
        candidates = (self._turns(q, start) for q in self.all_inverse(X_WE, start[5]))
        reachable = [q for q in candidates if q is not None]
        if not reachable:
            where = ", ".join(f"{t:.3f}" for t in X_WE[:3, 3])
            raise KinematicsError(f"pose at ({where}) m is out of reach of the {self.model.name}: move it closer")
        return np.array(min(reachable, key=lambda q: sum((s - t) ** 2 for s, t in zip(q, start, strict=True))))

    def follow(self, X_WE: Array, near: Sequence[float]) -> list[float]:
        """As `inverse`, four times faster: at every fork the side of `near` (6,), which has to be close by."""
        shoulders = self._shoulders(X_WE)
        if shoulders:
            q1, (ex, ey, ez) = min(shoulders, key=lambda s: abs(_wrap(s[0] - near[0])))
            sign = 1.0 if sin(near[4]) >= 0.0 else -1.0
            planar = self._arm(X_WE, q1, sign * atan2(hypot(ex, ey), ez), atan2(-sign * ey, sign * ex))
            if planar and hypot(ex, ey) >= _WRIST:  # below, q5 may change its sign
                nearest = min(planar, key=lambda q: abs(_wrap(q[2] - near[2])))
                solution = self._turns(nearest, near)
                if solution is not None:
                    return solution
        return [float(t) for t in self.inverse(X_WE, near)]  # raises with the reason, or knows another way

    def _turns(self, q: Sequence[float], near: Sequence[float]) -> list[float] | None:
        """Each angle plus the whole turns that bring it nearest to `near` within the joint's range."""
        out = []
        for angle, goal in zip(q, near, strict=True):
            turned = angle + 2 * pi * round((goal - angle) / (2 * pi))
            if abs(turned) > self.model.range:
                turned -= 2 * pi * (1 if turned > 0 else -1)
            if abs(turned) > self.model.range:
                return None
            out.append(turned)
        return out


def _wrap(angle: float) -> float:
    """The angle in (-pi, pi]."""
    wrapped = angle - 2 * pi * round(angle / (2 * pi))
    return wrapped if wrapped > -pi else wrapped + 2 * pi

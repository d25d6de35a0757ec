# SPDX-License-Identifier: Apache-2.0
"""Poses, rotations and wrenches.

Monogram notation (Drake's): X_AB is the pose of frame B measured in frame A, so that `p_A = X_AB @ p_B` and
`X_AC = X_AB @ X_BC`. A pose is a (4, 4) float64 matrix. Units are metres, radians, newtons and newton metres.
Angles `rpy` are fixed-axis roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll) (REP-103, SciPy's lower-case 'xyz').
"""

from __future__ import annotations

from math import asin, atan2, cos, isfinite, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seed_core.errors import SeedError

Array = NDArray[np.float64]

_SMALL_ANGLE = 1e-6  # [rad]; below it two terms of each series are exact to rounding
_IDENTITY = np.eye(4)
_UNIT_TOLERANCE = 1e-3  # how far a quaternion's norm may be from one before it is refused


class SpatialError(SeedError):
    """A matrix or quaternion that is no pose or rotation."""


class Wrench(NamedTuple):
    """Torque and force (each (3,) [N m], [N]) about one point and written in one frame, which the name tells."""

    torque: Array
    force: Array

    @classmethod
    def zero(cls) -> Wrench:
        """No load."""
        return cls(np.zeros(3), np.zeros(3))

    @classmethod
    def from_vector(cls, vector: ArrayLike) -> Wrench:
        """From a flat (6,) [torque, force]."""
        v = np.asarray(vector, dtype=float)
        return cls(v[:3].copy(), v[3:].copy())

    def vector(self) -> Array:
        """Flat (6,) [torque, force]."""
        return np.concatenate([self.torque, self.force])

    def rotated(self, R_AB: Array) -> Wrench:
        """The wrench, written in B, written in A."""
        return Wrench(R_AB @ self.torque, R_AB @ self.force)

    def about(self, p_PQ: Array) -> Wrench:
        """The same load about point Q instead of P; p_PQ (3,) [m] runs from P to Q."""
        return Wrench(self.torque - cross(p_PQ, self.force), self.force)

    def plus(self, other: Wrench) -> Wrench:
        """Sum of two wrenches about one point in one frame."""
        return Wrench(self.torque + other.torque, self.force + other.force)

    def minus(self, other: Wrench) -> Wrench:
        """Difference of two wrenches about one point in one frame."""
        return Wrench(self.torque - other.torque, self.force - other.force)

    def __add__(self, other: Wrench) -> Wrench:  # type: ignore[override]
        return self.plus(other)

    def __sub__(self, other: Wrench) -> Wrench:
        return self.minus(other)

    def __neg__(self) -> Wrench:
        return Wrench(-self.torque, -self.force)

    def __mul__(self, factor: float) -> Wrench:  # type: ignore[override]
        k = float(factor)
        return Wrench(k * self.torque, k * self.force)

    def __rmul__(self, factor: float) -> Wrench:  # type: ignore[override]
        return self * factor

    @property
    def __array_priority__(self) -> float:
        """Above that of numpy's numbers, which then leave a product to the wrench."""
        return 1.0


def length(v: Array) -> float:
    """Euclidean norm of a vector (n,); faster than numpy.linalg.norm."""
    return sqrt(float(v @ v))


def cross(a: Array, b: Array) -> Array:
    """a x b of two (3,) vectors; several times faster than numpy.cross."""
    ax, ay, az = float(a[0]), float(a[1]), float(a[2])
    bx, by, bz = float(b[0]), float(b[1]), float(b[2])
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))


def skew(v: ArrayLike) -> Array:
    """(3, 3) matrix with skew(v) @ u = v x u."""
    x, y, z = np.asarray(v, dtype=float).tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def both(R: Array) -> Array:
    """(6, 6) that turns both halves of a motion or a wrench by R (3, 3)."""
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = R
    return out


def motion_adjoint(X: Array) -> Array:
    """(6, 6) that takes a small motion [rotation, translation] from a frame of pose X (4, 4) into its parent."""
    out = both(X[:3, :3])
    out[3:, :3] = skew(X[:3, 3]) @ X[:3, :3]
    return out


def wrench_adjoint(X: Array) -> Array:
    """(6, 6) that takes a wrench [torque, force] about the origin of a frame of pose X (4, 4) to its parent's."""
    out = both(X[:3, :3])
    out[:3, 3:] = skew(X[:3, 3]) @ X[:3, :3]
    return out


def rotation_from_rpy(rpy: ArrayLike) -> Array:
    """R (3, 3) = Rz(yaw) Ry(pitch) Rx(roll) of rpy (3,) [rad]."""
    r, p, y = np.asarray(rpy, dtype=float).tolist()
    cr, sr, cp, sp, cy, sy = cos(r), sin(r), cos(p), sin(p), cos(y), sin(y)
    return np.array(
        (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
    )


def rpy_from_rotation(R: Array) -> Array:
    """Roll, pitch, yaw (3,) [rad] of R, pitch within +-pi/2; at +-pi/2 only roll and yaw together are determined."""
    (r00, _, _), (r10, _, _), (r20, r21, r22) = R.tolist()
    return np.array((atan2(r21, r22), asin(max(-1.0, min(1.0, -r20))), atan2(r10, r00)))


def so3_exp(rotation_vector: ArrayLike) -> Array:
    """R (3, 3) of a rotation vector (3,) [rad] (Rodrigues)."""
    x, y, z = np.asarray(rotation_vector, dtype=float).tolist()
    angle = sqrt(x * x + y * y + z * z)
    if angle < _SMALL_ANGLE:
        a, b = 1.0, 0.5
    else:
        half = sin(0.5 * angle) / angle
        a, b = sin(angle) / angle, 2.0 * half * half
    bx, by, bz = b * x, b * y, b * z  # R = 1 + a skew(v) + b skew(v)^2, entry by entry: this runs at every step
    xy, xz, yz, ax, ay, az = bx * y, bx * z, by * z, a * x, a * y, a * z
    return np.array(
        (
            (1.0 - by * y - bz * z, xy - az, xz + ay),
            (xy + az, 1.0 - bx * x - bz * z, yz - ax),
            (xz - ay, yz + ax, 1.0 - bx * x - by * y),
        )
    )


def so3_log(R: Array) -> Array:
    """Rotation vector (3,) [rad], of length at most pi, of R."""
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = R.tolist()
    x, y, z = 0.5 * (r21 - r12), 0.5 * (r02 - r20), 0.5 * (r10 - r01)
    s = sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (r00 + r11 + r22 - 1.0)
    if cosine < -0.99:  # the sine is ill-conditioned near pi, the quaternion's is not
        q = quaternion_from_rotation(R)
        half_sine = length(q[:3])
        return np.asarray(q[:3] * (2.0 * atan2(half_sine, float(q[3])) / half_sine))
    k = 1.0 + s * s / 6.0 if s < _SMALL_ANGLE else atan2(s, cosine) / s
    return np.array((k * x, k * y, k * z))


def make_pose(R: ArrayLike | None = None, p: ArrayLike | None = None) -> Array:
    """X (4, 4) from R (3, 3) and p (3,) [m]; identity where left out."""
    X = _IDENTITY.copy()
    if R is not None:
        X[:3, :3] = R
    if p is not None:
        X[:3, 3] = p
    return X


def pose_from_rpy(rpy: ArrayLike, p: ArrayLike) -> Array:
    """X (4, 4) from rpy (3,) [rad] and p (3,) [m]."""
    return make_pose(rotation_from_rpy(rpy), p)


def inverse_pose(X_AB: Array) -> Array:
    """X_BA (4, 4)."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z), last = X_AB.tolist()
    return np.array(
        (
            (a, d, g, -a * x - d * y - g * z),
            (b, e, h, -b * x - e * y - h * z),
            (c, f, i, -c * x - f * y - i * z),
            last,
        )
    )


def interpolate_pose(X_A: Array, X_B: Array, s: float) -> Array:
    """Pose at share s of the way from X_A to X_B: straight in position, on the great circle in rotation."""
    R_A = X_A[:3, :3]
    R = R_A @ so3_exp(s * so3_log(R_A.T @ X_B[:3, :3]))
    return make_pose(R, (1.0 - s) * X_A[:3, 3] + s * X_B[:3, 3])


def rotation_error(R_est: Array, R_true: Array) -> Array:
    """Rotation vector (3,) [rad] of R_est R_true^T, written in the frame in which both are measured."""
    return so3_log(R_est @ R_true.T)


def quaternion_from_rotation(R: Array) -> Array:
    """Unit quaternion (4,) x, y, z, w with w >= 0 of R."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()  # Shepperd's method: divide by the largest component
    squares = (1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i, 1.0 + a + e + i)  # 4 x^2, 4 y^2, 4 z^2, 4 w^2
    largest = squares.index(max(squares))
    if largest == 3:
        q = (h - f, c - g, d - b, squares[3])
    elif largest == 0:
        q = (squares[0], b + d, c + g, h - f)
    elif largest == 1:
        q = (b + d, squares[1], f + h, c - g)
    else:
        q = (c + g, f + h, squares[2], d - b)
    out = np.array(q)
    out /= length(out)
    return -out if out[3] < 0.0 else out


def pose_from_quaternion(xyzw: ArrayLike, p: ArrayLike, name: str = "pose") -> Array:
    """X (4, 4) from a unit quaternion x, y, z, w and p (3,) [m].

    Raises:
        SpatialError: a value is not finite, or the quaternion's norm is further than 1e-3 from one.
    """
    q, position = np.asarray(xyzw, dtype=float), np.asarray(p, dtype=float)
    if not (np.isfinite(q).all() and np.isfinite(position).all()):
        raise SpatialError(f"{name} has a value that is not finite: position {position}, quaternion {q}")
    norm = length(q)
    if abs(norm - 1.0) > _UNIT_TOLERANCE:
        raise SpatialError(f"{name}.orientation has norm {norm:.4g}; a unit quaternion (x, y, z, w) is needed")
    x, y, z, w = (q / norm).tolist()
    return np.array(
        (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w), position[0]),
            (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w), position[1]),
            (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y), position[2]),
            (0.0, 0.0, 0.0, 1.0),
        )
    )


def check_pose(X: ArrayLike, name: str = "pose") -> Array:
    """X as a (4, 4) float64 pose.

    Raises:
        SpatialError: wrong shape, not finite, or no rotation to 1e-6.
    """
    out = np.asarray(X, dtype=float)
    if out.shape != (4, 4):
        raise SpatialError(f"{name} has shape {out.shape}; a pose is (4, 4)")
    x, y, z, last = out.tolist()
    if not all(map(isfinite, (*x, *y, *z, *last))):
        raise SpatialError(f"{name} has a value that is not finite")
    if last != [0.0, 0.0, 0.0, 1.0] or not _orthonormal(x[:3], y[:3], z[:3]):
        raise SpatialError(f"{name} is no pose: its rotation is not orthonormal or its last row is not 0 0 0 1")
    return out


def _orthonormal(x: list[float], y: list[float], z: list[float]) -> bool:
    """Whether three rows make a rotation to 1e-6."""
    (a, b, c), (d, e, f), (g, h, i) = x, y, z
    products = (
        a * a + b * b + c * c - 1.0,
        d * d + e * e + f * f - 1.0,
        g * g + h * h + i * i - 1.0,
        a * d + b * e + c * f,
        a * g + b * h + c * i,
        d * g + e * h + f * i,
    )
    right_handed = g * (b * f - c * e) + h * (c * d - a * f) + i * (a * e - b * d) > 0.0
    return max(products) <= 1e-6 and min(products) >= -1e-6 and right_handed

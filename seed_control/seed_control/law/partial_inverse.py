# SPDX-License-Identifier: Apache-2.0
"""The partial inverses of the stiffness map (Sec. V-C), which stand for line 5 of Algorithm 2 in hybrid control.

`hybrid_force_position` (Sec. V-C1): force along some directions, position along the others.
`hybrid_torque_orientation` (Sec. V-C2): torque about some of T's axes, the angle about the others (Assumption 3).

Torques are N(q)^T diag(k) q written in T, q = (r, p, y) = rpy(R_TC); pairs are tx-roll, ty-pitch, tz-yaw.
"""

from collections.abc import Callable
from itertools import pairwise
from math import asin, cos, isfinite, pi, sin

import numpy as np

from seed_control.setpoint.setpoints import AxisFlags
from seed_core.errors import SeedError
from seed_core.spatial import Array
from seed_core.vector3 import Vector3

_EYE = np.eye(3)
PITCH_RANGE = np.deg2rad(60.0)  # [rad]; twice of what the grasp endures before slip


class PartialInverseError(SeedError):
    """Torques and angles that no displacement gives, or that more than one gives."""


def hybrid_force_position(force_projector: Array, K: Array, displacement: Array, force: Array) -> Array:
    """Hybrid force/position control (Sec. V-C1): d = p_TC (3,) [m] with K d = force along P, d = displacement along S.

    P = I - S. For one stiffness along all directions this is the paper's p_WC = S p_des + P (p_WT + K^-1 f).

    Args:
        force_projector: P (3, 3) onto the directions that carry force, any symmetric projector.
        K: translational stiffness (3, 3) [N/m], force = K p_TC, in the same axes.
        displacement: wanted p_TC (3,) [m]; its part along P is ignored.
        force: wanted force of the spring on the tool (3,) [N]; its part along S is ignored.
    """
    P = force_projector
    scale = float(K[0, 0])  # [N/m], makes both kinds of rows of about one size
    M = _EYE - P + P @ K / scale  # (S + P K / scale) d = S displacement + P force / scale
    return np.asarray(np.linalg.solve(M, displacement - P @ displacement + P @ force / scale))


def hybrid_torque_orientation(
    k: Vector3, torque: Vector3, angles: Vector3, is_torque: AxisFlags, near_pitch: float | None = None
) -> Vector3:
    """Hybrid torque/orientation control (Sec. V-C2): rpy(R_TC) [rad] with torque[i] where is_torque[i], else angles[i].

    All eight selections: with all three torques it is Eq. 5, with two or one the paper's two partial maps.

    Args:
        k: rotational stiffness [N m/rad].
        torque: wanted torques about T's axes [N m]; entries of angle-controlled axes are ignored.
        angles: wanted angles [rad]; entries of torque-controlled axes are ignored.
        is_torque: selection per axis, in the pairing tx-roll, ty-pitch, tz-yaw.
        near_pitch: with roll's or yaw's angle given, more than one pitch may give ty; the nearest to this is taken
            (the measured one). None refuses such a case.

    Raises:
        PartialInverseError: no solution inside the map's domain, or several and no near_pitch.
    """
    kr, kp, ky = k
    yaw = torque[2] / ky if is_torque[2] else angles[2]
    tz = ky * yaw
    if not (isfinite(yaw) and abs(yaw) < pi):
        raise PartialInverseError(
            f"tz = {torque[2]:.3g} N m needs a yaw of {np.rad2deg(yaw):.0f} degrees; below 180 only"
        )
    c2, s2 = cos(yaw), sin(yaw)
    if not is_torque[1]:
        pitch = _within(angles[1], torque[1])
    elif is_torque[0]:
        pitch = _within((c2 * torque[1] - s2 * torque[0]) / kp, torque[1])  # Eq. 5
    else:
        pitch = _pitch_by_root(k, torque[1], angles[0], tz, c2, s2, near_pitch)
    if not is_torque[0]:
        return angles[0], pitch, yaw
    if is_torque[1]:
        along = c2 * torque[0] + s2 * torque[1]
    else:
        if abs(c2) < 1e-3:
            raise PartialInverseError(
                f"tx with the pitch given has no solution at a yaw of {np.rad2deg(yaw):.1f} degrees"
            )
        along = (torque[0] + s2 * kp * pitch) / c2
    roll = (cos(pitch) * along - sin(pitch) * tz) / kr  # Eq. 5
    if not abs(roll) < pi:
        raise PartialInverseError(
            f"tx = {torque[0]:.3g} N m needs a roll of {np.rad2deg(roll):.0f} degrees; below 180 only"
        )
    return roll, pitch, yaw


def _within(pitch: float, torque: float) -> float:
    if not abs(pitch) < 0.5 * pi:
        raise PartialInverseError(
            f"ty = {torque:.3g} N m needs a pitch of {np.rad2deg(pitch):.0f} degrees; the map ends at 90"
        )
    return pitch


def _pitch_by_root(k: Vector3, ty: float, roll: float, tz: float, c2: float, s2: float, near: float | None) -> float:
    """Root in p of F(p) = s2 (kr r + tz sin p) / cos p + c2 kp p - ty within PITCH_RANGE."""
    kp, a = k[1], k[0] * roll

    def value(p: float) -> float:
        return s2 * (a + tz * sin(p)) / cos(p) + c2 * kp * p - ty

    # F' = 0 is a quadratic in sin p, so the range falls into at most three pieces on which F is monotone.
    edges = [-PITCH_RANGE, *_turning_points(c2 * kp, s2 * a, s2 * tz), PITCH_RANGE]
    roots = [_root(value, low, high) for low, high in pairwise(edges) if value(low) * value(high) <= 0.0]
    if not roots:
        low, high = sorted((value(-PITCH_RANGE) + ty, value(PITCH_RANGE) + ty))
        raise PartialInverseError(
            f"ty = {ty:.3g} N m cannot be reached with a pitch within 60 degrees (there it runs from {low:.3g} to "
            f"{high:.3g} N m): ask for less torque or a stiffer grip"
        )
    if near is None and len(roots) > 1:
        listed = ", ".join(f"{np.rad2deg(p):.1f}" for p in roots)
        raise PartialInverseError(
            f"ty = {ty:.3g} N m is reached at pitches of {listed} degrees: give the measured pitch"
        )
    start = near if near is not None else roots[0]
    return min(roots, key=lambda p: abs(p - start))


def _root(value: Callable[[float], float], low: float, high: float) -> float:
    """Zero of a monotone function between places of different sign: false position, the Illinois variant.

    SciPy's brentq does the same, and is half of what a command or a controller loads when it starts.
    """
    f_low, f_high = value(low), value(high)
    for _ in range(100):
        if f_high == 0.0 or abs(high - low) < 1e-15:
            break
        p = high - f_high * (high - low) / (f_high - f_low)
        f = value(p)
        if f * f_high < 0.0:
            low, f_low = high, f_high
        else:
            f_low *= 0.5
        high, f_high = p, f
    return high


def _turning_points(b: float, c: float, d: float) -> list[float]:
    """Angles p within the range with b cos^2 p + c sin p + d = 0, in rising order."""
    sines = np.roots((-b, c, b + d))
    return sorted(asin(s.real) for s in sines if s.imag == 0.0 and abs(s.real) < sin(PITCH_RANGE))

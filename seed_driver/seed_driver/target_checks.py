# SPDX-License-Identifier: Apache-2.0
"""Which targets are let through. A refusal is a sentence with the number and the bound."""

from __future__ import annotations

from math import degrees, hypot, isfinite
from typing import NamedTuple

from seed_core.quaternion import Quaternion, to_pose, turn_between
from seed_core.vector3 import Vector3
from seed_driver.config import DriverConfig
from seed_ur.kinematics import KinematicsError, URKinematics

UNIT_TOLERANCE = 1e-3  # a quaternion's length may be off by this


class Target(NamedTuple):
    """A wanted pose of the flange."""

    frame: str
    age: float  # [s] since its stamp; negative: from the future
    p: Vector3  # [m]
    q: Quaternion


def refusal(
    target: Target,
    command: tuple[Vector3, Quaternion],
    joints: list[float],
    arm: URKinematics | None,
    c: DriverConfig,
) -> str | None:
    """Why `target` is refused, given the present command and joint angles; None when it is good.

    Without an arm the reach is not looked at.
    """
    numbers = (*target.p, *target.q)
    if not all(isfinite(n) for n in numbers):
        return f"target_frame is not finite: position {target.p}, quaternion {target.q}"
    length = hypot(*target.q)
    if abs(length - 1.0) > UNIT_TOLERANCE:
        return f"target_frame quaternion has length {length:.4f}, must be 1"
    if target.frame != c.base_frame:
        return f"target_frame is in frame '{target.frame:.60}', must be '{c.base_frame}'"
    return _stale(target, c) or _outside(target, c) or _jump(target, command, c) or _unreachable(target, joints, arm)


def _stale(target: Target, c: DriverConfig) -> str | None:
    if abs(target.age) <= c.command_timeout:
        return None
    when = "old" if target.age > 0 else "ahead of this computer's clock"
    return f"target_frame stamp is {abs(target.age):.3f} s {when}, limit {c.command_timeout} s"


def _outside(target: Target, c: DriverConfig) -> str | None:
    for axis, value, low, high in zip("xyz", target.p, c.workspace_low, c.workspace_high, strict=True):
        if not low <= value <= high:
            return f"target_frame {axis} = {value:.4g} m leaves the workspace {low} to {high} m"
    return None


def _jump(target: Target, command: tuple[Vector3, Quaternion], c: DriverConfig) -> str | None:
    distance = hypot(*(a - b for a, b in zip(target.p, command[0], strict=True)))
    if distance > c.max_step:
        return f"target_frame jumps {distance:.4g} m from the command, limit {c.max_step} m"
    turn = hypot(*turn_between(target.q, command[1]))
    if turn > c.max_turning_step:
        limit = degrees(c.max_turning_step)
        return f"target_frame jumps {degrees(turn):.1f} degrees from the command, limit {limit:.1f}"
    return None


def _unreachable(target: Target, joints: list[float], arm: URKinematics | None) -> str | None:
    if arm is None:
        return None
    try:
        arm.follow(to_pose(target.p, target.q), joints)
    except KinematicsError as error:
        return f"target_frame: {error}"
    return None

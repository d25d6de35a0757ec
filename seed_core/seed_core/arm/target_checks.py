# SPDX-License-Identifier: Apache-2.0
"""The checks of an arm's targets. A refusal is a sentence with the number and the bound; '' is none.

Clause 3 of docs/arm_contract.md. What only a certain arm can know, its reach, its driver checks besides.
"""

from math import degrees, hypot, isfinite
from typing import NamedTuple

from seed_core.arm.limits import MotionLimits, TargetLimits
from seed_core.arm.quaternion import Quaternion, turn_between
from seed_core.vector3 import Vector3, minus, norm

UNIT_TOLERANCE = 1e-3  # a quaternion's length may be off by this


class Target(NamedTuple):
    """A wanted pose of the flange."""

    frame: str
    age: float  # [s] since its stamp; negative: from the future
    p: Vector3  # [m]
    q: Quaternion


def refusal(target: Target, command: tuple[Vector3, Quaternion], limits: TargetLimits) -> str:
    """Why `target` is refused while `command` (position [m], quaternion) is commanded; '' when it is good."""
    if target.frame != limits.base_frame:
        wrong_frame = f"target_frame is in frame '{target.frame:.60}', must be '{limits.base_frame}'"
    else:
        wrong_frame = ""
    return (
        no_pose(target.p, target.q)
        or wrong_frame
        or stale(target.age, limits.command_timeout)
        or outside(target.p, limits)
        or jump(target.p, command[0], limits.max_step)
        or turn(target.q, command[1], limits.max_angular_step)
    )


def no_pose(p: Vector3, q: Quaternion) -> str:
    """Not finite, or no unit quaternion."""
    if not all(map(isfinite, (*p, *q))):
        return f"target_frame is not finite: position {p}, quaternion {q}"
    length = hypot(*q)
    if abs(length - 1.0) > UNIT_TOLERANCE:
        return f"target_frame quaternion has length {length:.4f}, must be 1"
    return ""


def stale(age: float, timeout: float) -> str:
    """Older than `timeout` [s], or from the future by as much: one of the two clocks is wrong."""
    if abs(age) <= timeout:
        return ""
    when = "old" if age > 0 else "ahead of this computer's clock"
    return f"target_frame stamp is {abs(age):.3f} s {when}, limit {timeout:g} s"


def outside(p: Vector3, limits: MotionLimits) -> str:
    """Out of the workspace."""
    for axis, value, low, high in zip("xyz", p, limits.workspace_low, limits.workspace_high, strict=True):
        if not low <= value <= high:
            return f"target_frame {axis} = {value:.4g} m leaves the workspace {low} to {high} m"
    return ""


def jump(p: Vector3, here: Vector3, max_step: float, words: str = "jumps {} from the command") -> str:
    """Further than max_step [m] from `here`, which is the command or, in other `words`, the flange."""
    distance = norm(minus(p, here))
    if distance <= max_step:
        return ""
    return f"target_frame {words.format(f'{distance:.4g} m')}, limit {max_step:g} m"


def turn(q: Quaternion, here: Quaternion, max_angular_step: float) -> str:
    """Turned by more than max_angular_step [rad] from the command `here`."""
    angle = norm(turn_between(q, here))
    if angle <= max_angular_step:
        return ""
    return f"target_frame jumps {degrees(angle):.1f} degrees from the command, limit {degrees(max_angular_step):.1f}"

# SPDX-License-Identifier: Apache-2.0
"""TCP and payload: what the configuration wants, what the robot says, and the difference in words.

The robot's installation has both, and somebody may have set them there for good reasons: what is not configured here
(zero) stays as it is there. Both are compared at the start and while our program runs. A servo command is a pose of the
TCP, so that a TCP that changes is a jump of the arm; a payload that is wrong is a force that the robot does not know.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from seed_core.arm.quaternion import from_rotation_vector, turn_between
from seed_core.vector3 import norm
from seed_driver.config import DriverConfig
from seed_driver.robot.link import LinkError


class _Quantity(NamedTuple):
    """One thing that a robot tells of its tool."""

    output: str  # RTDE's name
    words: str
    unit: str
    digits: int
    tolerance: float  # of each number


class TcpAndPayload(NamedTuple):
    """TCP and payload; None: not configured, or not told."""

    tcp: Sequence[float] | None = None  # pose vector in the flange frame [m, rad]
    mass: Sequence[float] | None = None  # one number [kg]
    cog: Sequence[float] | None = None  # in the flange frame [m]
    inertia: Sequence[float] | None = None  # about the centre of mass: xx, yy, zz, xy, xz, yz [kg m^2]

    def else_from(self, other: TcpAndPayload) -> TcpAndPayload:
        """What the other has where this one has nothing."""
        return TcpAndPayload(*(b if a is None else a for a, b in zip(self, other, strict=True)))


QUANTITIES = (
    _Quantity("tcp_offset", "TCP", "m, rad", 4, 2e-4),
    _Quantity("payload", "payload", "kg", 3, 5e-3),
    _Quantity("payload_cog", "centre of the payload's mass", "m", 4, 5e-4),
    _Quantity("payload_inertia", "payload's inertia", "kg m^2", 5, 5e-5),
)
OUTPUTS = tuple(q.output for q in QUANTITIES)


def wanted(config: DriverConfig) -> TcpAndPayload:
    """What is configured."""
    loaded = config.payload_mass > 0.0
    return TcpAndPayload(
        tcp=config.tcp if any(config.tcp) else None,
        mass=(config.payload_mass,) if loaded else None,
        cog=config.payload_cog if loaded else None,
        inertia=config.payload_inertia if any(config.payload_inertia) else None,
    )


def told(values: Mapping[str, Any]) -> TcpAndPayload:
    """What the robot says in a state, by RTDE's names; older ones do not tell everything."""
    found = [values.get(name) for name in OUTPUTS]
    return TcpAndPayload(*((v,) if isinstance(v, float | int) else v for v in found))


def difference(expected: TcpAndPayload, found: TcpAndPayload) -> str:
    """The first of these that both have and that differs, in words; empty when there is none."""
    for quantity, a, b in zip(QUANTITIES, expected, found, strict=True):
        if a is not None and b is not None and not _same(quantity, a, b):
            return f"{quantity.words} is {_numbers(quantity, b)}, not {_numbers(quantity, a)}"
    return ""


def require(expected: TcpAndPayload, found: TcpAndPayload) -> None:
    """Raise LinkError where the robot has not taken what is configured."""
    if words := difference(expected, found):
        raise LinkError(f"the robot's {words} as configured: it has not taken it; look at the pendant")


def _same(quantity: _Quantity, a: Sequence[float], b: Sequence[float]) -> bool:
    if quantity.output == "tcp_offset":
        way = norm([y - x for x, y in zip(a[:3], b[:3], strict=True)])
        turn = norm(turn_between(from_rotation_vector((b[3], b[4], b[5])), from_rotation_vector((a[3], a[4], a[5]))))
        return way <= quantity.tolerance and turn <= 5.0 * quantity.tolerance
    return all(abs(x - y) <= quantity.tolerance for x, y in zip(a, b, strict=True))


def _numbers(quantity: _Quantity, numbers: Sequence[float]) -> str:
    shown = ", ".join(f"{round(x, quantity.digits) + 0.0:g}" for x in numbers)
    return f"{shown} {quantity.unit}" if len(numbers) == 1 else f"[{shown}] {quantity.unit}"

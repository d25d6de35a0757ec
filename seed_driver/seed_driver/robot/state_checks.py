# SPDX-License-Identifier: Apache-2.0
"""What a robot says of itself is checked like what is said to it: a state with a value that cannot be is not used.

Sources: Universal Robots, "Real-Time Data Exchange (RTDE) Guide", and the enumerations of its client library
(datatypes.h, rtde_client.h). A word that is not among them comes from a controller that this driver does not know.
Bit 11 of safety_status_bits, "is 3PE input active" (a three-position enabling device), is no stop: its issue 394,
https://github.com/UniversalRobots/Universal_Robots_Client_Library/issues/394.
"""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

from seed_driver.robot.link import LinkError

TURN = 6.4  # [rad] every joint turns 363 degrees either way at the most
RATE = 20.0  # [rad/s] of a joint; the quickest do 6
REACH = 10.0  # [m] of a TCP, and how fast [m/s]
_RANGES: Mapping[str, tuple[str, float]] = {  # unit and largest of any of its numbers
    "actual_q": ("rad", TURN),
    "actual_qd": ("rad/s", RATE),
    "actual_TCP_pose": ("m, rad", REACH),
    "actual_TCP_speed": ("m/s, rad/s", 2.0 * RATE),
    "tcp_offset": ("m, rad", REACH),
    "payload_cog": ("m", REACH),
    "payload_inertia": ("kg m^2", 1e3),
    "actual_current": ("A", 1e3),
    "actual_TCP_force": ("N, N m", 1e5),
}
_SCALES = ("speed_scaling", "target_speed_fraction")
LARGEST_SCALE = 2.0
_WORDS: Mapping[str, frozenset[int]] = {
    "robot_mode": frozenset(range(-1, 9)),
    "safety_mode": frozenset((*range(1, 21), 22)),
    "runtime_state": frozenset(range(7)),
    "safety_status_bits": frozenset(range(1 << 12)),
}


class StateError(LinkError):
    """A state of the robot that cannot be; the message says which value."""


def check_state(values: Mapping[str, Any]) -> None:
    """Raise StateError when a value of this state, by RTDE's names, is not finite, out of range or not a known word."""
    for name, (unit, largest) in _RANGES.items():
        numbers = values.get(name)  # min and max may pass over a NaN, the sum does not
        if numbers and not (-largest <= min(numbers) <= max(numbers) <= largest and isfinite(sum(numbers))):
            _complain(name, numbers, unit, largest)
    if not 0.0 <= values["timestamp"] < 1e12:
        raise StateError(f"the robot's timestamp is {values['timestamp']} s: restart the controller")
    if not 0.0 <= values.get("payload", 0.0) <= 1e3:
        raise StateError(f"the robot's payload is {values['payload']} kg: look at the pendant")
    for name in _SCALES:
        if not 0.0 <= values[name] <= LARGEST_SCALE:
            raise StateError(f"the robot's {name} is {values[name]}, not 0 to 1: restart the controller")
    for name, known in _WORDS.items():
        if values[name] not in known:
            raise StateError(f"the robot's {name} is {values[name]}, which this driver does not know")


def _complain(name: str, numbers: Sequence[float], unit: str, largest: float) -> None:
    for i, number in enumerate(numbers):
        if not -largest <= number <= largest:
            raise StateError(
                f"the robot's {name}[{i}] is {number:.6g}, not within +-{largest:g} ({unit}): "
                "nothing of this state is used; look at the pendant, then call resend_robot_program"
            )

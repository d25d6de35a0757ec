# SPDX-License-Identifier: Apache-2.0
"""RTDE framing (protocol version 2, big-endian) and the variables that a controller of a given version knows.

Source: Universal Robots, "Real-Time Data Exchange (RTDE) Guide".
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import accumulate
from typing import NamedTuple, TypeAlias

Value: TypeAlias = float | int | Sequence[float]
Version: TypeAlias = tuple[int, int, int, int]

REQUEST_VERSION, CONTROLLER_VERSION, TEXT, DATA = ord("V"), ord("v"), ord("M"), ord("U")
SETUP_OUTPUTS, SETUP_INPUTS, START, PAUSE = ord("O"), ord("I"), ord("S"), ord("P")
NOT_FOUND, IN_USE = "NOT_FOUND", "IN_USE"
LARGEST_PACKAGE = 4096  # [byte] nothing a client may send is longer (the name list is limited to 2048)

FORMATS: Mapping[str, str] = {
    "DOUBLE": "d",
    "VECTOR6D": "6d",
    "VECTOR3D": "3d",
    "VECTOR6INT32": "6i",
    "INT32": "i",
    "UINT32": "I",
    "UINT64": "Q",
    "UINT8": "B",
    "BOOL": "?",
}


class Package(NamedTuple):
    """One RTDE package without its header."""

    kind: int
    payload: bytes


class WireError(Exception):
    """The byte stream cannot be RTDE."""


def _table(kinds: Mapping[str, str]) -> dict[str, str]:
    return {name: kind for kind, names in kinds.items() for name in names.split()}


OUTPUTS: Mapping[str, str] = {
    **_table(
        {
            "DOUBLE": "timestamp actual_execution_time speed_scaling target_speed_fraction actual_momentum "
            "actual_main_voltage actual_robot_voltage actual_robot_current standard_analog_input0 "
            "standard_analog_input1 standard_analog_output0 standard_analog_output1 payload target_execution_time "
            "io_current euromap67_24V_voltage euromap67_24V_current tool_analog_input0 tool_analog_input1 "
            "tool_output_current tool_temperature tcp_force_scalar joint_position_deviation_ratio "
            "collision_detection_ratio actual_robot_energy_consumed actual_robot_braking_energy_dissipated",
            "VECTOR6D": "target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_qdd "
            "actual_current actual_moment actual_current_as_torque joint_control_output actual_TCP_pose "
            "actual_TCP_speed actual_TCP_force target_TCP_pose target_TCP_speed joint_temperatures "
            "actual_joint_voltage payload_inertia ft_raw_wrench tcp_offset actual_current_window "
            "wrench_calc_from_currents",
            "VECTOR3D": "actual_tool_accelerometer payload_cog elbow_position elbow_velocity",
            "UINT64": "actual_digital_input_bits actual_digital_output_bits actual_configurable_digital_input_bits "
            "actual_configurable_digital_output_bits",
            "UINT32": "runtime_state robot_status_bits safety_status_bits output_bit_registers0_to_31 "
            "output_bit_registers32_to_63 input_bit_registers0_to_31 input_bit_registers32_to_63 analog_io_types "
            "euromap67_input_bits euromap67_output_bits tool_mode tool_analog_input_types script_control_line",
            "INT32": "robot_mode safety_mode safety_status encoder0_raw encoder1_raw tool_output_voltage "
            "time_scale_source",
            "UINT8": "tool_output_mode tool_digital_output0_mode tool_digital_output1_mode",
            "VECTOR6INT32": "joint_mode",
        }
    ),
    **{f"output_int_register_{i}": "INT32" for i in range(48)},
    **{f"output_double_register_{i}": "DOUBLE" for i in range(48)},
    **{f"input_int_register_{i}": "INT32" for i in range(48)},
    **{f"input_double_register_{i}": "DOUBLE" for i in range(48)},
    **{f"{way}_bit_register_{i}": "BOOL" for way in ("input", "output") for i in range(64, 128)},
}
INPUTS: Mapping[str, str] = {
    **_table(
        {
            "VECTOR6D": "external_force_torque",
            "UINT32": "speed_slider_mask input_bit_registers0_to_31 input_bit_registers32_to_63",
            "DOUBLE": "speed_slider_fraction standard_analog_output_0 standard_analog_output_1",
            "UINT8": "standard_digital_output_mask standard_digital_output configurable_digital_output_mask "
            "configurable_digital_output tool_digital_output_mask tool_digital_output "
            "standard_analog_output_mask standard_analog_output_type",
        }
    ),
    **{f"input_int_register_{i}": "INT32" for i in range(48)},
    **{f"input_double_register_{i}": "DOUBLE" for i in range(48)},
    **{f"input_bit_register_{i}": "BOOL" for i in range(64, 128)},
}
_SINCE: Mapping[str, tuple[tuple[int, ...], tuple[int, ...]]] = {  # first release in the 3.x and in the 5.x line
    "payload": ((3, 11), (5, 5)),
    "payload_cog": ((3, 11), (5, 5)),
    "tcp_offset": ((3, 12, 3), (5, 5, 1)),
    "payload_inertia": ((3, 15), (5, 11)),
    "ft_raw_wrench": ((3, 999), (5, 9)),
    "actual_current_as_torque": ((3, 999), (5, 23)),
}


def knows(version: Version, name: str) -> bool:
    """Whether a controller of this version offers the output `name`."""
    if name not in OUTPUTS:
        return False
    if name not in _SINCE or version[0] >= 10:
        return True
    old, new = _SINCE[name]
    return version >= (old if version[0] == 3 else new)


def force_is_at_flange(version: Version) -> bool:
    """Whether the torque of `actual_TCP_force` is about the flange's origin; about the TCP on CB3, which has no sensor.

    Along the axes of the base on both. Source: Universal Robots ROS 2 driver, pull requests 1287 and 1615, where both
    were tried on robots. A sensor that is not the robot's own may be told of about the TCP (its issue 1849).
    """
    return version[0] > 3


def checked_number(name: str, index: float, value: float) -> tuple[int, float]:
    """Which number of the output `name`, and a value that can be sent for it; raises ValueError where it cannot be."""
    form = FORMATS[OUTPUTS[name]]
    count, kind = int(form[:-1] or 1), form[-1]
    if index not in range(count):
        raise ValueError(f"index = {index} must be a whole number from 0 to {count - 1} for {name}")
    if kind != "d" and not float(value).is_integer():
        raise ValueError(f"value = {value} must be a whole number for {name}")
    number = float(value) if kind == "d" else int(value)
    try:
        struct.pack(f">{kind}", number)
    except struct.error as error:
        raise ValueError(f"value = {value} cannot be sent as {OUTPUTS[name]}, the kind of {name}: {error}") from error
    return int(index), number


def pack(kind: int, payload: bytes = b"") -> bytes:
    """A package with its header."""
    return struct.pack(">HB", 3 + len(payload), kind) + payload


def unpack_stream(buffer: bytearray) -> Iterator[Package]:
    """Take every whole package out of `buffer`; raises WireError on an impossible size."""
    while len(buffer) >= 3:
        size, kind = struct.unpack_from(">HB", buffer)
        if not 3 <= size <= LARGEST_PACKAGE:
            raise WireError(f"package size = {size} byte must be 3 to {LARGEST_PACKAGE}")
        if len(buffer) < size:
            return
        payload = bytes(buffer[3:size])
        del buffer[:size]
        yield Package(kind, payload)


def names_of(payload: bytes) -> list[str]:
    """The comma-separated names of a set-up request (a trailing comma is usual)."""
    return [name for name in payload.decode("ascii", "replace").split(",") if name]


class Recipe(NamedTuple):
    """Names and the struct that holds their values, in order."""

    names: tuple[str, ...]
    layout: struct.Struct
    places: tuple[int | slice, ...]  # of each name's value among the numbers

    @classmethod
    def of(cls, names: Iterable[str], table: Mapping[str, str]) -> Recipe:
        """The recipe for known names."""
        names = tuple(names)
        formats = [FORMATS[table[n]] for n in names]
        ends = accumulate(int(f[:-1] or 1) for f in formats)
        places = [
            end - 1 if len(f) == 1 else slice(end - int(f[:-1]), end) for f, end in zip(formats, ends, strict=True)
        ]
        return cls(names, struct.Struct(">" + "".join(formats)), tuple(places))

    def decode(self, data: bytes) -> dict[str, Value] | None:
        """Values by name; None when `data` is too short, the excess is ignored when it is too long."""
        if len(data) < self.layout.size:
            return None
        numbers = self.layout.unpack_from(data)
        return {name: numbers[place] for name, place in zip(self.names, self.places, strict=True)}

    def encode(self, recipe_id: int, values: Mapping[str, Value]) -> bytes:
        """A data package with the values of every name."""
        flat: list[float] = []
        for name, place in zip(self.names, self.places, strict=True):
            flat += values[name] if isinstance(place, slice) else (values[name],)  # type: ignore[arg-type]
        return pack(DATA, bytes((recipe_id,)) + self.layout.pack(*flat))

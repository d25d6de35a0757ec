# SPDX-License-Identifier: Apache-2.0
"""The RTDE codec without sockets: framing, recipes, and a client's set-up."""

import struct

import pytest

from seed_ur import rtde
from seed_ur.standin.controller import Controller
from seed_ur.standin.options import Options
from seed_ur.standin.rtde_session import Conversation


def test_packages_survive_any_cutting_of_the_stream() -> None:
    packages = [rtde.pack(ord("V"), b"\x00\x02"), rtde.pack(ord("v")), rtde.pack(ord("U"), bytes(300))]
    stream, buffer, found = b"".join(packages), bytearray(), []
    for i in range(len(stream)):
        buffer += stream[i : i + 1]
        found.extend(rtde.unpack_stream(buffer))
    assert [rtde.pack(*p) for p in found] == packages
    assert not buffer


@pytest.mark.parametrize("head", [b"\x00\x02V", b"\xff\xffV"])
def test_an_impossible_size_is_refused(head: bytes) -> None:
    with pytest.raises(rtde.WireError):
        list(rtde.unpack_stream(bytearray(head)))


def test_recipes_have_the_sizes_of_the_protocol() -> None:
    recipe = rtde.Recipe.of(
        ("timestamp", "actual_q", "runtime_state", "joint_mode", "actual_digital_input_bits"), rtde.OUTPUTS
    )
    assert recipe.layout.size == 8 + 48 + 4 + 24 + 8
    values = {
        "timestamp": 1.5,
        "actual_q": tuple(range(6)),
        "runtime_state": 2,
        "joint_mode": (253,) * 6,
        "actual_digital_input_bits": 9,
    }
    package = recipe.encode(1, values)
    assert recipe.decode(package[4:]) == values
    assert recipe.decode(package[4:-1]) is None


def test_set_up_answers_types_unknown_names_and_owners() -> None:
    robot = Controller(Options())
    first, second = Conversation(robot), Conversation(robot)
    ask = rtde.Package(rtde.SETUP_INPUTS, b"input_int_register_0,input_double_register_0,")
    assert first.handle(ask, 0.0)[3:] == b"\x01INT32,DOUBLE"
    assert second.handle(ask, 0.0)[3:] == b"\x00IN_USE,IN_USE"
    first.close()
    assert second.handle(ask, 0.0)[3:] == b"\x01INT32,DOUBLE"
    outputs = struct.pack(">d", 125.0) + b"timestamp,nonsense,actual_current_as_torque"
    assert second.handle(rtde.Package(rtde.SETUP_OUTPUTS, outputs), 0.0)[4:] == b"DOUBLE,NOT_FOUND,NOT_FOUND"
    assert rtde.knows((5, 23, 0, 0), "actual_current_as_torque")

# SPDX-License-Identifier: Apache-2.0
"""The upper RTDE registers where ur_rtde can use them, and a word where they were asked for and cannot be had."""

import pytest

from seed_driver.robot.link import LinkError
from seed_driver.robot.registers import command, offset
from seed_ur.rtde import knows


@pytest.mark.parametrize(
    ("version", "first"),
    [
        ((3, 8, 0, 0), 0),
        ((3, 15, 8, 0), 24),
        ((5, 4, 2, 0), 24),
        ((5, 22, 1, 0), 24),
        ((5, 23, 0, 0), 0),
        ((10, 10, 0, 0), 0),
    ],
)
def test_auto_takes_the_upper_registers_where_it_can(version, first: int) -> None:
    assert offset("auto", version) == first
    assert offset("lower", version) == 0
    if first:
        assert offset("upper", version) == 24
    else:
        with pytest.raises(LinkError, match=f"PolyScope {version[0]}.{version[1]}: set registers to auto or lower"):
            offset("upper", version)


def test_the_command_register_is_named_as_rtde_does() -> None:
    assert command(24) == "input_int_register_24"


@pytest.mark.parametrize(
    ("version", "known"),
    [
        ((3, 12, 2, 9), False),
        ((3, 12, 3, 0), True),
        ((5, 5, 0, 9), False),
        ((5, 5, 1, 0), True),
        ((10, 10, 0, 0), True),
    ],
)
def test_the_tcp_is_told_from_3_12_3_and_5_5_1_on(version, known: bool) -> None:
    assert knows(version, "tcp_offset") is known

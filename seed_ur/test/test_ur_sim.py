# SPDX-License-Identifier: Apache-2.0
"""The stand-in's command line: which addresses and versions it takes."""

import signal

import pytest

from seed_core.errors import SeedError
from seed_ur.standin_client import StandIn
from seed_ur.ur_sim import loopback, main, version


def test_only_loopback_is_served_unless_told_otherwise() -> None:
    assert loopback("127.0.0.7", anywhere=False) == "127.0.0.7"
    assert loopback("0.0.0.0", anywhere=True) == "0.0.0.0"
    for host in ("0.0.0.0", "192.168.1.5", "::"):
        with pytest.raises(SeedError, match="not a loopback address; add --anywhere"):
            loopback(host, anywhere=False)
    assert main(["--host", "0.0.0.0"]) == 2


def test_versions_are_read_and_nonsense_is_refused() -> None:
    assert version("5.12.4") == (5, 12, 4, 1101319)
    assert version("3.15.8.1") == (3, 15, 8, 1)
    for text in ("6.1", "abc", "5", "5.12.4.x"):
        with pytest.raises(SeedError, match=rf"version = '{text}' must be major.minor"):
            version(text)


@pytest.mark.realtime
@pytest.mark.parametrize(("words", "code"), [((), 130), (("--ros-args", "-r", "__node:=ur_controller"), 0)])
def test_ctrl_c_ends_the_command_with_130_and_the_node_of_a_launch_file_with_0(
    words: tuple[str, ...], code: int
) -> None:
    with StandIn(None, *words) as robot:
        assert robot.process is not None
        robot.process.send_signal(signal.SIGINT)
        assert robot.process.wait(timeout=10.0) == code


@pytest.mark.realtime
def test_a_second_one_at_the_same_address_says_that_there_is_one(capsys: pytest.CaptureFixture[str]) -> None:
    with StandIn() as robot:
        assert main(["--host", robot.host]) == 2
        assert "is another stand-in there?" in capsys.readouterr().err

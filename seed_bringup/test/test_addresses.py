# SPDX-License-Identifier: Apache-2.0
"""A launch at an address of another computer is refused, before any node starts."""

import socket
from pathlib import Path

import pytest

from seed_bringup.commands.launch import checked_arguments
from seed_bringup.launching.addresses import check_own, is_standin, of_interfaces
from seed_bringup.launching.launch_xml import LaunchError

LAUNCH = Path(__file__).resolve().parents[1] / "launch"
ELSEWHERE = "203.0.113.251"  # of documents: nobody's


def test_the_interfaces_are_those_of_the_system() -> None:
    found = of_interfaces()
    assert found["127.0.0.1"] == "lo"
    assert set(found.values()) <= {name for _, name in socket.if_nameindex()}
    for address in found:
        check_own(address)


def test_the_stand_in_is_at_an_address_of_loopback_and_at_no_name() -> None:
    """A name may be that of a robot behind a tunnel."""
    assert all(is_standin(host) for host in ("127.0.0.1", "127.200.3.4"))
    others = (ELSEWHERE, "localhost", "::1", "127.example.com", "127.0.0.1.example.com", "128.0.0.1", "127.", "")
    assert not any(is_standin(host) for host in others)


@pytest.mark.parametrize("address", [ELSEWHERE, "192.168.9.300", "camera-host", "::1"])
def test_an_address_that_no_interface_has_is_refused_with_those_that_there_are(address: str) -> None:
    with pytest.raises(LaunchError, match=f"^address:={address}: no network interface of this computer has it") as e:
        check_own(address)
    others = [a for a in of_interfaces() if not a.startswith("127.")]
    assert all(f"{a} (" in str(e.value) for a in others)
    assert others or str(e.value).endswith("it has none")


@pytest.mark.parametrize("file", ["camera_host", "robot_host", "cell", "perception"])
def test_a_launch_at_such_an_address_is_refused(file: str) -> None:
    pytest.importorskip("ament_index_python", reason="the workspace is not built (./seed test does it)")
    with pytest.raises(LaunchError, match=f"^address:={ELSEWHERE}"):
        checked_arguments(LAUNCH / f"{file}_launch.xml", {"address": ELSEWHERE}).__enter__()
    with checked_arguments(LAUNCH / f"{file}_launch.xml", {"address": "127.0.0.1"}):
        pass

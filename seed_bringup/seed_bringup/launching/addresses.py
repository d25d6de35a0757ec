# SPDX-License-Identifier: Apache-2.0
"""Addresses of this computer: of its interfaces, of the stand-in controller, and those at which nodes listen."""

import array
import fcntl
import os
import socket
import struct
from ipaddress import IPv4Address

from seed_bringup.launching.launch_xml import LaunchError
from seed_bringup.launching.packages import package_share

SIOCGIFCONF = 0x8912  # of Linux: the interfaces that have an IPv4 address
ENTRY = 40  # [bytes] of each
MOST = 256


def of_interfaces() -> dict[str, str]:
    """IPv4 addresses, and the name of the interface that has each."""
    space = array.array("B", bytes(MOST * ENTRY))
    start, length = space.buffer_info()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        answer = fcntl.ioctl(asked.fileno(), SIOCGIFCONF, struct.pack("iL", length, start))
    data = space.tobytes()[: struct.unpack("iL", answer)[0]]
    entries = (data[i : i + ENTRY] for i in range(0, len(data), ENTRY))
    return {socket.inet_ntoa(e[20:24]): e[:16].partition(b"\0")[0].decode() for e in entries}


def is_standin(host: str) -> bool:
    """Whether the launch files start the stand-in there: an address 127.x.y.z; no name, be it localhost."""
    try:
        return IPv4Address(host).is_loopback
    except ValueError:
        return False


def check_own(address: str) -> None:
    """Raise LaunchError unless nodes can listen at an address here; it names those at which they could."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tried:
            tried.bind((str(IPv4Address(address)), 0))
    except (OSError, ValueError) as error:
        there = ", ".join(f"{a} ({name})" for a, name in of_interfaces().items() if not a.startswith("127."))
        raise LaunchError(
            f"address:={address}: no network interface of this computer has it: it has {there or 'none'}"
        ) from error


def listening_as(profile: str) -> dict[str, str]:
    """The variable that gives a process one of our profiles of Fast DDS, as launch/parts/network.xml does."""
    name = "FASTRTPS" if os.environ.get("ROS_DISTRO", "jazzy") == "jazzy" else "FASTDDS"  # the latter: Fast DDS 3
    return {f"{name}_DEFAULT_PROFILES_FILE": str(package_share("seed_bringup") / "config" / profile)}

# SPDX-License-Identifier: Apache-2.0
"""The sockets that ur_rtde has opened in this process, and what it cannot be told to do with them."""

import contextlib
import os
import socket
from collections.abc import Iterator

from seed_driver.robot.link import LinkError

SCRIPT_PORT = 30003
TIMEOUT = 0.5  # [s] to connect


def _connections(port: int) -> Iterator[socket.socket]:
    """Every connection of this process to a `port`; valid until the next one is asked for."""
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):  # no socket, or not connected
            connection = socket.socket(fileno=int(name))
            try:
                if connection.family == socket.AF_INET and connection.getpeername()[1] == port:
                    yield connection
            finally:
                connection.detach()


def send_at_once(port: int) -> None:
    """Have no connection of this process to a `port` hold small packages back until the last one is acknowledged.

    ur_rtde leaves that on (Nagle's algorithm): its commands would wait for the next package of data from the robot.
    """
    for connection in _connections(port):
        with contextlib.suppress(OSError):  # closed meanwhile
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


class ScriptConnection:
    """ur_rtde's connection for programs, of which it has one for ever.

    A robot that is switched to local control closes those it has, and takes no program from one made in local control
    either, even when it is back in remote control; ur_rtde takes what it writes there for sent. Sources: Universal
    Robots, "Remote Control Via TCP/IP"; its ROS driver, issue 459; primary_client.cpp of its client library (C210).
    """

    def __init__(self) -> None:
        """Find it, as ur_rtde has just made it."""
        self._found = [(c.fileno(), _identity(c.fileno())) for c in _connections(SCRIPT_PORT)]

    def renew(self, host: str) -> None:
        """Put a new connection in its place; raises LinkError where the robot takes none."""
        for i, (number, identity) in enumerate(self._found):
            if _identity(number) != identity:
                raise LinkError("ur_rtde's connection for programs is gone: restart the driver")
            try:
                with socket.create_connection((host, SCRIPT_PORT), TIMEOUT) as fresh:
                    fresh.setblocking(True)  # a time-out would be ur_rtde's, too
                    fresh.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    os.dup2(fresh.fileno(), number, inheritable=False)
            except OSError as error:
                raise LinkError(f"no scripts are taken at {host}:{SCRIPT_PORT} ({error})") from error
            self._found[i] = number, _identity(number)


def _identity(number: int) -> int:
    """Which socket a file descriptor is; 0: none."""
    try:
        return os.fstat(number).st_ino
    except OSError:
        return 0

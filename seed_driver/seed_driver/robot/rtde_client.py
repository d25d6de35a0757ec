# SPDX-License-Identifier: Apache-2.0
"""A small RTDE client with time-outs, and the checks of a controller before ur_rtde is let near it.

ur_rtde's constructors wait for ever on a port that accepts and says nothing, and fail after 5 s without naming the
reason when the robot is in a safety stop. Everything here answers within its time-out or raises LinkError.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator, Sequence

from seed_driver.robot.dashboard import dashboard
from seed_driver.robot.link import LinkError
from seed_ur import rtde

PORT = 30004
TIMEOUT = 0.5  # [s]
OLDEST = {3: (3, 10), 5: (5, 4), 10: (10, 10)}  # first supported release of each line
COMMAND_REGISTER = "input_int_register_0"  # ur_rtde tells its script through it what to do
READ_ONCE_RATE = 125.0  # [Hz] any will do


class RtdeClient:
    """One RTDE connection with time-outs; a context manager."""

    def __init__(self, host: str, timeout: float = TIMEOUT) -> None:
        self.host = host
        self._received = bytearray()
        try:
            self._socket = socket.create_connection((host, PORT), timeout)
        except (OSError, UnicodeError) as error:  # the latter from names that cannot be one of a host
            raise LinkError(f"no controller at {host}:{PORT} ({error}); check robot_ip, cable and power") from error

    def __enter__(self) -> RtdeClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def ask(self, kind: int, payload: bytes = b"") -> bytes:
        """Send one package and wait for the reply of the same kind."""
        try:
            self._socket.sendall(rtde.pack(kind, payload))
            return self._next(kind)
        except (OSError, rtde.WireError) as error:
            raise LinkError(f"{self.host}:{PORT} does not speak RTDE ({error}); is it a UR controller?") from error

    def _next(self, kind: int) -> bytes:
        """The next package of a kind; others are skipped."""
        for _ in range(100):
            while (package := next(rtde.unpack_stream(self._received), None)) is None:
                more = self._socket.recv(rtde.LARGEST_PACKAGE)
                if not more:
                    raise OSError("connection closed")
                self._received += more
            if package.kind == kind:
                return package.payload
        raise OSError("no answer")

    def version(self) -> rtde.Version:
        """Agree on protocol 2; (major, minor, bugfix, build) of PolyScope."""
        if self.ask(rtde.REQUEST_VERSION, b"\x00\x02") != b"\x01":
            raise LinkError(f"{self.host} refuses RTDE protocol 2: its software is too old")
        major, minor, bugfix, build = struct.unpack(">4I", self.ask(rtde.CONTROLLER_VERSION))
        return major, minor, bugfix, build

    def start(self, names: Sequence[str], rate: float) -> rtde.Recipe:
        """Have the outputs `names` sent at `rate` [Hz]; how their values are packed."""
        reply = self.ask(rtde.SETUP_OUTPUTS, struct.pack(">d", rate) + ",".join(names).encode())
        kinds = reply[1:].decode("ascii", "replace").split(",")
        if rtde.NOT_FOUND in kinds:
            unknown = names[kinds.index(rtde.NOT_FOUND)]
            raise LinkError(f"{self.host} does not know the RTDE output {unknown}")
        recipe = rtde.Recipe.of(names, dict(zip(names, kinds, strict=True)))
        if kinds != [rtde.OUTPUTS[n] for n in names]:
            raise LinkError(f"{self.host} offers other states than expected: {','.join(kinds)}")
        self.ask(rtde.START)
        return recipe

    def values(self) -> bytes:
        """The packed values of the next data package."""
        try:
            return self._next(rtde.DATA)[1:]
        except (OSError, rtde.WireError) as error:
            raise LinkError(f"{self.host} answers but sends no data ({error}); restart the controller") from error

    def read_once(self, *names: str) -> list[float]:
        """One sample of scalar outputs."""
        recipe = self.start(names, READ_ONCE_RATE)
        return list(recipe.layout.unpack(self.values()))

    def take_inputs(self, *names: str) -> bool:
        """Become the one who writes these inputs until the connection closes; False when somebody else is."""
        return rtde.IN_USE.encode() not in self.ask(rtde.SETUP_INPUTS, ",".join(names).encode())

    def send(self, package: bytes) -> None:
        """Send a whole package, and wait for no answer."""
        try:
            self._socket.sendall(package)
        except OSError as error:
            raise LinkError(f"{self.host} has closed the connection ({error})") from error

    def never_wait(self) -> None:
        """From now on only `arrived` and `send`. A time-out would make even a read with MSG_DONTWAIT wait for it."""
        self._socket.setblocking(False)

    def arrived(self) -> Iterator[rtde.Package]:
        """Packages that are here already; only after `never_wait`. Raises OSError or WireError at the end."""
        try:
            more = self._socket.recv(65_536)
        except BlockingIOError:
            return
        if not more:
            raise OSError("connection closed")
        self._received += more
        yield from rtde.unpack_stream(self._received)


def supported_version(host: str) -> rtde.Version:
    """The PolyScope version of the controller at `host`; raises LinkError when it cannot be used at all."""
    with RtdeClient(host) as client:
        version = client.version()
        oldest = OLDEST.get(version[0])
        if oldest is None or version[:2] < oldest:
            known = ", ".join(f"{a}.{b}" for a, b in OLDEST.values())
            raise LinkError(
                f"PolyScope {version[0]}.{version[1]} at {host} is not supported; it needs at least {known}"
            )
        client.read_once("robot_mode")  # a controller may answer and send no data
        return version


def require_control(host: str, version: rtde.Version) -> None:
    """Raise LinkError unless programs may be sent: registers free, robot in remote control."""
    with RtdeClient(host) as client:
        client.version()
        if not client.take_inputs(COMMAND_REGISTER):
            raise LinkError(f"another RTDE client holds the input registers of {host}: stop that program")
    remote_is_known = version[0] == 5 and version[1] >= 6
    if remote_is_known and "true" not in dashboard(host, "is in remote control"):
        raise LinkError(f"the robot at {host} is in local control: switch it to remote control on the pendant")


def command_register(host: str) -> int | None:
    """The content of the command register; None when the controller does not show it."""
    with RtdeClient(host) as client:
        client.version()
        try:
            return int(client.read_once(COMMAND_REGISTER)[0])
        except LinkError:
            return None

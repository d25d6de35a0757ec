# SPDX-License-Identifier: Apache-2.0
"""A small RTDE and dashboard client with time-outs, to look before ur_rtde leaps.

ur_rtde's constructors wait for ever on a port that accepts and says nothing, and fail after 5 s without naming the
reason when the robot is in a safety stop. Everything here answers within its time-out or raises LinkError.
"""

from __future__ import annotations

import re
import socket
import struct
from collections.abc import Sequence
from types import TracebackType
from typing import NamedTuple

from seed_core.errors import FailedError

RTDE_PORT, DASHBOARD_PORT = 30004, 29999
TIMEOUT = 0.5  # [s]
OLDEST = {3: (3, 10), 5: (5, 4), 10: (10, 10)}  # first supported release of each line
_FORMATS = {"DOUBLE": "d", "INT32": "i", "UINT32": "I", "VECTOR6D": "6d"}


class LinkError(FailedError):
    """The controller cannot be used as it is; the message says why and what to do."""


class Look(NamedTuple):
    """What a controller says about itself."""

    version: tuple[int, int, int, int]
    robot_mode: int
    safety_bits: int
    runtime_state: int


class MiniRtde:
    """One RTDE connection with time-outs; a context manager."""

    def __init__(self, host: str, timeout: float = TIMEOUT) -> None:
        self.host = host
        try:
            self._socket = socket.create_connection((host, RTDE_PORT), timeout)
        except (OSError, UnicodeError) as error:  # the latter from names that cannot be one of a host
            raise LinkError(
                f"no controller at {host}:{RTDE_PORT} ({error}); check robot_ip, cable and power"
            ) from error
        self._socket.settimeout(timeout)

    def __enter__(self) -> MiniRtde:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()

    def ask(self, kind: str, payload: bytes = b"") -> bytes:
        """Send one package and wait for the reply of the same kind."""
        try:
            self._socket.sendall(struct.pack(">HB", 3 + len(payload), ord(kind)) + payload)
            return self.receive(kind)
        except OSError as error:
            raise LinkError(f"{self.host}:{RTDE_PORT} does not speak RTDE ({error}); is it a UR controller?") from error

    def send(self, data: bytes) -> None:
        """Send a data package (recipe number, then values)."""
        try:
            self._socket.sendall(struct.pack(">HB", 3 + len(data), ord("U")) + data)
        except OSError as error:
            raise LinkError(f"{self.host} has closed the connection ({error})") from error

    def receive(self, kind: str) -> bytes:
        """The next package of a kind; others are skipped."""
        for _ in range(100):
            size, got = struct.unpack(">HB", self._exactly(3))
            payload = self._exactly(size - 3)
            if got == ord(kind):
                return payload
        raise OSError("no answer")

    def _exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = self._socket.recv(count - len(data))
            if not more:
                raise OSError("connection closed")
            data += more
        return data

    def never_wait(self) -> None:
        """From now on only `arrived` and `send`. A time-out would make even a read with MSG_DONTWAIT wait for it."""
        self._socket.setblocking(False)

    def arrived(self, most: int) -> bytes | None:
        """Bytes that are here already; None when the connection is over. Only after `never_wait`."""
        try:
            return self._socket.recv(most) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def version(self) -> tuple[int, int, int, int]:
        """Agree on protocol 2; (major, minor, bugfix, build) of PolyScope."""
        if self.ask("V", b"\x00\x02") != b"\x01":
            raise LinkError(f"{self.host} refuses RTDE protocol 2: its software is too old")
        major, minor, bugfix, build = struct.unpack(">4I", self.ask("v"))
        return major, minor, bugfix, build

    def read_once(self, names: Sequence[str]) -> list[float]:
        """One sample of scalar outputs."""
        reply = self.ask("O", struct.pack(">d", 125.0) + ",".join(names).encode())
        kinds = reply[1:].decode().split(",")
        if "NOT_FOUND" in kinds:
            raise LinkError(f"{self.host} does not know the RTDE output {names[kinds.index('NOT_FOUND')]}")
        self.ask("S")
        try:
            data = self.receive("U")
        except OSError as error:
            raise LinkError(f"{self.host} answers but sends no data ({error}); restart the controller") from error
        return list(struct.unpack(">" + "".join(_FORMATS[k] for k in kinds), data[1:]))

    def input_free(self, name: str) -> bool:
        """Whether nobody else writes the input register `name` (this connection takes it until it closes)."""
        return b"IN_USE" not in self.ask("I", name.encode())


def look(host: str) -> Look:
    """Version and state of the controller at `host`; raises LinkError when it cannot be used at all."""
    with MiniRtde(host) as rtde:
        version = rtde.version()
        oldest = OLDEST.get(version[0])
        if oldest is None or version[:2] < oldest:
            known = ", ".join(f"{a}.{b}" for a, b in OLDEST.values())
            raise LinkError(
                f"PolyScope {version[0]}.{version[1]} at {host} is not supported; it needs at least {known}"
            )
        mode, bits, runtime = rtde.read_once(("robot_mode", "safety_status_bits", "runtime_state"))
        return Look(version, int(mode), int(bits), int(runtime))


def require_control(host: str, version: tuple[int, int, int, int]) -> None:
    """Raise LinkError unless programs may be sent: registers free, robot in remote control."""
    with MiniRtde(host) as rtde:
        rtde.version()
        if not rtde.input_free("input_int_register_0"):
            raise LinkError(f"another RTDE client holds the input registers of {host}: stop that program")
    remote_is_known = version[0] == 5 and version[1] >= 6
    if remote_is_known and "true" not in dashboard(host, "is in remote control"):
        raise LinkError(f"the robot at {host} is in local control: switch it to remote control on the pendant")


def command_register(host: str) -> int | None:
    """What stands in the command register; None when the controller does not show it."""
    with MiniRtde(host) as rtde:
        rtde.version()
        try:
            return int(rtde.read_once(("input_int_register_0",))[0])
        except LinkError:
            return None


def dashboard(host: str, *commands: str, timeout: float = TIMEOUT) -> str:
    """Send dashboard commands in turn; the answer to the last one. Raises LinkError."""
    try:
        with socket.create_connection((host, DASHBOARD_PORT), timeout) as connection:
            connection.settimeout(timeout)
            with connection.makefile("rwb") as file:
                answer = file.readline()
                for command in commands:
                    file.write(command.encode() + b"\n")
                    file.flush()
                    answer = file.readline()
    except OSError as error:
        raise LinkError(f"no dashboard at {host}:{DASHBOARD_PORT} ({error})") from error
    return re.sub(r"\s+", " ", answer.decode("utf-8", "replace")).strip()

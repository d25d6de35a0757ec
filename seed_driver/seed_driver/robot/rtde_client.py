# SPDX-License-Identifier: Apache-2.0
"""A small RTDE client with time-outs, and the checks of a controller before ur_rtde is let near it.

ur_rtde's constructors wait for ever on a port that accepts and says nothing, and fail after 5 s without naming the
reason when the robot is in a safety stop; its receiver costs three times as much as this one, and a thread. Everything
here answers within its time-out or raises LinkError.
"""

from __future__ import annotations

import math
import socket
import struct
import time
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

from seed_driver.robot.dashboard import LOCAL_CONTROL, dashboard
from seed_driver.robot.link import PLAYING, AbsentError, LinkError
from seed_ur import rtde

PORT = 30004
TIMEOUT = 0.5  # [s]
OLDEST = {3: (3, 10), 5: (5, 4), 10: (10, 10)}  # first supported release of each line
ONCE = 125.0  # [Hz] of outputs of which one sample is read
LONGEST_ROUND_TRIP = 0.05  # [s] of a question and its answer; a robot that is heard later counts as lost
STOP_SCRIPT = 255  # in the command register: ur_rtde's script ends
ENDING = 0.4  # [s] for it, or for the watchdog of a driver that has died


class RtdeClient:
    """One RTDE connection; a context manager.

    Attributes:
        version: PolyScope's (major, minor, bugfix, build).
        values: the newest outputs by RTDE's names, units as in UR's RTDE guide; from `start` on.
        packages: how many times new ones have come.
        round_trip: quickest answer to a question so far [s]; a busy machine may be late once.
        open: False from the end of the connection on, as far as `poll` has seen.
    """

    def __init__(self, host: str, timeout: float = TIMEOUT) -> None:
        """Connect and agree on protocol 2; raises LinkError. timeout: [s] of each answer."""
        self.host, self.open, self.packages, self.round_trip = host, True, 0, math.inf
        self.values: Mapping[str, Any] = {}
        self._recipe = rtde.Recipe.of((), rtde.OUTPUTS)
        self._received = bytearray()
        try:
            self._socket = socket.create_connection((host, PORT), timeout)
        except (OSError, UnicodeError) as error:  # the latter from names that cannot be one of a host
            raise AbsentError(f"no controller at {host}:{PORT} ({error}); check robot_ip, cable and power") from error
        try:
            if self.ask(rtde.REQUEST_VERSION, b"\x00\x02") != b"\x01":
                raise LinkError(f"{host} refuses RTDE protocol 2: its software is too old")
            major, minor, bugfix, build = struct.unpack(">4I", self.ask(rtde.CONTROLLER_VERSION))
        except BaseException:
            self._socket.close()
            raise
        self.version: rtde.Version = major, minor, bugfix, build

    def __enter__(self) -> RtdeClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the connection."""
        self._socket.close()

    def ask(self, kind: int, payload: bytes = b"") -> bytes:
        """Send one package and wait for the reply of the same kind."""
        asked = time.monotonic()
        try:
            self._socket.sendall(rtde.pack(kind, payload))
            answer = self._next(kind)
        except (OSError, rtde.WireError) as error:
            raise AbsentError(f"{self.host}:{PORT} does not speak RTDE ({error}); is it a UR controller?") from error
        self.round_trip = min(self.round_trip, time.monotonic() - asked)
        return answer

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

    def start(self, names: Sequence[str], rate: float, optional: Collection[str] = ()) -> None:
        """Have the outputs `names` sent at `rate` [Hz], and wait for the first; optional ones may be unknown."""
        kinds = self._set_up(names, rate)
        if rtde.NOT_FOUND in kinds and optional:
            found = zip(names, kinds, strict=True)
            names = [n for n, kind in found if kind != rtde.NOT_FOUND or n not in optional]
            kinds = self._set_up(names, rate)
        if rtde.NOT_FOUND in kinds:
            unknown = names[kinds.index(rtde.NOT_FOUND)]
            raise LinkError(f"{self.host} does not know the RTDE output {unknown}")
        self._recipe = rtde.Recipe.of(names, dict(zip(names, kinds, strict=True)))
        if kinds != [rtde.OUTPUTS[n] for n in names]:
            raise LinkError(f"{self.host} offers other states than expected: {','.join(kinds)}")
        self.ask(rtde.START)
        try:
            self._take(self._next(rtde.DATA))
        except (OSError, rtde.WireError) as error:
            raise AbsentError(f"{self.host} answers but sends no data ({error}); restart the controller") from error

    def _set_up(self, names: Sequence[str], rate: float) -> list[str]:
        """Ask for outputs; their types, or rtde.NOT_FOUND."""
        reply = self.ask(rtde.SETUP_OUTPUTS, struct.pack(">d", rate) + ",".join(names).encode())
        kinds = reply[1:].decode("ascii", "replace").split(",")
        if len(kinds) != len(names):
            raise LinkError(
                f"{self.host} tells {len(kinds)} types of {len(names)} RTDE outputs ({','.join(kinds)}): "
                "is it a UR controller?"
            )
        return kinds

    def _take(self, payload: bytes) -> None:
        values = self._recipe.decode(payload[1:])
        if values is None:
            raise ValueError(f"{len(payload)} byte of outputs, not {1 + self._recipe.layout.size}")
        self.values = values

    def never_wait(self) -> None:
        """From now on only `poll` and `send`. A time-out would make even a read with MSG_DONTWAIT wait for it."""
        self._socket.setblocking(False)

    def poll(self) -> None:
        """Take the newest of what has arrived; only after `never_wait`."""
        newest = b""
        try:
            more = self._socket.recv(65_536)
            self.open &= bool(more)
            self._received += more
            for package in rtde.unpack_stream(self._received):
                if package.kind == rtde.DATA and len(package.payload) == 1 + self._recipe.layout.size:
                    newest = package.payload
        except BlockingIOError:
            return
        except (OSError, rtde.WireError):
            self.open = False
        if newest:
            self.packages += 1
            self._take(newest)

    def take_inputs(self, *names: str) -> bool:
        """Become the one who writes these inputs until the connection closes; False when somebody else is."""
        return rtde.IN_USE.encode() not in self.ask(rtde.SETUP_INPUTS, ",".join(names).encode())

    def send(self, package: bytes) -> None:
        """Send a whole package, and wait for no answer."""
        try:
            self._socket.sendall(package)
        except OSError as error:
            raise LinkError(f"{self.host} has closed the connection ({error})") from error


def follow_outputs(host: str, names: Sequence[str], rate: float, optional: Collection[str] = ()) -> RtdeClient:
    """A client that gets those of the outputs `names` that the controller knows, at `rate` [Hz], and never waits.

    Which those are its version tells. Of the optional ones its answer does too: releases may differ from UR's table.
    """
    with ExitStack() as on_failure:
        client = on_failure.enter_context(RtdeClient(host))
        client.start([n for n in names if rtde.knows(client.version, n)], rate, optional)
        client.never_wait()
        on_failure.pop_all()
        return client


def hold_inputs(host: str, names: Sequence[str], words: str) -> RtdeClient:
    """A client that alone writes these inputs; LinkError, with `words` for them, when somebody else does.

    A fieldbus that is switched on takes them as well (UR's ROS driver, issue 204), and after a cut cable the robot
    keeps an old connection until it hears of its end.
    """
    with ExitStack() as on_failure:
        client = on_failure.enter_context(RtdeClient(host))
        if not client.take_inputs(*names):
            raise LinkError(
                f"another RTDE client holds {words} of {host}: stop that program, or EtherNet/IP, PROFINET and MODBUS "
                "in the robot's installation; after a cut cable ask again in some seconds"
            )
        on_failure.pop_all()
        return client


def supported_version(host: str) -> rtde.Version:
    """The PolyScope version of the controller at `host`; raises LinkError when it cannot be used at all."""
    with RtdeClient(host) as client:
        version = client.version
        oldest = OLDEST.get(version[0])
        if oldest is None or version[:2] < oldest:
            known = ", ".join(f"{a}.{b}" for a, b in OLDEST.values())
            raise LinkError(
                f"PolyScope {version[0]}.{version[1]} at {host} is not supported; it needs at least {known}"
            )
        client.start(("robot_mode",), ONCE)  # a controller may answer and send no data
        if client.round_trip > LONGEST_ROUND_TRIP:
            raise LinkError(
                f"{host} takes {1e3 * client.round_trip:.0f} ms to answer (limit {1e3 * LONGEST_ROUND_TRIP:.0f} ms): "
                "connect this machine to the robot's network by cable"
            )
        return version


def require_control(host: str, version: rtde.Version, register: str) -> None:
    """Raise LinkError unless programs may be sent: registers free, robot in remote control."""
    with hold_inputs(host, (register,), "the input registers"):
        pass
    require_remote(host, version)


def require_remote(host: str, version: rtde.Version) -> None:
    """Raise LinkError when the robot is in local control, as far as its version tells."""
    remote_is_known = version[0] == 5 and version[1] >= 6
    if remote_is_known and "true" not in dashboard(host, "is in remote control"):
        raise LinkError(f"the robot at {host} is {LOCAL_CONTROL}")


def end_orphan(host: str, command: str) -> None:
    """End a control script that nobody feeds any more; raises LinkError when what plays is another program."""
    with RtdeClient(host) as client:
        client.take_inputs(command)
        register = rtde.Recipe.of((command,), rtde.INPUTS)
        client.start(("runtime_state",), ONCE)
        client.send(register.encode(1, {command: STOP_SCRIPT}))
        client.never_wait()
        until = time.monotonic() + ENDING
        while (playing := client.values["runtime_state"] == PLAYING) and time.monotonic() < until:
            time.sleep(0.01)
            client.poll()
        client.send(register.encode(1, {command: 0}))
    if playing:
        raise LinkError(
            f"another program plays on the robot at {host} ({_program(host)}): stop it on the pendant, or let it end"
        )


def _program(host: str) -> str:
    """What the dashboard says of the program that plays."""
    try:
        return dashboard(host, "programState")
    except LinkError:  # PolyScope X has none
        return "its name is not told"


def command_register(host: str, register: str) -> int | None:
    """The content of this integer register; None when the controller does not show it."""
    with RtdeClient(host) as client:
        try:
            client.start((register,), ONCE)
        except LinkError:
            return None
        return int(client.values[register])

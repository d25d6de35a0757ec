# SPDX-License-Identifier: Apache-2.0
"""One TCP connection of each kind: what arrives is handed on, what is due is sent without ever blocking."""

from __future__ import annotations

import socket
import time
from collections import deque
from typing import TYPE_CHECKING

from seed_ur import rtde as wire
from seed_ur.standin import dashboard
from seed_ur.standin import side_port as side
from seed_ur.standin.rtde_session import Conversation

if TYPE_CHECKING:
    from seed_ur.standin.server import Server

SLOW_READER = 500  # output packages that may be lost in a row before the connection is closed (1 s)
LONGEST_SCRIPT = 2_000_000  # [byte]


class Channel:
    """A connection; subclasses say what the bytes mean."""

    def __init__(self, server: Server, connection: socket.socket) -> None:
        self.server, self.socket = server, connection
        self.buffer = bytearray()
        self.open = True

    def read(self) -> bool:
        """Take what has arrived; False when the connection is over."""
        try:
            data = self.socket.recv(65_536)
        except BlockingIOError:
            return True
        except OSError:
            return False
        if not data:
            self.finished()
            return False
        self.buffer += data
        self.received()
        return self.open

    def received(self) -> None:
        """New bytes are in the buffer."""

    def finished(self) -> None:
        """The client has closed."""

    def cycle(self, now: float, paused: bool) -> bool:  # noqa: ARG002
        """Called every 2 ms; False closes the connection."""
        return self.open

    def text(self, text: str) -> None:
        """A message for the user of this connection."""

    def send(self, data: bytes) -> bool:
        """False when the client does not read."""
        try:
            return self.socket.send(data) == len(data)
        except BlockingIOError:
            return False
        except OSError:
            self.open = False
            return False

    def close(self) -> None:
        """Close the socket."""
        self.open = False
        self.socket.close()

    def lines(self) -> list[bytes]:
        """Whole lines taken from the buffer."""
        *whole, rest = bytes(self.buffer).split(b"\n")
        self.buffer = bytearray(rest)
        if len(self.buffer) > side.LONGEST_LINE:
            self.open = False
        return whole


class Rtde(Channel):
    """Port 30004."""

    def __init__(self, server: Server, connection: socket.socket) -> None:
        super().__init__(server, connection)
        self.talk = Conversation(server.box, server.owners)
        self.lost = 0
        self.late: deque[tuple[float, bytes]] = deque()

    def received(self) -> None:
        if time.monotonic() < self.server.network.mute_until:
            self.buffer.clear()
            return
        try:
            for package in wire.unpack_stream(self.buffer):
                reply = self.talk.handle(package, self.server.robot_now)
                if reply:
                    self.send(reply)
        except wire.WireError:
            self.open = False

    def cycle(self, now: float, paused: bool) -> bool:
        package = self.talk.output()
        network = self.server.network
        if package and not paused and not (network.drop and network.rng.random() < network.drop):
            self.late.append((now + network.delay, package))
        while self.late and self.late[0][0] <= now:
            self._stream(self.late.popleft()[1])
        return self.open and self.lost < SLOW_READER

    def _stream(self, package: bytes) -> None:
        recorder = self.server.box.recorder
        if self.send(package):
            self.lost = 0
            recorder.outputs_sent += 1
        else:
            self.lost += 1
            recorder.outputs_dropped += 1

    def text(self, text: str) -> None:
        if self.talk.started:
            body, source = text.encode()[:200], b"stand-in"
            self.send(wire.pack(wire.TEXT, bytes((len(body),)) + body + bytes((len(source),)) + source + b"\x02"))

    def close(self) -> None:
        self.talk.close()
        super().close()


class Script(Channel):
    """Ports 30001 to 30003: a program ends with a line `end` and 10 ms of silence, or with the connection."""

    def __init__(self, server: Server, connection: socket.socket) -> None:
        super().__init__(server, connection)
        self.heard = 0.0

    def received(self) -> None:
        self.heard = time.monotonic()
        if len(self.buffer) > LONGEST_SCRIPT:
            self.open = False

    def finished(self) -> None:
        self._upload()

    def cycle(self, now: float, paused: bool) -> bool:  # noqa: ARG002
        if self.buffer and now - self.heard > 0.01 and self.buffer.rstrip().endswith(b"\nend"):
            self._upload()
        return self.open

    def _upload(self) -> None:
        text = self.buffer.decode("utf-8", "replace")
        self.buffer.clear()
        if text.strip():
            refused = self.server.box.upload(text, self.server.robot_now)
            if refused:
                self.server.box.send_text(refused)


class Dashboard(Channel):
    """Port 29999."""

    def __init__(self, server: Server, connection: socket.socket) -> None:
        super().__init__(server, connection)
        if time.monotonic() >= server.network.mute_until:
            self.send(dashboard.GREETING.encode())

    def received(self) -> None:
        for line in self.lines():
            if time.monotonic() < self.server.network.mute_until:
                return
            self.send(dashboard.answer(self.server.box, line.decode("utf-8", "replace")).encode() + b"\n")
            if line.strip() == b"quit":
                self.open = False


class Side(Channel):
    """Port 30099."""

    def received(self) -> None:
        for line in self.lines():
            reply = side.answer(self.server, line)
            self.socket.setblocking(True)
            self.socket.settimeout(1.0)
            try:
                self.socket.sendall(reply)
                self.socket.setblocking(False)
            except OSError:
                self.open = False

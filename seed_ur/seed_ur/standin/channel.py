# SPDX-License-Identifier: Apache-2.0
"""One connection to the stand-in, what it receives and sends without ever blocking, and the faults of its network."""

import random
import socket
import time
from dataclasses import dataclass, field

from seed_ur.standin.controller import Controller

LONGEST_LINE = 65_536  # [byte]


@dataclass
class Network:
    """Faults of the network; times are monotonic [s]."""

    silent_until: float = 0.0  # nothing is read or written, the arm goes on
    outputs_paused_until: float = 0.0
    mute_until: float = 0.0  # connections are accepted, nothing is answered
    no_data_until: float = 0.0  # set-up is answered, data never come
    delay: float = 0.0  # [s] of every output package
    drop: float = 0.0  # share of output packages lost
    freeze: float = 0.0  # [s] the whole process sleeps once
    rng: random.Random = field(default_factory=lambda: random.Random(5))

    @property
    def mute(self) -> bool:
        """Whether nothing is answered now."""
        return time.monotonic() < self.mute_until


class Channel:
    """A connection; subclasses say what the bytes mean."""

    name = ""  # by which open connections are counted
    outside = False  # whether faults of the network leave it alone

    def __init__(self, connection: socket.socket, robot: Controller, network: Network) -> None:
        self.socket, self.robot, self.network = connection, robot, network
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
        if len(self.buffer) > LONGEST_LINE:
            self.open = False
        return whole

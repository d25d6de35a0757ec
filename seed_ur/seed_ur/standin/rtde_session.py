# SPDX-License-Identifier: Apache-2.0
"""Port 30004: one client's RTDE conversation, its set-up requests answered, data packages taken, outputs sent."""

import socket
import struct
from collections import deque

from seed_ur import rtde
from seed_ur.rtde import Package, Recipe
from seed_ur.standin.channel import Channel, Network
from seed_ur.standin.controller import Controller

OUTPUT_RECIPE = 1
SLOW_READER = 500  # output packages that may be lost in a row before the connection is closed (1 s)


class Conversation:
    """State of one RTDE connection."""

    def __init__(self, robot: Controller) -> None:
        self.robot = robot
        self.outputs: Recipe | None = None
        self.inputs: list[Recipe] = []
        self.divider = 1
        self.started = False
        self._cycle = 0

    def handle(self, package: Package, now: float) -> bytes:
        """The reply to one package, empty for data and unknown kinds."""
        kind, payload = package
        match kind:
            case rtde.DATA:
                self._data(payload, now)
                return b""
            case rtde.REQUEST_VERSION:
                answer = bytes((payload == b"\x00\x02",))
            case rtde.CONTROLLER_VERSION:
                answer = struct.pack(">4I", *self.robot.options.version)
            case rtde.SETUP_OUTPUTS:
                answer = self._setup_outputs(payload)
            case rtde.SETUP_INPUTS:
                answer = self._setup_inputs(payload)
            case rtde.START | rtde.PAUSE:
                self.started, answer = kind == rtde.START, b"\x01"
            case _:
                return b""
        return rtde.pack(kind, answer)

    def close(self) -> None:
        """Give the inputs back."""
        self.robot.owners = {name: owner for name, owner in self.robot.owners.items() if owner is not self}

    def output(self) -> bytes:
        """The data package due in this cycle, or nothing."""
        self._cycle += 1
        if not self.started or self.outputs is None or self._cycle % self.divider:
            return b""
        return self.outputs.encode(OUTPUT_RECIPE, self.robot.outputs)

    def _setup_outputs(self, payload: bytes) -> bytes:
        if len(payload) < 8:
            return b"\x00"
        (frequency,) = struct.unpack_from(">d", payload)
        top = 500.0 if self.robot.options.version[0] > 3 else 125.0
        self.divider = max(1, round(500.0 / min(top, frequency))) if frequency > 0.0 else int(500.0 / top)
        names = rtde.names_of(payload[8:])
        version = self.robot.options.version
        kinds = [rtde.OUTPUTS[n] if rtde.knows(version, n) else rtde.NOT_FOUND for n in names]
        good = rtde.NOT_FOUND not in kinds
        self.outputs = Recipe.of(names, rtde.OUTPUTS) if good else None
        return bytes((OUTPUT_RECIPE if good else 0,)) + ",".join(kinds).encode()

    def _setup_inputs(self, payload: bytes) -> bytes:
        names = rtde.names_of(payload)
        kinds = [self._input_kind(n) for n in names]
        if rtde.NOT_FOUND in kinds or rtde.IN_USE in kinds:
            return b"\x00" + ",".join(kinds).encode()
        self.inputs.append(Recipe.of(names, rtde.INPUTS))
        return bytes((len(self.inputs),)) + ",".join(kinds).encode()

    def _input_kind(self, name: str) -> str:
        if name not in rtde.INPUTS:
            return rtde.NOT_FOUND
        free = self.robot.owners.setdefault(name, self) is self
        return rtde.INPUTS[name] if free else rtde.IN_USE

    def _data(self, payload: bytes, now: float) -> None:
        if not payload or not 1 <= payload[0] <= len(self.inputs):
            return
        values = self.inputs[payload[0] - 1].decode(payload[1:])
        if values is not None:
            self.robot.write_inputs(values, now)


class RtdeChannel(Channel):
    """A connection to port 30004."""

    name = "rtde"

    def __init__(self, connection: socket.socket, robot: Controller, network: Network) -> None:
        super().__init__(connection, robot, network)
        self.talk = Conversation(robot)
        self._lost = 0  # packages in a row that the client has not read
        self._late: deque[tuple[float, bytes]] = deque()  # when to send it

    def received(self) -> None:
        if self.network.mute:
            self.buffer.clear()
            return
        try:
            for package in rtde.unpack_stream(self.buffer):
                reply = self.talk.handle(package, self.robot.robot_time)
                if reply:
                    self.send(reply)
        except rtde.WireError:
            self.open = False

    def cycle(self, now: float, paused: bool) -> bool:
        package, network = self.talk.output(), self.network
        if package and not paused and not (network.drop and network.rng.random() < network.drop):
            self._late.append((now + network.delay, package))
        while self._late and self._late[0][0] <= now:
            if self.send(self._late.popleft()[1]):
                self._lost = 0
                self.robot.recorder.outputs_sent += 1
            else:
                self._lost += 1
                self.robot.recorder.outputs_dropped += 1
        return self.open and self._lost < SLOW_READER

    def text(self, text: str) -> None:
        if self.talk.started:
            body, source = text.encode()[:200], b"stand-in"
            self.send(rtde.pack(rtde.TEXT, bytes((len(body),)) + body + bytes((len(source),)) + source + b"\x02"))

    def close(self) -> None:
        self.talk.close()
        super().close()

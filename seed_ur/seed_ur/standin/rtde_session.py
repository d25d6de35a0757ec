# SPDX-License-Identifier: Apache-2.0
"""One client's RTDE conversation: set-up requests answered, data packages taken, outputs made."""

from __future__ import annotations

import struct
from collections.abc import Callable

from seed_ur import rtde as wire
from seed_ur.rtde import Package, Recipe
from seed_ur.standin.controller import Controller

OUTPUT_RECIPE = 1


class Ownership:
    """Which conversation may write which input."""

    def __init__(self) -> None:
        self._owner: dict[str, object] = {}

    def take(self, name: str, owner: object) -> bool:
        """False when somebody else has it."""
        return self._owner.setdefault(name, owner) is owner

    def free(self, owner: object) -> None:
        """The owner has gone."""
        self._owner = {n: o for n, o in self._owner.items() if o is not owner}


class Conversation:
    """State of one RTDE connection."""

    def __init__(self, box: Controller, owners: Ownership) -> None:
        self.box, self.owners = box, owners
        self.outputs: Recipe | None = None
        self.inputs: list[Recipe] = []
        self.divider = 1
        self.started = False
        self._cycle = 0
        self._answers: dict[int, Callable[[bytes], bytes]] = {
            wire.REQUEST_VERSION: self._version,
            wire.CONTROLLER_VERSION: self._controller_version,
            wire.SETUP_OUTPUTS: self._setup_outputs,
            wire.SETUP_INPUTS: self._setup_inputs,
            wire.START: lambda _: self._start(True),
            wire.PAUSE: lambda _: self._start(False),
        }

    def handle(self, package: Package, now: float) -> bytes:
        """The reply to one package, empty for data and unknown kinds."""
        if package.kind == wire.DATA:
            self._data(package.payload, now)
            return b""
        answer = self._answers.get(package.kind)
        return wire.pack(package.kind, answer(package.payload)) if answer else b""

    def close(self) -> None:
        """Give the inputs back."""
        self.owners.free(self)

    def output(self) -> bytes:
        """The data package due in this cycle, or nothing."""
        self._cycle += 1
        if not self.started or self.outputs is None or self._cycle % self.divider:
            return b""
        return self.outputs.encode(OUTPUT_RECIPE, self.box.values)

    def _version(self, payload: bytes) -> bytes:
        return bytes((int(payload == b"\x00\x02"),))

    def _controller_version(self, _: bytes) -> bytes:
        return struct.pack(">4I", *self.box.options.version)

    def _setup_outputs(self, payload: bytes) -> bytes:
        if len(payload) < 8:
            return b"\x00"
        (frequency,) = struct.unpack_from(">d", payload)
        top = 500.0 if self.box.options.version[0] > 3 else 125.0
        self.divider = max(1, round(500.0 / min(top, frequency))) if frequency > 0.0 else int(500.0 / top)
        names = wire.names_of(payload[8:])
        version = self.box.options.version
        kinds = [wire.OUTPUTS[n] if wire.knows(version, n) else wire.NOT_FOUND for n in names]
        good = wire.NOT_FOUND not in kinds
        self.outputs = Recipe.of(names, wire.OUTPUTS) if good else None
        return bytes((OUTPUT_RECIPE if good else 0,)) + ",".join(kinds).encode()

    def _setup_inputs(self, payload: bytes) -> bytes:
        names = wire.names_of(payload)
        kinds = [self._input_kind(n) for n in names]
        if wire.NOT_FOUND in kinds or wire.IN_USE in kinds:
            return b"\x00" + ",".join(kinds).encode()
        self.inputs.append(Recipe.of(names, wire.INPUTS))
        return bytes((len(self.inputs),)) + ",".join(kinds).encode()

    def _input_kind(self, name: str) -> str:
        if name not in wire.INPUTS:
            return wire.NOT_FOUND
        return wire.INPUTS[name] if self.owners.take(name, self) else wire.IN_USE

    def _start(self, on: bool) -> bytes:
        self.started = on
        return b"\x01"

    def _data(self, payload: bytes, now: float) -> None:
        if not payload or not 1 <= payload[0] <= len(self.inputs):
            return
        values = self.inputs[payload[0] - 1].decode(payload[1:])
        if values is not None:
            self.box.write_inputs(values, now)

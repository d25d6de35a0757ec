# SPDX-License-Identifier: Apache-2.0
"""The plant's end of the stand-in's UDP port: give a wrench, get the arm's newest state. Never blocks."""

from __future__ import annotations

import json
import socket
from types import TracebackType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from seed_sim.ur.server import PLANT_PORT

Array = NDArray[np.float64]


class ArmState(NamedTuple):
    """What the stand-in sends every 2 ms."""

    time: float  # [s] host's monotonic clock
    X_WE: Array  # (4, 4) actual pose of the flange in base
    q: Array  # (6,) actual joint angles [rad]
    qd: Array  # (6,) [rad/s]


class PlantLink:
    """Couples a plant to a stand-in: call `exchange` at every plant step (at least twice a second)."""

    def __init__(self, host: str = "127.0.0.2") -> None:
        self._address = (host, PLANT_PORT)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.newest: ArmState | None = None

    def __enter__(self) -> PlantLink:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def exchange(self, force_E: Array, torque_E: Array) -> ArmState | None:
        """Report the wrench of the environment on the flange, about its origin, in E [N, N m]; the newest arm state.

        None until the stand-in has answered once. A stand-in that is gone keeps the last state: see its `time`.
        """
        message = json.dumps({"wrench": [*map(float, force_E), *map(float, torque_E)]}).encode()
        try:
            self._socket.sendto(message, self._address)
        except OSError:
            return self.newest  # nobody there yet
        data = b""
        try:
            while True:
                data = self._socket.recv(4096)
        except OSError:
            pass
        if data:
            values = json.loads(data)
            arrays = (np.array(values[name], dtype=float) for name in ("X_WE", "q", "qd"))
            self.newest = ArmState(float(values["time"]), *arrays)
        return self.newest

    def close(self) -> None:
        """Close the socket; the stand-in sets the wrench to zero half a second later."""
        self._socket.close()

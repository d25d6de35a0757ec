# SPDX-License-Identifier: Apache-2.0
"""The plant's end of the stand-in's UDP port: give a wrench, get the arm's newest state. Never blocks."""

from __future__ import annotations

import contextlib
import json
import socket
import time
from collections.abc import Sequence
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from seed_core.errors import FailedError
from seed_core.spatial import Array
from seed_ur.pose import pose_from_matrix
from seed_ur.standin.options import PLANT_PORT, SIDE_PORT
from seed_ur.standin_client import request


class ArmState(NamedTuple):
    """What the stand-in sends every 2 ms."""

    time: float  # [s] the controller's clock, as RTDE's timestamp
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
        self.clock: float | None = None  # [s] what the controller's clock showed when the arm was placed

    def __enter__(self) -> PlantLink:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def place(
        self,
        X_WE: Array,
        near: Sequence[float] | Array,
        clock: float | None = None,
        patience: float = 20.0,
        *,
        stay: bool = False,
    ) -> None:
        """Put the stand-in's flange at X_WE (4, 4), on the branch of the joint angles `near` (6,).

        clock: what the controller's clock shows from now on [s]; the plant then sets its pace by `exchange`.
        stay: leave it where it is, if a program runs.
        Waits for the stand-in, and forgets its states from before; raises SeedError when it does not come or refuses.
        """
        pose, until = list(pose_from_matrix(X_WE)), time.monotonic() + patience
        while True:
            try:
                reply = request(self._address[0], "place", pose=pose, near=list(near), clock=clock, stay=stay)
                break
            except OSError as error:
                if time.monotonic() > until:
                    raise FailedError(
                        f"no stand-in UR controller at {self._address[0]}:{SIDE_PORT} ({error})"
                    ) from error
                time.sleep(0.1)
        if not reply["ok"]:
            raise FailedError(f"stand-in UR controller at {self._address[0]} refuses to start there: {reply['error']}")
        self.receive()
        self.clock, self.newest = clock, None

    def exchange(self, force_E: Array, torque_E: Array) -> ArmState | None:
        """`report` a wrench, `receive` the newest arm state."""
        self.report(force_E, torque_E)
        return self.receive()

    def report(self, force_E: Array, torque_E: Array, until: float | None = None) -> None:
        """The wrench of the environment on the flange, about its origin, in E [N, N m].

        until: how far the controller may run by its own clock [s]; there it stands still.
        """
        message: dict[str, Any] = {"wrench": [*map(float, force_E), *map(float, torque_E)]}
        if until is not None:
            message["until"] = until
        with contextlib.suppress(OSError):  # nobody there yet
            self._socket.sendto(json.dumps(message).encode(), self._address)

    def receive(self) -> ArmState | None:
        """The newest arm state, None until there was one. A stand-in that is gone keeps the last: see its `time`."""
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

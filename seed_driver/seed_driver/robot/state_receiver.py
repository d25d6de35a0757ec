# SPDX-License-Identifier: Apache-2.0
"""The robot's states by RTDE, read by ourselves: never blocks, costs a third of the library's receiver and its thread.

The library's receiver also waits for ever in its constructor on a port that answers but sends nothing.
"""

from __future__ import annotations

from typing import Any

from seed_driver.robot.rtde_client import RtdeClient
from seed_ur import rtde

OUTPUTS = (
    "timestamp",
    "actual_q",
    "actual_qd",
    "actual_current",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "actual_TCP_force",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "safety_status_bits",
    "speed_scaling",
    "target_speed_fraction",
    "tcp_offset",  # of the controllers that know it
)


class StateReceiver:
    """A started stream of states; `values` are the newest, by RTDE's names (units as in UR's RTDE guide)."""

    def __init__(self, host: str, rate: float) -> None:
        """rate: [Hz] of the states. Raises LinkError, and ValueError for an answer that is no state."""
        self._client = RtdeClient(host)
        try:
            version = self._client.version()
            self._recipe = self._client.start([n for n in OUTPUTS if rtde.knows(version, n)], rate)
            self.values = self._decoded(self._client.values())
            self._client.never_wait()
        except BaseException:
            self._client.close()
            raise
        self.open = True
        self.packages = 0  # that have come

    def _decoded(self, packed: bytes) -> dict[str, Any]:
        values = self._recipe.decode(packed)
        if values is None:
            raise ValueError(f"{len(packed)} byte of state, not {self._recipe.layout.size}")
        return dict(values)

    def poll(self) -> None:
        """Take what has arrived; `open` is False from the end of the connection on."""
        newest = b""
        try:
            for package in self._client.arrived():
                if package.kind == rtde.DATA and len(package.payload) == 1 + self._recipe.layout.size:
                    newest = package.payload
        except (OSError, rtde.WireError):
            self.open = False
        if newest:
            self.packages += 1
            self.values = self._decoded(newest[1:])

# SPDX-License-Identifier: Apache-2.0
"""The robot's states by RTDE, read by ourselves: never blocks, costs a third of the library's receiver and its thread.

The library's receiver also waits for ever in its constructor on a port that answers but sends nothing.
"""

from __future__ import annotations

import struct

from seed_driver.probe import LinkError, MiniRtde

NAMES = (
    "timestamp,actual_q,actual_qd,actual_current,actual_TCP_pose,actual_TCP_speed,actual_TCP_force,robot_mode,"
    "safety_mode,runtime_state,robot_status_bits,safety_status_bits,speed_scaling,target_speed_fraction,"
)
KINDS = "DOUBLE" + 6 * ",VECTOR6D" + ",INT32,INT32,UINT32,UINT32,UINT32,DOUBLE,DOUBLE"
LAYOUT = struct.Struct(">B37diiIIIdd")  # recipe number, then the names in order
DATA = ord("U")
LARGEST = 65_536  # [byte] read at once, 160 states


class StateStream:
    """A started stream of states; `values` is the newest: timestamp at 1, then as in NAMES, flattened."""

    def __init__(self, host: str, rate: float) -> None:
        self._rtde = MiniRtde(host)
        try:
            self.version = self._rtde.version()
            kinds = self._rtde.ask("O", struct.pack(">d", rate) + NAMES.encode())[1:].decode("ascii", "replace")
            if kinds != KINDS:
                raise LinkError(f"{host} offers other states than expected: {kinds}")
            self._rtde.ask("S")
            self.values = LAYOUT.unpack(self._first(host))
            self._rtde.never_wait()
        except LinkError:
            self._rtde.close()
            raise
        self.open = True
        self._buffer = bytearray()
        self.packages = 0  # that have come

    def _first(self, host: str) -> bytes:
        try:
            return self._rtde.receive("U")
        except OSError as error:
            raise LinkError(f"{host} answers but sends no data ({error}); restart the controller") from error

    def poll(self) -> None:
        """Take what has arrived; `open` is False from the end of the connection on."""
        data = self._rtde.arrived(LARGEST)
        if data is None:
            self.open = False
        if not data:
            return
        buffer = self._buffer
        buffer += data
        at, newest = 0, -1
        while len(buffer) - at >= 3:
            size = buffer[at] << 8 | buffer[at + 1]
            if size < 3:
                self.open = False
                return
            if len(buffer) - at < size:
                break
            if buffer[at + 2] == DATA and size == 3 + LAYOUT.size:
                newest = at
            at += size
        if newest >= 0:
            self.packages += 1
            self.values = LAYOUT.unpack_from(buffer, newest + 3)
        del buffer[:at]

    @property
    def timestamp(self) -> float:
        """The controller's clock in the newest package [s]."""
        return float(self.values[1])

    @property
    def robot_mode(self) -> int:
        """UR's robot mode."""
        return int(self.values[38])

    @property
    def runtime_state(self) -> int:
        """UR's program state."""
        return int(self.values[40])

    @property
    def safety_bits(self) -> int:
        """UR's safety status bits."""
        return int(self.values[42])

    @property
    def speed_fraction(self) -> float:
        """Where the speed slider stands."""
        return float(self.values[44])

    def close(self) -> None:
        """Close the connection."""
        self.open = False
        self._rtde.close()

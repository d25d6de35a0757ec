# SPDX-License-Identifier: Apache-2.0
"""The robot's states by RTDE, read by ourselves: never blocks, costs a third of the library's receiver and its thread.

The library's receiver also waits for ever in its constructor on a port that answers but sends nothing.
"""

from __future__ import annotations

import struct

from seed_driver.robot.probe import LinkError, MiniRtde

NAMES = (
    "timestamp,actual_q,actual_qd,actual_current,actual_TCP_pose,actual_TCP_speed,actual_TCP_force,robot_mode,"
    "safety_mode,runtime_state,robot_status_bits,safety_status_bits,speed_scaling,target_speed_fraction,"
)
KINDS = "DOUBLE" + 6 * ",VECTOR6D" + ",INT32,INT32,UINT32,UINT32,UINT32,DOUBLE,DOUBLE"
LAYOUT = ">B37diiIIIdd"  # recipe number, then the names in order
OFFSET = "tcp_offset,", ",VECTOR6D", "6d"  # behind them, where it is known
OFFSET_SINCE = {3: (3, 12), 5: (5, 5, 1), 10: (10,)}
DATA = ord("U")
LARGEST = 65_536  # [byte] read at once, 160 states


class StateStream:
    """A started stream of states; `values` is the newest: timestamp at 1, then as in NAMES and OFFSET, flattened."""

    def __init__(self, host: str, rate: float) -> None:
        self._rtde = MiniRtde(host)
        try:
            self.version = self._rtde.version()
            offset = OFFSET if self.version >= OFFSET_SINCE[self.version[0]] else ("", "", "")
            names, expected, layout = (a + b for a, b in zip((NAMES, KINDS, LAYOUT), offset, strict=True))
            kinds = self._rtde.ask("O", struct.pack(">d", rate) + names.encode())[1:].decode("ascii", "replace")
            if kinds != expected:
                raise LinkError(f"{host} offers other states than expected: {kinds}")
            self._layout = struct.Struct(layout)
            self._rtde.ask("S")
            self.values = self._layout.unpack(self._first(host))
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
            if buffer[at + 2] == DATA and size == 3 + self._layout.size:
                newest = at
            at += size
        if newest >= 0:
            self.packages += 1
            self.values = self._layout.unpack_from(buffer, newest + 3)
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

    @property
    def tcp_offset(self) -> tuple[float, ...]:
        """The controller's TCP in the flange frame, a pose vector; empty where it does not say."""
        return self.values[45:]

    def close(self) -> None:
        """Close the connection."""
        self.open = False
        self._rtde.close()

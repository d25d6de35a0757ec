# SPDX-License-Identifier: Apache-2.0
"""Memory shared by the node and the servo process: the newest target one way, the robot's state the other.

An anonymous memory file (memfd) that vanishes with its last user: nothing can be left behind. Each half has one
writer and ends with a checksum; a reader takes a copy and tries again when the checksum is not that of the copy.
Nobody ever waits for anybody, and nothing depends on the order in which a processor writes.
"""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from enum import IntEnum
from itertools import islice
from typing import Any, NamedTuple

from seed_core.arm.quaternion import IDENTITY, Quaternion
from seed_core.vector3 import ZERO, Vector3

_TARGET = struct.Struct("<Qd 3d 4d")  # the fields of TargetSlot in their order
_STATE = struct.Struct("<ddI?? 6d6d6d3d4d6d6d iiIId 7d dQQdddd? 64s512s")  # the fields of ServoState in their order
_NUMBER = struct.Struct("<Q")  # the first field of TargetSlot
_CHECK = struct.Struct("<I")
_HALF = 4096
LARGEST_MESSAGE = 65_536  # [byte] of what node and servo process send each other beside it
LOST, CRASHED, ORPHANED = 3, 4, 5  # exit codes of the servo process


class Stage(IntEnum):
    """What the servo process is doing."""

    STARTING = 0
    SEARCHING = 1  # nobody, or not the right one, at the address
    MONITORING = 2  # states arrive, no program of ours runs
    BUSY = 3  # in a call that may take long
    SERVOING = 4  # our program runs and is fed at the servo rate


class TargetSlot(NamedTuple):
    """A target as the servo process gets it."""

    number: int  # counts up; 0: none yet
    received: float  # [s] monotonic
    p: Vector3  # [m]
    q: Quaternion


class Modes(NamedTuple):
    """State words of the controller."""

    robot_mode: int = -1
    safety_mode: int = 0
    runtime_state: int = 0
    safety_bits: int = 0


class RobotState(NamedTuple):
    """One state of the robot; everything in `base`."""

    q: tuple[float, ...] = (0.0,) * 6  # [rad]
    qd: tuple[float, ...] = (0.0,) * 6  # [rad/s]
    current: tuple[float, ...] = (0.0,) * 6  # [A]
    p: Vector3 = ZERO  # of the flange [m]
    orientation: Quaternion = IDENTITY
    twist: tuple[float, ...] = (0.0,) * 6  # of the flange's origin: linear [m/s], angular [rad/s]
    wrench: tuple[float, ...] = (0.0,) * 6  # environment on tool about the flange's origin: force [N], torque [N m]
    modes: Modes = Modes()
    speed_scaling: float = 1.0


class ServoState(NamedTuple):
    """What the servo process knows; times are the host's monotonic clock [s]."""

    heartbeat: float = 0.0
    sample_time: float = 0.0  # when the newest sample came from the robot
    stage: Stage = Stage.STARTING
    armed: bool = False  # targets are followed
    linked: bool = False
    sample: RobotState = RobotState()
    command: tuple[Vector3, Quaternion] = (ZERO, IDENTITY)  # pose of the flange: position [m], rotation
    timestamp: float = 0.0  # [s] the controller's clock
    target_number: int = 0  # of the newest target used
    sent: int = 0  # servo commands
    latency: float = 0.0  # [s] from receipt of the newest target to its first command
    period_p50: float = 0.0  # [s] of the servo cycles, and so on
    period_p99: float = 0.0
    period_max: float = 0.0
    wants_start: bool = False  # the program will be started without being asked for
    version: str = ""  # of PolyScope
    reason: str = ""  # why it holds, or what it waits for


class SharedMemory:
    """Both halves; made by the node (`create`), opened by the servo process from the file descriptor."""

    def __init__(self, fd: int) -> None:
        self.fd = fd
        self._map = mmap.mmap(fd, 2 * _HALF)

    @classmethod
    def create(cls) -> SharedMemory:
        """New, empty, anonymous."""
        fd = os.memfd_create("seed_driver")
        os.ftruncate(fd, 2 * _HALF)
        memory = cls(fd)
        memory.write_state(ServoState(reason="starting"))
        return memory

    def close(self) -> None:
        """Unmap and close."""
        self._map.close()
        os.close(self.fd)

    def write_target(self, target: TargetSlot) -> None:
        """Node: publish a target."""
        self._write(0, _TARGET.pack(target.number, target.received, *target.p, *target.q))

    def read_target(self, after: int) -> TargetSlot | None:
        """Servo process: the newest target if its number is above `after`, None while one is being written."""
        if _NUMBER.unpack_from(self._map)[0] <= after:
            return None
        data = self._read(0, _TARGET.size)
        if data is None:
            return None
        number, received, x, y, z, qx, qy, qz, qw = _TARGET.unpack(data)
        return TargetSlot(number, received, (x, y, z), (qx, qy, qz, qw))

    def write_state(self, state: ServoState) -> None:
        """Servo process: publish the state; before it lives, the node does."""
        s = state.sample
        vectors = *s.q, *s.qd, *s.current, *s.p, *s.orientation, *s.twist, *s.wrench
        texts = state.version.encode(), state.reason.encode()  # cut to their room by pack
        p, q = state.command
        data = _STATE.pack(*state[:5], *vectors, *s.modes, s.speed_scaling, *p, *q, *state[7:15], *texts)
        self._write(_HALF, data)

    def read_state(self) -> ServoState | None:
        """Node: the newest state, None while one is being written."""
        data = self._read(_HALF, _STATE.size)
        if data is None:
            return None
        values = iter(_STATE.unpack(data))

        def take(count: int) -> Any:
            return tuple(islice(values, count))

        heartbeat, sample_time, stage, armed, linked = take(5)
        vectors = [take(n) for n in (6, 6, 6, 3, 4, 6, 6)]
        sample = RobotState._make((*vectors, Modes._make(take(4)), next(values)))
        command, numbers = (take(3), take(4)), take(8)
        texts = (text.rstrip(b"\0").decode("utf-8", "replace") for text in values)
        return ServoState._make(
            (heartbeat, sample_time, Stage(stage), armed, linked, sample, command, *numbers, *texts)
        )

    def _write(self, at: int, data: bytes) -> None:
        whole = data + _CHECK.pack(zlib.crc32(data))
        self._map[at : at + len(whole)] = whole

    def _read(self, at: int, size: int) -> bytes | None:
        for _ in range(20):
            whole = self._map[at : at + size + _CHECK.size]
            data = whole[:size]
            if zlib.crc32(data) == _CHECK.unpack_from(whole, size)[0]:
                return data
        return None

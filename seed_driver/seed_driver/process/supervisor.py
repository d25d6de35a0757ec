# SPDX-License-Identifier: Apache-2.0
"""Starts the servo process, listens to its heartbeat, kills it when it hangs, starts it again when it died.

Nothing here blocks or sleeps: `step` is called often (100 Hz or more) with the time.
"""

import json
import signal
import socket
import subprocess
import sys
import time
from typing import Any, NamedTuple

from seed_core.arm.quaternion import Quaternion
from seed_core.config import to_mapping
from seed_core.errors import SeedError
from seed_core.vector3 import Vector3
from seed_driver.config import DriverConfig
from seed_driver.process.heartbeat import Heartbeat
from seed_driver.process.realtime import raise_niceness
from seed_driver.process.shared_memory import (
    CRASHED,
    LARGEST_MESSAGE,
    LOST,
    ServoState,
    SharedMemory,
    Stage,
    TargetSlot,
)

ROBOTS_OWN = ("start", "zero_ft", "freedrive")  # requests that are nothing without a robot
RESTART_AFTER = 0.1  # [s] from the death of a process to the next
TRY_AGAIN = 1.0  # [s] from a start that failed to the next
MOST_REPLIES = 200  # kept for those who ask


class Reply(NamedTuple):
    """Answer to a request."""

    ok: bool
    text: str


class _Life(NamedTuple):
    """One servo process."""

    process: subprocess.Popen[bytes]
    wire: socket.socket  # requests to it, replies from it


class Supervisor:
    """Owner of the servo process. `state` is the newest one, with `linked` False whenever it cannot be trusted."""

    def __init__(self, config: DriverConfig) -> None:
        self.config = config.check()
        self.state = ServoState()
        self.replies: dict[int, Reply] = {}
        self.deaths = 0
        self.memory: SharedMemory | None = None  # while the driver is active
        self._life: _Life | None = None
        self._heartbeat = Heartbeat()
        self._requests = 0
        self._unanswered: set[int] = set()
        self._targets = 0
        self._restart_at = 0.0
        self._start_program = False  # until a life has done so, or was told not to

    def start(self, start_program: bool) -> None:
        """Start the process; with `start_program` it sends the robot program as soon as the robot allows.

        Raises:
            OSError: the system gives no process.
        """
        self.memory = SharedMemory.create()
        self._start_program = start_program
        try:
            self._spawn(self.memory, time.monotonic())
        except OSError:
            self.close()
            raise

    def _spawn(self, memory: SharedMemory, now: float) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        memory.write_state(ServoState(heartbeat=now, reason=self.state.reason if self.deaths else "starting"))
        try:
            process = subprocess.Popen(
                [sys.executable, "-m", "seed_driver.servo", str(memory.fd), str(theirs.fileno())],
                pass_fds=(memory.fd, theirs.fileno()),
                stdin=subprocess.DEVNULL,
            )
        except OSError:
            ours.close()
            raise
        finally:
            theirs.close()
        if self.config.realtime_priority > 0:
            raise_niceness(process.pid)
        ours.setblocking(False)
        ours.send(json.dumps({"config": to_mapping(self.config), "start": self._start_program}).encode())
        self._life = _Life(process, ours)
        self._heartbeat.restart(process.pid, now)
        self.state = self.state._replace(stage=Stage.STARTING)

    @property
    def pid(self) -> int | None:
        """Process number of the servo process."""
        return self._life.process.pid if self._life is not None else None

    def step(self, now: float) -> ServoState:
        """Look after the process, at `now` [s, monotonic].

        Returns:
            The newest state; its `reason` tells why the arm holds.
        """
        if self.memory is None:
            return self.state
        if self._life is None:
            if now >= self._restart_at:
                self._start_again(self.memory, now)
            return self.state
        self._read_replies(self._life.wire)
        code = self._life.process.poll()  # before its state, so that this is the last one when it has ended
        state = self.memory.read_state() or self.state
        if state.stage != Stage.STARTING:
            self._start_program &= state.wants_start  # of the next life
        gone, hopeless = self._heartbeat.doubts(now, state)
        if code is not None:
            said = state.reason if code in (0, LOST, CRASHED) else ""
            self._ended(self._life, now, state, said or exit_reason(code))
        elif hopeless:
            self._life.process.kill()
            self._life.process.wait()
            self._ended(self._life, now, state, "servo process hung and was killed")
        elif gone:
            self.state = state._replace(linked=False, armed=False, reason="servo process does not answer")
        else:
            self.state = state
        return self.state

    def _start_again(self, memory: SharedMemory, now: float) -> None:
        """The next life; where the system is out of processes or memory, later."""
        try:
            self._spawn(memory, now)
        except OSError as error:
            self._restart_at = now + TRY_AGAIN
            self.state = self.state._replace(reason=f"servo process cannot be started: {error}")

    def _ended(self, life: _Life, now: float, last: ServoState, reason: str) -> None:
        life.wire.close()
        self._life = None
        self.deaths += 1
        self._restart_at = now + RESTART_AFTER
        self.state = last._replace(linked=False, armed=False, stage=Stage.SEARCHING, reason=reason)
        for number in self._unanswered:
            self.replies[number] = Reply(False, f"link lost meanwhile: {reason}")
        self._unanswered.clear()

    # requests
    def send(self, do: str, **arguments: Any) -> int:
        """Send a request, such as start, stop or zero_ft; nothing is waited for.

        Returns:
            The number under which its answer will appear in `replies`.
        """
        self._start_program &= do != "stop"  # even when it does not arrive
        self._requests += 1
        number = self._requests
        message = json.dumps({"do": do, "id": number, **arguments}).encode()
        try:
            if self._life is None or (do in ROBOTS_OWN and self.state.stage == Stage.STARTING):
                raise OSError("no servo process that could do it")
            self._life.wire.send(message)
            self._unanswered.add(number)
        except OSError:
            self.replies[number] = Reply(False, f"no link to the robot: {self.state.reason}")
        return number

    def _read_replies(self, wire: socket.socket) -> None:
        while True:
            try:
                data = wire.recv(LARGEST_MESSAGE)
            except OSError:
                return
            if not data:
                return
            reply = json.loads(data)
            self._unanswered.discard(reply["id"])
            self.replies[reply["id"]] = Reply(reply["ok"], reply["text"])
            while len(self.replies) > MOST_REPLIES:
                self.replies.pop(next(iter(self.replies)))

    def write_target(self, p: Vector3, q: Quaternion, now: float) -> int:
        """Hand over a target that has passed the target checks.

        Args:
            p: position [m] of the flange in `base`.
            q: its rotation as a unit quaternion.
            now: time of receipt [s, monotonic].

        Returns:
            The target's number, as in ServoState.target_number.

        Raises:
            SeedError: the driver is not active.
        """
        if self.memory is None:
            raise SeedError("the driver is not active")
        self._targets += 1
        self.memory.write_target(TargetSlot(self._targets, now, p, q))
        return self._targets

    def set_config(self, config: DriverConfig) -> None:
        """Change settings while running."""
        self.config = config
        if self.memory is not None:
            self.send("config", config=to_mapping(config))

    def close(self, patience: float = 2.0) -> None:
        """Let the arm come to rest, end the program and the process."""
        if self._life is not None:
            process = self._life.process
            if process.poll() is None:
                self.send("quit")
                try:
                    process.wait(patience)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
            self._life.wire.close()
            self._life = None
        if self.memory is not None:
            self.memory.close()
            self.memory = None
        self.state = ServoState(reason="not active")


def exit_reason(code: int) -> str:
    """The end of a process, in words, from its return code."""
    if code < 0:
        names = {int(s): s.name for s in signal.Signals}  # most of the real-time signals have none
        return f"servo process died of {names.get(-code, f'signal {-code}')}"
    return f"servo process ended with code {code}"

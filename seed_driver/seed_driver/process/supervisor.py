# SPDX-License-Identifier: Apache-2.0
"""Starts the servo process, listens to its heartbeat, puts it down when it hangs, starts it again when it died.

Nothing here blocks or sleeps: `step` is called often (100 Hz or more) with the time.
"""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from typing import Any, NamedTuple

from seed_core.errors import SeedError
from seed_driver.config import DriverConfig, to_json
from seed_driver.process.realtime import hasten
from seed_driver.process.shared_memory import SharedMemory, Stage, State, TargetSlot
from seed_driver.process.start_watch import Start

LONGEST_START = 40.0  # [s] without a heartbeat while the process starts, from a cold disk of a busy machine
IDLE = 1.5, 3.0  # [s] of no work in it after which the process counts as gone, and then is killed
SILENT = {  # [s] without a heartbeat after which the process counts as gone, and then is killed
    Stage.SEARCHING: (3.0, 6.0),
    Stage.BUSY: (1.5, 7.0),
    Stage.MONITORING: (0.09, 0.5),
    Stage.SERVOING: (0.09, 0.5),
}
ROBOTS_OWN = ("start", "zero_ft", "freedrive")  # requests that are nothing without a robot
RESTART_AFTER = 0.1  # [s] from the death of a process to the next


class Reply(NamedTuple):
    """Answer to a request."""

    ok: bool
    text: str


class Supervisor:
    """Owner of the servo process. `state` is the newest one, with `linked` False whenever it cannot be trusted."""

    def __init__(self, config: DriverConfig) -> None:
        self.config = config.check()
        self.state = State()
        self.replies: dict[int, Reply] = {}
        self.deaths = 0
        self._memory: SharedMemory | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._wire: socket.socket | None = None
        self._requests = 0
        self._targets = 0
        self._restart_at = 0.0
        self._start_program = False  # until a life has done so, or was told not to
        self._starting: Start | None = None
        self._longest_start = LONGEST_START
        self._waiting: dict[int, float] = {}

    def start(self, start_program: bool) -> None:
        """Start the process; with `start_program` it sends the robot program as soon as the robot allows."""
        self._memory = SharedMemory.create()
        self._start_program = start_program
        self._spawn(time.monotonic())

    def _spawn(self, now: float) -> None:
        assert self._memory is not None
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        reason = self.state.reason if self.deaths else "starting"
        self._memory.write_state(State(heartbeat=now, reason=reason))
        command = [sys.executable, "-m", "seed_driver.servo", str(self._memory.fd), str(theirs.fileno())]
        self._process = subprocess.Popen(
            command, pass_fds=(self._memory.fd, theirs.fileno()), stdin=subprocess.DEVNULL, close_fds=True
        )
        if self.config.realtime_priority > 0:
            hasten(self._process.pid)
        ours.setblocking(False)
        ours.send(json.dumps({"config": to_json(self.config), "start": self._start_program}).encode())
        theirs.close()
        self._wire, self._starting = ours, Start(self._process.pid, now)
        self.state = self.state._replace(stage=Stage.STARTING)

    @property
    def pid(self) -> int | None:
        """Process number of the servo process."""
        return self._process.pid if self._process is not None else None

    def step(self, now: float) -> State:
        """Look after the process; the newest state."""
        if self._memory is None:
            return self.state
        self._read_replies()
        if self._process is None:
            if now >= self._restart_at:
                self._spawn(now)
            return self.state
        code = self._process.poll()  # before its state, so that this is the last one when it has ended
        fresh = self._memory.read_state()
        state = fresh if fresh is not None else self.state
        gone, hopeless = self._doubts(now, state)
        if code is not None:
            self._buried(now, state, code)
        elif hopeless:
            self._process.kill()
            self._process.wait()
            self._buried(now, state._replace(reason="servo process hung and was killed"), 0)
        elif gone:
            self.state = state._replace(linked=False, armed=False, reason="servo process does not answer")
        else:
            self.state = state
        return self.state

    def _doubts(self, now: float, state: State) -> tuple[bool, bool]:
        """Whether the process counts as gone, and whether it is to be killed."""
        if state.stage != Stage.STARTING or self._starting is None:
            self._start_program &= state.wants_start  # of the next life
            silent, (gone, hopeless) = now - state.heartbeat, SILENT[state.stage]
            return silent > gone, silent > hopeless
        idle = self._starting.idle(now)
        if now - self._starting.began > self._longest_start:
            self._longest_start *= 2.0  # a slow machine gets there in the end
            return True, True
        return idle > IDLE[0], idle > IDLE[1]

    def _buried(self, now: float, last: State, code: int) -> None:
        self.deaths += 1
        reason = last.reason if code in (0, 3, 4) and last.reason else _obituary(code)
        self.state = last._replace(linked=False, armed=False, stage=Stage.SEARCHING, reason=reason)
        if self._wire is not None:
            self._wire.close()
        self._process, self._wire = None, None
        self._restart_at = now + RESTART_AFTER
        for number in list(self._waiting):
            self.replies[number] = Reply(False, f"link lost meanwhile: {reason}")
        self._waiting.clear()

    # requests
    def send(self, do: str, **arguments: Any) -> int:
        """Send a request; its answer appears in `replies` under the returned number."""
        self._start_program &= do != "stop"  # even when it does not arrive
        self._requests += 1
        number = self._requests
        message = json.dumps({"do": do, "id": number, **arguments}).encode()
        try:
            if self._wire is None or (do in ROBOTS_OWN and self.state.stage == Stage.STARTING):
                raise OSError("no servo process that could do it")
            self._wire.send(message)
            self._waiting[number] = time.monotonic()
        except OSError:
            self.replies[number] = Reply(False, f"no link to the robot: {self.state.reason}")
        return number

    def _read_replies(self) -> None:
        while self._wire is not None:
            try:
                data = self._wire.recv(65_536)
            except OSError:
                return
            if not data:
                return
            reply = json.loads(data)
            self._waiting.pop(reply["id"], None)
            self.replies[reply["id"]] = Reply(reply["ok"], reply["text"])
            while len(self.replies) > 200:
                self.replies.pop(next(iter(self.replies)))

    def write_target(self, p: tuple[float, float, float], q: tuple[float, float, float, float], now: float) -> int:
        """Hand over a target that has passed the gate; its number."""
        if self._memory is None:
            raise SeedError("the driver is not active")
        self._targets += 1
        self._memory.write_target(TargetSlot(self._targets, now, p, q))
        return self._targets

    def set_config(self, config: DriverConfig) -> None:
        """Change settings while running."""
        self.config = config
        if self._memory is not None:
            self.send("config", config=to_json(config))

    def close(self, patience: float = 2.0) -> None:
        """Let the arm come to rest, end the program and the process."""
        process, self._process = self._process, None
        if process is not None and process.poll() is None:
            self.send("quit")
            try:
                process.wait(patience)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        if self._wire is not None:
            self._wire.close()
            self._wire = None
        if self._memory is not None:
            self._memory.close()
            self._memory = None
        self.state = State(reason="not active")


def _obituary(code: int) -> str:
    if code < 0:
        return f"servo process died of {signal.Signals(-code).name}"
    return f"servo process ended with code {code}"

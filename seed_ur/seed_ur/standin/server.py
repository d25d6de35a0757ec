# SPDX-License-Identifier: Apache-2.0
"""The ports of the stand-in and its clock: one thread, `select` until the next 2 ms deadline.

Ports: 30004 RTDE, 30001 to 30003 scripts, 29999 dashboard (not for PolyScope X), 30099 side port (JSON lines),
30098 UDP for a plant that wants the flange's pose and gives the wrench.
"""

import contextlib
import gc
import json
import os
import select
import socket
import time
from collections.abc import Callable
from typing import TypeAlias

from seed_core.errors import SeedError
from seed_ur.standin.channel import Channel, Network
from seed_ur.standin.controller import Controller
from seed_ur.standin.dashboard import DashboardChannel
from seed_ur.standin.options import (
    DASHBOARD_PORT,
    PERIOD,
    PLANT_PORT,
    RTDE_PORT,
    SCRIPT_PORTS,
    SIDE_PORT,
    Options,
)
from seed_ur.standin.rtde_session import RtdeChannel
from seed_ur.standin.script import ScriptChannel

PRIORITY = 70  # SCHED_FIFO, where it is allowed
CATCH_UP = 0.1  # [s] cycles later than this are skipped
PLANT_TIMEOUT = 0.5  # [s] without a word from the plant the wrench is zero
PACER_TIMEOUT = 5.0  # [s] of a plant that sets the pace: it may be busy
REPEAT = 0.01  # [s] between packages of a robot whose clock stands still for the plant: clients take silence for a loss


Opener: TypeAlias = Callable[[socket.socket, Controller, Network], Channel]


class Server:
    """All sockets and the controller behind them."""

    def __init__(self, host: str, options: Options, await_plant: bool = False) -> None:
        self.host = host
        self.robot, self.network = Controller(options), Network()
        self.channels: list[Channel] = []
        self.listeners: dict[socket.socket, Opener] = {}
        self.side: socket.socket | None = None  # the listener that faults of the network leave alone
        self.plant: tuple[str, int] | None = None
        self.plant_heard = self.listen_again = 0.0
        self.until: float | None = None  # [s] by the robot's clock, how far the plant lets it run; None: on
        self.running = True
        self._udp = self._bound(socket.SOCK_DGRAM, PLANT_PORT)
        self.awaiting_plant = await_plant
        if not await_plant:
            self._listen_robot()
        self.robot.send_text = self._text

    def open_side_port(self, opener: Opener) -> None:
        """Serve the side port."""
        self.side = self._listen(SIDE_PORT, opener)

    def _listen(self, port: int, opener: Opener) -> socket.socket:
        listener = self._bound(socket.SOCK_STREAM, port)
        listener.listen(16)
        self.listeners[listener] = opener
        return listener

    def _bound(self, kind: socket.SocketKind, port: int) -> socket.socket:
        """A socket at a port of ours that never blocks; raises SeedError where somebody else has it."""
        bound = socket.socket(socket.AF_INET, kind)
        if kind == socket.SOCK_STREAM:  # of a datagram socket it would let two have the port
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            bound.bind((self.host, port))
        except OSError as error:
            raise SeedError(
                f"port {port} on {self.host} cannot be opened: {error}; is another stand-in there?"
            ) from error
        bound.setblocking(False)
        return bound

    def _listen_robot(self) -> None:
        self._listen(RTDE_PORT, RtdeChannel)
        for port in SCRIPT_PORTS:
            self._listen(port, ScriptChannel)
        if self.robot.options.version[0] < 10:
            self._listen(DASHBOARD_PORT, DashboardChannel)

    def place(self, pose: list[float], near: list[float], clock: float | None = None, *, stay: bool = False) -> None:
        """Put the flange somewhere, before any program runs; opens the robot's ports when they wait for it.

        clock: what the robot's clock shows from now on [s]; it then runs only as far as the plant lets it.
        stay: leave it where it is, if a program runs.
        """
        if not stay or self.robot.program is None:
            self.robot.place(pose, near)
        if clock is not None:
            self.robot.now = self.robot.robot_time
            self.robot.boot, self.until = self.robot.now - clock, clock
            self.plant_heard = time.monotonic()
        if self.awaiting_plant:
            self.awaiting_plant = False
            self._listen_robot()

    def refuse(self, seconds: float) -> None:
        """Close every port but the side port, and open them again later."""
        self.drop("")
        for listener in [s for s in self.listeners if s is not self.side]:
            listener.close()
            del self.listeners[listener]
        self.listen_again = time.monotonic() + seconds

    def drop(self, name: str) -> None:
        """Close the connections of one name ('rtde'), or all but those to the side port ('')."""
        for channel in list(self.channels):
            if channel.name == name or not (name or channel.outside):
                self._close(channel)

    def _text(self, text: str) -> None:
        for channel in self.channels:
            channel.text(text)

    def _close(self, channel: Channel) -> None:
        channel.close()
        if channel in self.channels:
            self.channels.remove(channel)

    def run(self) -> None:
        """Serve until `running` is False."""
        gc.disable()
        # a real controller is a machine of its own; here it must not wait for the programs it serves
        with contextlib.suppress(OSError):  # ordinary users may not
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        deadline = last = time.monotonic()
        while self.running:
            now = time.monotonic()
            if now >= deadline:
                self.robot.recorder.tick(now - deadline)
                goes_on = self._may_go_on(deadline)
                if not goes_on:
                    self.robot.held_back += PERIOD
                if goes_on or deadline - last >= REPEAT:
                    self._cycle(deadline, goes_on)
                    last = deadline
                deadline += PERIOD
                if now - deadline > CATCH_UP:
                    deadline = now
                if now >= deadline:
                    self._serve(0.0)
                    continue
            self._serve(max(0.0, deadline - time.monotonic()))

    def _may_go_on(self, now: float) -> bool:
        """Whether the plant lets the robot do the cycle that is due at wall time `now` [s]."""
        if self.until is None or self.robot.boot is None:
            return True
        return now - self.robot.held_back - self.robot.boot <= self.until + 0.5 * PERIOD

    def _cycle(self, now: float, goes_on: bool) -> None:
        if self.network.freeze:
            seconds, self.network.freeze = self.network.freeze, 0.0
            time.sleep(seconds)
        if self.listen_again and now > self.listen_again:
            self.listen_again = 0.0
            self._listen_robot()
        if now - self.plant_heard > (PLANT_TIMEOUT if self.until is None else PACER_TIMEOUT):
            self._forget_plant()
        if goes_on:
            self.robot.tick(now - self.robot.held_back)
        else:
            self.robot.publish()
        self._tell_plant()
        if now >= max(self.network.silent_until, self.network.mute_until):
            paused = now < max(self.network.outputs_paused_until, self.network.no_data_until)
            for channel in list(self.channels):
                if not channel.cycle(now, paused):
                    self._close(channel)

    def _forget_plant(self) -> None:
        if self.plant is not None:
            self.robot.set_wrench((0.0,) * 6)
        self.plant = self.until = None

    def _tell_plant(self) -> None:
        if self.plant is None:
            return
        arm = self.robot.arm
        state = {"time": self.robot.clock, "q": arm.q, "qd": arm.qd, "X_WE": arm.X_WE.tolist()}
        try:
            self._udp.sendto(json.dumps(state).encode(), self.plant)
        except OSError:
            self.plant = None

    def _serve(self, timeout: float) -> None:
        silent = time.monotonic() < self.network.silent_until
        readers: list[socket.socket] = [s for s in self.listeners if s is self.side or not silent]
        channels = {c.socket: c for c in self.channels if c.outside or not silent}
        readable, _, _ = select.select([*readers, *channels, self._udp], [], [], timeout)
        for ready in readable:
            if ready is self._udp:
                self._hear_plant()
            elif ready in self.listeners:
                self._accept(ready)
            elif channels[ready] in self.channels and not channels[ready].read():
                self._close(channels[ready])

    def _accept(self, listener: socket.socket) -> None:
        try:
            connection, _ = listener.accept()
        except OSError:
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.channels.append(self.listeners[listener](connection, self.robot, self.network))

    def _hear_plant(self) -> None:
        try:
            while True:
                data, address = self._udp.recvfrom(2048)
                message = json.loads(data)
                self.plant, self.plant_heard = address, time.monotonic()
                if "wrench" in message:
                    self.robot.set_wrench(message["wrench"])
                if "until" in message:
                    self.until = float(message["until"])
        except BlockingIOError:
            return
        except (ValueError, TypeError, OverflowError, RecursionError, SeedError) as error:
            self.robot.faults.messages.append(f"plant: {error}")

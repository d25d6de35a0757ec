# SPDX-License-Identifier: Apache-2.0
"""The ports of the stand-in and its clock: one thread, `select` until the next 2 ms deadline.

Ports: 30004 RTDE, 30001 to 30003 scripts, 29999 dashboard (not for PolyScope X), 30099 side port (JSON lines),
30098 UDP for a plant that wants the flange's pose and gives the wrench.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import random
import select
import socket
import time
from dataclasses import dataclass, field

from seed_core.errors import SeedError
from seed_ur.standin import dashboard
from seed_ur.standin import side_port as side
from seed_ur.standin.channel import Channel, Dashboard, Rtde, Script, Side
from seed_ur.standin.controller import PERIOD, Controller, Options
from seed_ur.standin.rtde_session import Ownership

RTDE_PORT, DASHBOARD_PORT, SIDE_PORT, PLANT_PORT = 30004, 29999, 30099, 30098
SCRIPT_PORTS = (30001, 30002, 30003)
PRIORITY = 70  # SCHED_FIFO, where it is allowed
CATCH_UP = 0.1  # [s] cycles later than this are skipped
PLANT_TIMEOUT = 0.5  # [s] without a word from the plant the wrench is zero
PACER_TIMEOUT = 5.0  # [s] of a plant that sets the pace: it may be busy
REPEAT = 0.01  # [s] between packages of a robot whose clock stands still for the plant: clients take silence for a loss


@dataclass
class Network:
    """Faults of the network."""

    silent_until: float = 0.0  # nothing is read or written, the arm goes on
    outputs_paused_until: float = 0.0
    mute_until: float = 0.0  # connections are accepted, nothing is answered
    no_data_until: float = 0.0  # set-up is answered, data never come
    delay: float = 0.0  # [s] of every output package
    drop: float = 0.0  # share of output packages lost
    freeze: float = 0.0  # [s] the whole process sleeps once
    rng: random.Random = field(default_factory=lambda: random.Random(5))


class Server:
    """All sockets and the controller behind them."""

    def __init__(self, host: str, options: Options, await_plant: bool = False) -> None:
        self.host = host
        self.box: Controller = Controller(options)
        self.network: Network = Network()
        self.owners = Ownership()
        self.channels: list[Channel] = []
        self.listeners: dict[socket.socket, type[Channel]] = {}
        self.plant: tuple[str, int] | None = None
        self.plant_heard = self.listen_again = 0.0
        self.until: float | None = None  # [s] by the robot's clock, how far the plant lets it run; None: on
        self.held_back = 0.0  # [s] that the plant has kept the robot's clock behind the wall's
        self.running = True
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.bind((host, PLANT_PORT))
        self._udp.setblocking(False)
        self._listen(SIDE_PORT, Side)
        self.awaiting_plant = await_plant
        if not await_plant:
            self._listen_robot()
        self.box.send_text = self._text

    def _listen(self, port: int, kind: type[Channel]) -> None:
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((self.host, port))
        except OSError as error:
            raise SeedError(
                f"port {port} on {self.host} cannot be opened: {error}; is another stand-in there?"
            ) from error
        listener.listen(16)
        listener.setblocking(False)
        self.listeners[listener] = kind

    def _listen_robot(self) -> None:
        self._listen(RTDE_PORT, Rtde)
        for port in SCRIPT_PORTS:
            self._listen(port, Script)
        if self.box.options.version[0] < 10:
            self._listen(DASHBOARD_PORT, Dashboard)

    @property
    def robot_now(self) -> float:
        """The robot's time [s]: monotonic, less what a plant has held it back."""
        return time.monotonic() - self.held_back

    def place(self, pose: list[float], near: list[float], clock: float | None = None) -> None:
        """Put the flange somewhere, before any program runs; opens the robot's ports when they wait for it.

        clock: what the robot's clock shows from now on [s]; it then runs only as far as the plant lets it.
        """
        self.box.place(pose, near)
        if clock is not None:
            self.box.now = self.robot_now
            self.box.boot, self.until = self.box.now - clock, clock
            self.plant_heard = time.monotonic()
        if self.awaiting_plant:
            self.awaiting_plant = False
            self._listen_robot()

    def refuse(self, seconds: float) -> None:
        """Close every port but the side port, and open them again later."""
        self.drop("")
        for listener in [s for s, kind in self.listeners.items() if kind is not Side]:
            listener.close()
            del self.listeners[listener]
        self.listen_again = time.monotonic() + seconds

    def drop(self, kind: str) -> None:
        """Close the connections of one kind ('rtde'), or all but those to the side port ('')."""
        for channel in list(self.channels):
            if isinstance(channel, Rtde) or (not kind and not isinstance(channel, Side)):
                self._close(channel)

    def kill(self) -> None:
        """As if the controller lost its power."""
        os._exit(1)

    def client_counts(self) -> dict[str, int]:
        """Open connections by kind."""
        names = [type(c).__name__.lower() for c in self.channels]
        return {name: names.count(name) for name in set(names)}

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
                self.box.recorder.tick(now - deadline)
                goes_on = self._may_go_on(deadline)
                if not goes_on:
                    self.held_back += PERIOD
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
        box = self.box
        return self.until is None or box.boot is None or now - self.held_back - box.boot <= self.until + 0.5 * PERIOD

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
            self.box.tick(now - self.held_back)
        else:
            self.box.publish()
        self._tell_plant()
        if now >= max(self.network.silent_until, self.network.mute_until):
            paused = now < max(self.network.outputs_paused_until, self.network.no_data_until)
            for channel in list(self.channels):
                if not channel.cycle(now, paused):
                    self._close(channel)

    def _forget_plant(self) -> None:
        if self.plant is not None:
            self.box.set_wrench((0.0,) * 6)
        self.plant = self.until = None

    def _tell_plant(self) -> None:
        if self.plant is None:
            return
        arm = self.box.arm
        state = {"time": self.box.clock, "q": arm.q, "qd": arm.qd, "X_WE": arm.X_WE.tolist()}
        try:
            self._udp.sendto(json.dumps(state).encode(), self.plant)
        except OSError:
            self.plant = None

    def _serve(self, timeout: float) -> None:
        silent = time.monotonic() < self.network.silent_until
        readers: list[socket.socket] = [s for s, kind in self.listeners.items() if kind is Side or not silent]
        channels = {c.socket: c for c in self.channels if isinstance(c, Side) or not silent}
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
        self.channels.append(self.listeners[listener](self, connection))

    def _hear_plant(self) -> None:
        try:
            while True:
                data, address = self._udp.recvfrom(2048)
                message = json.loads(data)
                self.plant, self.plant_heard = address, time.monotonic()
                if "wrench" in message:
                    self.box.set_wrench(message["wrench"])
                if "until" in message:
                    self.until = float(message["until"])
        except BlockingIOError:
            return
        except (ValueError, TypeError, SeedError) as error:
            self.box.faults.messages = [*self.box.faults.messages[-19:], f"plant: {error}"]


__all__ = ["Network", "Server", "dashboard", "side"]

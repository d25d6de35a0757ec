# SPDX-License-Identifier: Apache-2.0
"""A bag on the page: what was heard until some moment, and a slider over that moment. Needs no running ROS."""

import contextlib
import math
import time
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import viser
from rclpy.serialization import deserialize_message
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader

from seed_bringup.bags import BagError
from seed_bringup.bags.files import messages_of, open_bag
from seed_bringup.bags.types import InstalledTypes
from seed_bringup.page.panel import Panel, set_value
from seed_bringup.page.ros.read import HOLDS, PICTURES, TOPICS, fixed_frames, read_state
from seed_bringup.page.scene import Scene
from seed_bringup.page.server import PageServer
from seed_bringup.page.state import SPAN, CellState, History
from seed_core.program.command_line import interrupts
from seed_core.spatial import Array

RATE, NUMBERS_EVERY = 10.0, 3  # [Hz] of the pictures; pictures, plots and numbers are written anew
EVERY = 0.04  # [s] between two kept messages of a stream
RECENT = 0.3  # [s] that a picture stays
KEPT_ALL = (
    "/tf_static",
    "controller/ready",
    *HOLDS,
    *("sim/ground_truth/table_pose", "sim/ground_truth/table"),
)


class Recording:
    """What the page shows of a bag. Pictures are read when they are asked for, all else at once.

    Attributes:
        start, end: [s].
        fixed: poses of the fixed frames.

    Raises:
        BagError: nothing to show, or messages of another version.
    """

    def __init__(self, reader: Reader) -> None:
        self._reader = reader
        self.start, self.end = 1e-9 * reader.start_time, 1e-9 * reader.end_time
        names = _names(reader)
        if not names.keys() - {"/tf_static"}:
            has = ", ".join(sorted(reader.topics)) or "none"
            raise BagError(f"{reader.path} holds nothing to show (only {has}): record with ./seed bag record --all")
        types = InstalledTypes()
        for name, connection in names.items():
            _check_version(name, connection, types)
        self._pictures = [c for name, c in names.items() if name in PICTURES]
        self._names = {c.id: name for name, c in names.items()}
        self._stamps: dict[str, list[float]] = {}
        self._bytes: dict[str, list[bytes]] = {}
        for connection, stamp, data in messages_of(reader, [c for n, c in names.items() if n not in PICTURES]):
            self._keep(self._names[connection.id], 1e-9 * stamp, bytes(data))
        self.fixed: dict[tuple[str, str], Array] = {}
        for data in self._bytes.get("/tf_static", []):
            self.fixed |= dict(fixed_frames(_message("/tf_static", data)))

    def _keep(self, name: str, t: float, data: bytes) -> None:
        stamps = self._stamps.setdefault(name, [])
        if stamps and t - stamps[-1] < EVERY and name not in KEPT_ALL:
            return
        stamps.append(t)
        self._bytes.setdefault(name, []).append(data)

    @property
    def first(self) -> float:
        """The moment [s] from which there is something to see: the tool in the hand, else the arm, else anything."""
        for stamp, data in zip(
            self._stamps.get("relative_pose", []), self._bytes.get("relative_pose", []), strict=True
        ):
            if _message("relative_pose", data).valid:
                return max(stamp, self._stamps.get("current_pose", [stamp])[0])
        return self._stamps.get("current_pose", [self.start])[0]

    def at(self, t: float) -> CellState:
        """What was heard until t [s]."""
        newest: dict[str, Any] = {}
        for name, stamps in self._stamps.items():
            k = bisect_right(stamps, t)
            if k:
                newest[name] = _message(name, self._bytes[name][k - 1])
        return read_state({**newest, **self._pictures_until(t)}, self.fixed)

    def _pictures_until(self, t: float) -> Mapping[str, bytes]:
        if not self._pictures:
            return {}
        first, last = round(1e9 * (t - RECENT)), round(1e9 * t) + 1
        found = self._reader.messages(connections=self._pictures, start=first, stop=last)
        return {self._names[c.id]: bytes(data) for c, _, data in found}

    def fill(self, history: History, t: float) -> None:
        """Force and torque of the seconds before t [s]."""
        history.clear()
        stamps = self._stamps.get("controller/state", [])
        for k in range(bisect_right(stamps, t - SPAN), bisect_right(stamps, t)):
            message = _message("controller/state", self._bytes["controller/state"][k])
            history.add(read_state({"controller/state": message}, {}).control)


def _names(reader: Reader) -> dict[str, Connection]:
    """The bag's connections by what the page calls their topics; a bag of a cell in a namespace has that before all."""
    namespace = next((t[: -len("/controller/state")] for t in reader.topics if t.endswith("/controller/state")), "")
    return {
        name: connection
        for name in TOPICS
        for connection in reader.connections
        if connection.topic == f"{namespace}/{name.lstrip('/')}"
    }


def _check_version(name: str, connection: Connection, types: InstalledTypes) -> None:
    wanted = f"{TOPICS[name].kind.__module__.split('.')[0]}/msg/{TOPICS[name].kind.__name__}"
    if connection.msgtype != wanted:
        raise BagError(f"{connection.topic} is {connection.msgtype} in this bag; the page reads {wanted}")
    if connection.digest and connection.digest != types.hash(connection.msgtype):
        raise BagError(
            f"{connection.topic}: this bag was recorded with another version of {connection.msgtype}; "
            "look at it with the release that it was recorded with"
        )


def _message(name: str, data: bytes) -> Any:
    return deserialize_message(data, TOPICS[name].kind)


class Player:
    """The slider, and what is shown at it."""

    def __init__(self, server: PageServer, recording: Recording, model: str) -> None:
        self._server, self._recording = server, recording
        self._history = History()
        self._scene = Scene(server, model)
        gui = server.gui
        length = max(math.ceil(10.0 * (recording.end - recording.start)), 1) / 10.0
        self._first = min(math.ceil(10.0 * (recording.first - recording.start)) / 10.0, length)
        self._slider = gui.add_slider("Time [s]", 0.0, length, 0.1, self._first)
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        self._speed = gui.add_dropdown("Speed", ("0.25", "0.5", "1", "2", "5"), initial_value="1")
        self._panel = Panel(server, self._history, self._scene, None)
        self._play.on_click(lambda _: self._toggle())
        self._running = False
        self._shown, self._viewers, self._count = -1.0, 0, 0

    def _toggle(self) -> None:
        if not self._running and self._slider.value >= self._slider.max - 0.05:
            set_value(self._slider, self._first)
        self._running = not self._running
        self._play.label = "Pause" if self._running else "Play"

    def step(self, dt: float) -> None:
        """dt [s] of the wall's time have passed."""
        t = float(self._slider.value)
        if self._running:
            t = min(t + dt * float(self._speed.value), float(self._slider.max))
            set_value(self._slider, t)
            if t >= self._slider.max:
                self._toggle()
        viewers = len(self._server.get_clients())
        if t == self._shown and viewers <= self._viewers:
            self._viewers = viewers
            return
        if t < self._shown:
            self._scene.clear_path()
        self._shown, self._viewers = t, viewers
        self._count += 1
        now = self._recording.start + t
        numbers = not self._running or self._count % NUMBERS_EVERY == 0
        if numbers:
            self._recording.fill(self._history, now)
        state = self._recording.at(now)
        with self._server.atomic():
            self._scene.show(state)
            self._panel.show(state, 1, numbers)


def play(path: Path, port: int, model: str) -> int:
    """Serve the page of a bag until Ctrl-C. Raises BagError."""
    with open_bag(path) as reader, interrupts() as check, served(port, f"SEED: {path.name}") as server:
        recording = Recording(reader)
        player = Player(server, recording, model)
        print(f"the page of {path}: {server.address}   (Ctrl-C ends it)", flush=True)
        before = time.monotonic()
        while True:
            check()
            now = time.monotonic()
            player.step(now - before)
            before = now
            time.sleep(max(1.0 / RATE - (time.monotonic() - now), 0.005))


@contextlib.contextmanager
def served(port: int, title: str) -> Iterator[PageServer]:
    """A page's server that ends with the block."""
    server = PageServer(port, title)
    try:
        yield server
    finally:
        server.stop()

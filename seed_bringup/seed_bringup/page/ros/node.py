# SPDX-License-Identifier: Apache-2.0
"""`page`: the operator page of a running cell. It listens and calls services and the action; it publishes no command.

Of each stream it takes the newest message twelve times a second, and pictures only while a page is open, so that
neither a second page nor a slow one costs the loop anything.
"""

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rclpy.parameter import Parameter
from rclpy.subscription import Subscription

from seed_bringup.page.panel import Panel
from seed_bringup.page.ros.hands import CellHands
from seed_bringup.page.ros.read import PICTURES, STATE, TOPICS, fixed_frames, read_state
from seed_bringup.page.scene import Scene
from seed_bringup.page.server import PORT, PageServer
from seed_bringup.page.state import CellState, History
from seed_bringup.page.words import SILENT
from seed_control.tasks import load_task, shipped_tasks
from seed_core.config import field
from seed_core.errors import SeedError
from seed_core.spatial import Array
from seed_ros import LATCHED, FixedRateLoop, SeedNode, diagnostics
from seed_ros.conversions import seconds
from seed_ros.node import run
from seed_ur.models import MODELS

RATE = 12.0  # [Hz] of the pictures
NUMBERS_EVERY = 4  # pictures, plots and numbers are written anew
UNSEEN_EVERY = 12  # pictures, one is made for a page that may be opened: it begins with that one


@dataclass(frozen=True)
class PageSettings:
    """Parameters of the node."""

    port: int = field(PORT, low=0, high=65535, doc="of the page on loopback; the next free one if it is taken; 0: any")
    model: str = field("ur5e", choices=tuple(MODELS), doc="arm that is drawn")
    tasks: tuple[str, ...] = field(("",), doc="files of own tasks, offered beside the shipped ones")


class PageNode(SeedNode):
    """See docs/interfaces.md."""

    def __init__(self, name: str = "page", **arguments: Any) -> None:
        super().__init__(name, **arguments)
        settings = self.declare(PageSettings())
        self.refuse_unknown()
        self._newest: dict[str, Any] = {}
        self._fixed: dict[tuple[str, str], Array] = {}
        self._heard = time.monotonic()
        self._count = 0
        self.state = CellState()
        self.history = History()
        self.loop = FixedRateLoop(self, RATE, self._tick, steady=True, catch_up=False)
        self._streams = {topic: self._listen(topic) for topic in TOPICS.keys() - PICTURES}
        self._other = False  # whether another cell has begun to speak
        self._pictures: list[Subscription] = []
        own = tuple(t for t in settings.tasks if t)
        tools = {t: _tool_of(t) for t in (*own, *shipped_tasks())}
        self.hands = CellHands(self.context, tuple(tools), self.get_namespace(), f"{name}_hands", tools)
        self.server = PageServer(settings.port)
        self.scene = Scene(self.server, settings.model)
        self.panel = Panel(self.server, self.history, self.scene, self.hands)
        print(f"the operator page: {self.server.address}", flush=True)
        self.diagnose(self.server.address, self._report)

    def _listen(self, name: str) -> Subscription:
        topic = TOPICS[name]
        return self.loop.poll(topic.kind, name, lambda m, *_: self._on_message(name, m), topic.qos, raw=topic.raw)

    def _look(self, viewers: int) -> None:
        """Have pictures sent while somebody looks: the estimator draws its own only for listeners."""
        if viewers and not self._pictures:
            self._pictures = [self._listen(name) for name in PICTURES]
        elif not viewers and self._pictures:
            for subscription in self._pictures:
                self.loop.leave(subscription)
            self._pictures = []
            self._newest = {t: m for t, m in self._newest.items() if t not in PICTURES}

    def _on_message(self, topic: str, message: Any) -> None:
        now = time.monotonic()
        if self._newest and (now - self._heard > SILENT or self._goes_back(topic, message)):
            self._forget()
        self._newest[topic] = message
        self._heard = now
        if topic == "/tf_static":
            self._fixed = self._fixed | dict(fixed_frames(message))

    def _goes_back(self, topic: str, message: Any) -> bool:
        """Whether the controller's time does: that is another cell's."""
        before = self._newest.get(topic) if topic == STATE else None
        return before is not None and seconds(message.header.stamp) < seconds(before.header.stamp)

    def _forget(self) -> None:
        """What a cell has said that may have ended: the one that speaks now may be another."""
        self._newest, self._fixed = {}, {}
        self.history.clear()
        self.scene.clear_path()
        self.panel.clear_picture()
        self.hands.forget()
        self._other = True

    def _hear_latched(self) -> None:
        """Have what is said once said again: it may have come before its cell was told from the last."""
        for topic in (t for t in self._streams if TOPICS[t].qos is LATCHED):
            self.loop.leave(self._streams[topic])
            self._streams[topic] = self._listen(topic)
        self._other = False

    def _tick(self) -> None:
        if self._other:
            self._hear_latched()
        viewers = len(self.server.get_clients())
        self._count += 1
        self.hands.saw(viewers)
        self._look(viewers)
        self.state = read_state(
            self._newest, self._fixed, time.monotonic() - self._heard, self.hands.tool, self.hands.arm
        )
        self.history.add(self.state.control)
        self.beats.add()
        if viewers or self._count % UNSEEN_EVERY == 0:
            with self.server.atomic():
                self.scene.show(self.state)
                self.panel.show(self.state, viewers, numbers=self._count % NUMBERS_EVERY == 0)

    def _report(self) -> diagnostics.Report:
        viewers = len(self.server.get_clients())
        return diagnostics.OK, f"{viewers} page(s) open at {self.server.address}", {"viewers": viewers}

    def destroy_node(self) -> None:
        """End the server and the hands as well."""
        if hasattr(self, "panel"):
            self.hands.close()
            self.server.stop()
        super().destroy_node()


def _tool_of(task: str) -> str:
    """That it is made for; '' of a task that cannot be read: playing it says why."""
    try:
        return load_task(task).tool
    except SeedError:
        return ""


def serve(namespace: str, port: int, model: str, tasks: Sequence[str]) -> int:
    """The page of the cell in a namespace, until Ctrl-C; the exit code. Several may run beside each other."""
    given = {"port": port, "model": model, **({"tasks": list(tasks)} if tasks else {})}
    parameters = [Parameter(name, value=value) for name, value in given.items()]

    remaps = ["--ros-args", "-r", "/tf_static:=tf_static"]  # as the launch files have it
    name = f"page_{os.getpid()}"
    return run(lambda: PageNode(name, namespace=namespace, parameter_overrides=parameters, cli_args=remaps))


main = PageNode.main

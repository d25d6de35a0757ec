# SPDX-License-Identifier: Apache-2.0
"""Forwards what is allowed of a cell to Foxglove, serialized as it comes, and hands its buttons to the cell.

A topic is listened to while somebody in Foxglove looks at it: a bridge that nobody looks through costs nothing.
"""

import math
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import foxglove
import rclpy
from foxglove import Channel, Context, Service, ServiceRequest
from foxglove.websocket import Capability, ChannelView, Client, ServerListener
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from std_srvs.srv import Trigger

from seed_bringup.bags import BagError
from seed_bringup.bags.qos import TO_RECORD
from seed_bringup.bags.types import InstalledTypes, message_class
from seed_bringup.foxglove.offered import BUTTONS, STILL, offered_as
from seed_bringup.foxglove.schemas import read_play, schema_of, service_schema
from seed_bringup.page.ros.hands import CellHands, Said
from seed_control.tasks import load_task
from seed_core.errors import FailedError, SeedError
from seed_ros import FixedRateLoop, client_node

RATE = 30.0  # [Hz] at which messages are handed on
DISCOVERY = 0.5  # [s] between two looks for topics
PRESS, STOP = 30.0, 1.5  # [s] until a button has its answer

_Offered = frozenset[tuple[ReliabilityPolicy, DurabilityPolicy]]


class _Lookers(ServerListener):
    """Who looks at which topic; called by threads of the server."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open: set[tuple[int, str]] = set()
        self._new: set[str] = set()

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        with self._lock:
            self._open.add((client.id, channel.topic))
            self._new.add(channel.topic)

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        with self._lock:
            self._open.discard((client.id, channel.topic))

    def take(self) -> tuple[Counter[str], set[str]]:
        """How many look at each topic, and the topics with somebody new since the last call."""
        with self._lock:
            new, self._new = self._new, set()
            return Counter(topic for _, topic in self._open), new


class Bridge:
    """The server and its node; `loop.once` or `loop.run` turns it.

    Attributes:
        port: that it listens on.
    """

    def __init__(
        self,
        host: str,
        port: int,
        namespace: str = "/",
        buttons: bool = False,
        context: Any = None,
    ) -> None:
        """Listen. Raises FailedError: the port is taken, or the address is none of this computer."""
        self._namespace, self._lookers, self._graph = namespace, _Lookers(), Context()
        self._types = InstalledTypes()
        self._channels: dict[str, tuple[Channel, str, Any]] = {}  # topic there: channel, topic here, class
        self._heard: dict[str, tuple[Subscription, _Offered]] = {}  # and what was offered as it was subscribed to
        self._refused: set[str] = set()
        services = [
            Service(b, schema=service_schema(b), handler=self._on_button)
            for b in (*STILL, *(BUTTONS if buttons else ()))
        ]
        try:
            self._server = foxglove.start_server(
                name="SEED",
                host=host,
                port=port,
                capabilities=[Capability.Services],
                supported_encodings=["cdr"],
                services=services,
                server_listener=self._lookers,
                context=self._graph,
            )
        except Exception as error:  # the library names no type for it
            raise FailedError(f"cannot listen on {host}, port {port}: {error}; name another with --port") from error
        self.port = self._server.port
        self.node = client_node("foxglove", context=context, namespace=namespace)
        self.hands = CellHands(self.node.context, (), namespace, "foxglove_hands")
        self.loop = FixedRateLoop(self.node, RATE, self._tick, steady=True, catch_up=False)
        self._next_look = 0.0

    def close(self) -> None:
        """End server, node and hands; a task that was begun here ends with them."""
        self._server.stop()
        self.hands.close()
        self.node.destroy_node()

    def _tick(self) -> None:
        looked_at, new = self._lookers.take()
        self.hands.saw(sum(looked_at.values()))
        if look := time.monotonic() >= self._next_look:
            self._next_look = time.monotonic() + DISCOVERY
            self._discover()
        for topic in [t for t in self._heard if t in new or not looked_at[t]]:
            self.loop.leave(self._heard.pop(topic)[0])
        for topic in (t for t, n in looked_at.items() if n and t not in self._heard and t in self._channels):
            if look or topic in new:  # anew for a newcomer, who is told what is latched
                self._hear(topic)

    def _hear(self, topic: str) -> None:
        """Subscribe to a topic that is published: without that nothing tells how it will be offered."""
        channel, here, kind = self._channels[topic]
        if offered := self._offered(here):
            subscription = self.loop.poll(kind, here, _forward(channel), TO_RECORD, raw=True)
            self._heard[topic] = subscription, offered

    def _offered(self, here: str) -> _Offered:
        """Reliability and durability of those who publish a topic; empty without any."""
        known = (info.qos_profile for info in self.node.get_publishers_info_by_topic(here))
        return frozenset((profile.reliability, profile.durability) for profile in known)

    def _discover(self) -> None:
        """Offer topics that are new; leave those whose publishers are gone, or offer them in another way by now."""
        for heard, (subscription, offered) in list(self._heard.items()):
            if self._offered(self._channels[heard][1]) != offered:
                self.loop.leave(subscription)
                del self._heard[heard]
        for here, kinds in self.node.get_topic_names_and_types():
            topic = offered_as(here, self._namespace)
            if topic is None or topic in self._channels or topic in self._refused:
                continue
            if not self.node.get_publishers_info_by_topic(here):
                continue
            try:
                schema, kind = schema_of(self._types, kinds[0]), message_class(kinds[0])
            except BagError as error:
                self._refused.add(topic)
                self.node.get_logger().warning(f"not forwarding {here}: {error}")
                continue
            channel = Channel(topic, schema=schema, message_encoding="cdr", context=self._graph)
            self._channels[topic] = channel, here, kind

    def _on_button(self, request: ServiceRequest) -> bytes:
        """Serve a button, in a thread of the server; the answer in CDR."""
        try:
            good, words = self._press(request.service_name, request.payload)
        except (SeedError, ValueError) as error:
            good, words = False, str(error)
        return bytes(serialize_message(Trigger.Response(success=good, message=words)))

    def _press(self, button: str, payload: bytes) -> tuple[bool, str]:
        if button == "Stop":
            return _answer(self.hands.stop(), STOP)
        if button == "Play":
            task, force = read_play(payload)
            if force is not None and not (math.isfinite(force) and force > 0.0):
                raise ValueError(f"force = {force} N must be above 0, or 0 for the task's own")
            load_task(task, force)  # says here and now what is wrong with it
            self.hands.play(task, force)
            return True, f"{task} is asked for; it ends 5 s after nobody looks at a topic. Cancel lifts the tool."
        name = "Lift" if button == "Cancel" else button
        return _answer(self.hands.press(name), PRESS)


def _answer(said: Said, patience: float) -> tuple[bool, str]:
    """What came of a button within patience [s]: whether it was done, and the words."""
    try:
        return said.result(patience)
    except TimeoutError:
        return False, f"no answer within {patience:g} s"


def _forward(channel: Channel) -> Callable[[bytes, Any], None]:
    return lambda data, _: channel.log(bytes(data))


def serve(host: str, port: int, namespace: str, buttons: bool, check: Callable[[], None]) -> None:
    """Forward until `check`, which is called often, raises."""
    remaps = ["--ros-args", "-r", "/tf:=tf", "-r", "/tf_static:=tf_static"]
    rclpy.init(args=remaps, signal_handler_options=SignalHandlerOptions.NO)  # its own would end the context first
    bridge = Bridge(host, port, namespace, buttons)
    beyond = host not in ("127.0.0.1", "localhost", "::1")
    who = f"EVERY COMPUTER that reaches {host}" if beyond else "this computer alone"
    what = "see the cell and press its buttons" if buttons else "see the cell and stop it"
    print(f"seed foxglove: ws://{host}:{bridge.port}; {who} can {what}", flush=True)

    def stopping() -> bool:
        check()
        return False

    try:
        bridge.loop.run(stopping)
    finally:
        bridge.close()
        rclpy.try_shutdown()

# SPDX-License-Identifier: Apache-2.0
"""Records topics, those that appear later too, until told to stop."""

import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rosbags.interfaces import Connection
from rosgraph_msgs.msg import Clock

from seed_bringup.bags import BagError, qos
from seed_bringup.bags.files import BagWriter
from seed_bringup.bags.names import check_topic
from seed_bringup.bags.sim_clock import SILENT, SimClock
from seed_bringup.bags.types import is_feedback, message_class
from seed_ros.loop import CLOCK_PATIENCE, FixedRateLoop

DISCOVERY_PERIOD = 0.2  # [s]
PATIENCE = 5.0  # [s] for the first message, beside the time that was asked for
POLL_RATE = 25.0  # [Hz]; a queue holds the fastest streams for longer than that, and a look costs less than a wake-up
EVERY_CLOCK = QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)  # to know it between them


class Recorder(Node):
    """Subscribes to topics as they appear and writes their messages as they came, never deserialized."""

    def __init__(
        self, writer: BagWriter, topics: Sequence[str], everything: bool, sim_time: bool, namespace: str = "/"
    ) -> None:
        super().__init__("seed_bag_recorder", namespace=namespace, start_parameter_services=False)
        self.writer = writer
        self.everything = everything
        self.sim_time = sim_time
        self.wanted = {self.resolve_topic_name(topic) for topic in topics}
        self.recorded: set[str] = set()
        self.refused: set[str] = set()
        self.before_clock = 0
        self.begun: float | None = None  # monotonic time [s] of the first message
        self.clock_topic, self.clock = self.resolve_topic_name("clock"), SimClock()
        self._waiting: list[tuple[int, Connection, bytes]] = []  # when it arrived [ns], until its clock is known
        self.loop = FixedRateLoop(self, POLL_RATE, self._stamp_by_clock)
        if sim_time:  # not by use_sim_time, which knows /clock alone
            self.loop.poll(Clock, self.clock_topic, self._on_clock, EVERY_CLOCK, raw=True)
            self.silence = self.create_timer(CLOCK_PATIENCE, self._tell_of_silence)
        self.create_timer(DISCOVERY_PERIOD, self.discover)
        self.discover()

    def _on_clock(self, data: bytes, info: dict[str, int]) -> None:
        shown = deserialize_message(data, Clock).clock
        self.clock.heard(info["received_timestamp"], shown.sec * 10**9 + shown.nanosec)

    def _stamp_by_clock(self, ended: bool = False) -> None:
        """Write what waits, by what the clock showed as it arrived; ended: no message of the clock comes any more."""
        now = time.time_ns()
        came, self._waiting = sorted(self._waiting, key=lambda one: one[0]), []
        for one in came:
            arrived, connection, data = one
            stamp = self.clock.at(arrived, now + (2 * SILENT if ended else 0))
            if stamp is None:
                self._waiting.append(one)
            elif stamp:
                self._write(connection, stamp, data)
            else:
                self.before_clock += 1
        self.clock.forget(now - 2 * SILENT)

    def _tell_of_silence(self) -> None:
        """Once."""
        self.silence.cancel()
        if not self.clock:
            self.get_logger().warning(f"nothing comes on {self.clock_topic}: nothing is recorded before it does")

    def discover(self) -> None:
        """Subscribe to what is wanted and published by now."""
        known = self.recorded | self.refused
        if not self.everything and self.wanted <= known:
            return
        for topic, types in self.get_topic_names_and_types():
            wanted = topic in self.wanted or (self.everything and not is_feedback(types[0]))
            if wanted and topic not in known:
                self._subscribe(topic, types[0])

    def _subscribe(self, topic: str, type_name: str) -> None:
        offered = [info.qos_profile for info in self.get_publishers_info_by_topic(topic)]
        if not offered:
            return
        try:
            connection = self.writer.add_topic(topic, type_name, [qos.for_bag(profile) for profile in offered])
            kind = message_class(type_name)
        except BagError as error:
            self.refused.add(topic)
            self.get_logger().warning(f"not recording {topic}: {error}")
            return
        self.loop.poll(kind, topic, self._keep(connection), qos.TO_RECORD, raw=True)
        self.recorded.add(topic)
        self.get_logger().info(f"recording {topic} ({type_name})")

    def _keep(self, connection: Connection) -> Callable[[bytes, dict[str, int]], None]:
        def keep(data: bytes, info: dict[str, int]) -> None:
            arrived = info["received_timestamp"]
            if self.sim_time:
                self._waiting.append((arrived, connection, data))
            else:
                self._write(connection, arrived, data)

        return keep

    def _write(self, connection: Connection, stamp: int, data: bytes) -> None:
        self.begun = self.begun or time.monotonic()
        self.writer.write(connection, stamp, data)

    def finish(self) -> None:
        """Take and write what has come."""
        self.loop.take()
        self._stamp_by_clock(ended=True)

    def report(self) -> None:
        """Warn of what is not in the bag."""
        for topic in sorted(self.wanted - self.recorded):
            self.get_logger().warning(f"{topic} was asked for and not published meanwhile")
        if self.before_clock:
            self.get_logger().warning(
                f"{self.before_clock} messages came before the first {self.clock_topic} and are not in the bag"
            )


def record(
    path: Path,
    topics: Sequence[str],
    everything: bool = False,
    sim_time: bool = False,
    duration: float | None = None,
    namespace: str = "/",
) -> BagWriter:
    """Record until SIGINT or SIGTERM, or for `duration` [s] from the first message on; the bag is complete on return.

    namespace: of the clock, and of topics without a slash.

    Raises:
        BagError: no such topic can be, the bag cannot be written, or no message has come.
    """
    for topic in topics:
        check_topic(topic, namespace)
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda received, _: stopping.append(received))
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    start = time.monotonic()
    try:
        with BagWriter(path) as writer:
            node = Recorder(writer, topics, everything, sim_time, namespace)

            def over() -> bool:
                begun = start + PATIENCE if node.begun is None else node.begun
                return bool(stopping) or (duration is not None and time.monotonic() >= begun + duration)

            node.loop.run(over)
            node.finish()
            node.report()
    except OSError as error:
        raise BagError(f"{path}: {error.strerror or error}") from error
    finally:
        rclpy.try_shutdown()
    if not sum(writer.counts.values()):
        writer.discard()
        raise BagError(f"{path} is not written: no message has come on the topics that were asked for")
    return writer

# SPDX-License-Identifier: Apache-2.0
"""Records topics, those that appear later too, until told to stop."""

import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rosbags.interfaces import Connection
from rosgraph_msgs.msg import Clock

from seed_bringup.bags import BagError, qos
from seed_bringup.bags.files import BagWriter
from seed_bringup.bags.names import check_topic
from seed_bringup.bags.types import is_feedback, message_class
from seed_ros.loop import CLOCK_PATIENCE, FixedRateLoop
from seed_ros.qos import CLOCK

DISCOVERY_PERIOD = 0.2  # [s]
PATIENCE = 5.0  # [s] for the first message, beside the time that was asked for
POLL_RATE = 25.0  # [Hz]; a queue holds the fastest streams for longer than that, and a look costs less than a wake-up


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
        self.clock_topic, self.clock = self.resolve_topic_name("clock"), 0  # [ns], 0 before it is heard
        self.loop = FixedRateLoop(self, POLL_RATE, lambda: None)
        if sim_time:  # not by use_sim_time, which knows /clock alone
            self.loop.poll(Clock, self.clock_topic, self._on_clock, CLOCK)
            self.silence = self.create_timer(CLOCK_PATIENCE, self._tell_of_silence)
        self.create_timer(DISCOVERY_PERIOD, self.discover)
        self.discover()

    def _on_clock(self, message: Clock) -> None:
        self.clock = message.clock.sec * 10**9 + message.clock.nanosec

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
            stamp = self.clock if self.sim_time else info["received_timestamp"]
            if stamp:
                self.begun = self.begun or time.monotonic()
                self.writer.write(connection, stamp, data)
            else:
                self.before_clock += 1

        return keep

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
            node.loop.take()
            node.report()
    except OSError as error:
        raise BagError(f"{path}: {error.strerror or error}") from error
    finally:
        rclpy.try_shutdown()
    if not sum(writer.counts.values()):
        raise BagError(f"{path} is empty: no message has come on the topics that were asked for")
    return writer

# SPDX-License-Identifier: Apache-2.0
"""Plays a bag: the recorded bytes, at their times, with the recorded quality of service."""

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock

from seed_bringup.bags import BagError, qos
from seed_bringup.bags.files import messages_of, open_bag
from seed_bringup.bags.names import check_topic
from seed_bringup.bags.types import InstalledTypes, message_class
from seed_ros.qos import full_name

CLOCK_PERIOD = 0.01  # [s] of wall time between two /clock messages
LEAST_ROUND = 1.0  # [s] of wall time from one beginning of a loop to the next: a bag may be as short as a message
# Ends of the names of topics that move something
COMMANDS = (
    "/target_frame", "/gripper/command", "/gripper/force_command", "/controller/operator", "/controller/setpoint",
    "/controller/wrench_setpoint", "/controller/relative_pose_setpoint",
)  # fmt: skip
PATIENCE = 3.0  # [s] a process that is there already may take so long to be found


class Player(Node):
    """Publishes what a bag holds; arguments as of play()."""

    def __init__(
        self,
        reader: Reader,
        rate: float,
        clock: bool,
        topics: Sequence[str],
        remap: Mapping[str, str],
        namespace: str = "/",
    ) -> None:
        super().__init__("seed_bag_player", namespace=namespace, start_parameter_services=False)
        for topic in [*topics, *remap]:
            if topic not in reader.topics:
                raise BagError(f"the bag has no topic {topic!r}; it has: {', '.join(sorted(reader.topics))}")
        self.reader = reader
        self.rate = rate
        clock_topic = self.resolve_topic_name("clock")
        commands = set() if topics else {t for t in reader.topics if t.endswith(COMMANDS) and t not in remap}
        wanted = set(topics or reader.topics) - commands - ({clock_topic} if clock else set())
        self.connections = [c for c in reader.connections if c.topic in wanted]
        if not any(c.msgcount for c in self.connections):
            on = f": no message on {', '.join(sorted(wanted))}" if wanted else ""
            told = f"; {clock_topic} is told from the bag's times, not played" if clock else ""
            obeyed = f"; commands, as {min(commands)}, are played with --topics alone" if commands else ""
            raise BagError(f"{reader.path}: nothing to play{on}{told}{obeyed}")
        if commands:
            print(
                f"seed bag: not played, for arms and grippers obey them: {', '.join(sorted(commands))}; "
                "--topics plays what it names",
                file=sys.stderr,
            )
        types, names = InstalledTypes(), {c.id: remap.get(c.topic, c.topic) for c in self.connections}
        for name in names.values():
            check_topic(name, namespace)
        self.outputs = {c.id: self._publisher(c, names[c.id], types) for c in self.connections}
        self.clock_output = self.create_publisher(Clock, clock_topic, QoSProfile(depth=10)) if clock else None
        self.named = {*(remap.get(t, t) for t in topics), *remap.values()}
        self.published = 0

    def _publisher(self, connection: Connection, topic: str, types: InstalledTypes) -> Any:
        if connection.digest and connection.digest != (installed := types.hash(connection.msgtype)):
            # Bytes of another version of a type would arrive as nonsense.
            raise BagError(
                f"{connection.topic}: the bag's {connection.msgtype} differs from the installed one "
                f"({connection.digest} against {installed}); play it with the release that it was recorded with"
            )
        assert isinstance(connection.ext, ConnectionExtRosbag2)
        profile = qos.to_play(connection.ext.offered_qos_profiles, connection.msgcount)
        return self.create_publisher(message_class(connection.msgtype), topic, profile)

    def wait_for_subscriber(self) -> None:
        """Until somebody listens, but no longer than PATIENCE."""
        deadline = time.monotonic() + PATIENCE
        while rclpy.ok() and time.monotonic() < deadline:
            if any(output.get_subscription_count() for output in self.outputs.values()):
                return
            time.sleep(0.01)

    def leave_out_what_comes_live(self) -> None:
        """Topics that were not named, and that another node publishes: what is live and what is recorded would mix.

        Raises:
            BagError: nothing is left to play, or the time of the bag would mix with that of another node.
        """
        if self.clock_output is not None and (live := self._others_on(clock := self.clock_output.topic_name)):
            raise BagError(f"{clock} is told by {', '.join(live)} already: end that, or play without --clock")
        found = {o.topic_name: live for o in self.outputs.values() if (live := self._others_on(o.topic_name))}
        found = {topic: live for topic, live in found.items() if topic not in self.named}
        if not found:
            return
        nodes = ", ".join(sorted({name for live in found.values() for name in live}))
        told = f"these are published already, by {nodes}: {', '.join(sorted(found))}"
        self.connections = [c for c in self.connections if self.outputs[c.id].topic_name not in found]
        if not any(c.msgcount for c in self.connections):
            raise BagError(f"nothing to play; {told}; --topics plays what it names")
        print(f"seed bag: not played, for {told}; --topics plays what it names", file=sys.stderr)

    def _others_on(self, topic: str) -> list[str]:
        """Full names of the other nodes that publish a topic."""
        found = {full_name(publisher) for publisher in self.get_publishers_info_by_topic(topic)}
        return sorted(found - {self.get_fully_qualified_name()})

    def play_once(self) -> None:
        """From the first message to the last."""
        started, first = time.monotonic(), None
        for connection, stamp, data in messages_of(self.reader, self.connections):
            first = stamp if first is None else first
            self._wait_for(started, first, stamp)
            if not rclpy.ok():
                return
            self.outputs[connection.id].publish(bytes(data))
            self.published += 1

    def play_again_and_again(self) -> None:
        """Until ROS ends."""
        while rclpy.ok():
            due = time.monotonic() + LEAST_ROUND
            self.play_once()
            while rclpy.ok() and time.monotonic() < due:
                time.sleep(CLOCK_PERIOD)

    def _wait_for(self, started: float, first: int, stamp: int) -> None:
        """Sleep until a message is due; tell the time meanwhile."""
        while rclpy.ok():
            played = (time.monotonic() - started) * self.rate  # [s] of the bag
            remaining = (stamp - first) * 1e-9 - played
            if remaining <= 0.0:
                break
            self._tell(min(first + int(played * 1e9), stamp))
            time.sleep(min(remaining / self.rate, CLOCK_PERIOD))
        self._tell(stamp)

    def _tell(self, stamp: int) -> None:
        if self.clock_output is not None:
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(stamp, 10**9)
            self.clock_output.publish(message)

    def finish(self) -> None:
        """Give reliable subscribers the time to take the last messages."""
        for output in self.outputs.values():
            output.wait_for_all_acked(Duration(seconds=2.0))


def play(
    path: Path,
    rate: float = 1.0,
    clock: bool = False,
    loop: bool = False,
    delay: float = 1.0,
    topics: Sequence[str] = (),
    remap: Mapping[str, str] = MappingProxyType({}),
    namespace: str = "/",
) -> int:
    """Play a bag.

    Args:
        path: Folder or file of the bag.
        rate: Seconds of the bag per second.
        clock: Whether to publish the clock from the bag's times.
        loop: Whether to play again and again, at most once in LEAST_ROUND.
        delay: [s] before the first message, for subscribers to be found; more while there is none.
        topics: Only these; when empty all but those that move something (COMMANDS), and those that other nodes
            publish.
        remap: Names under which topics are published, by their names in the bag.
        namespace: Of the clock that is published, with its slash.

    Returns:
        How many messages were published.

    Raises:
        BagError: No bag, no such topic, a name that no topic can have, nothing to play, all of it comes live, or a
            type that is not installed as it was recorded.
    """
    if not rate > 0.0:
        raise BagError(f"rate = {rate} must be > 0")
    with open_bag(path) as reader:
        rclpy.init(args=[])
        try:
            player = Player(reader, rate, clock, topics, remap, namespace)
            time.sleep(delay)
            player.wait_for_subscriber()
            player.leave_out_what_comes_live()
            if loop:
                player.play_again_and_again()
            else:
                player.play_once()
            if rclpy.ok():
                player.finish()
            return player.published
        finally:
            rclpy.try_shutdown()

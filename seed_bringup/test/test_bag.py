# SPDX-License-Identifier: Apache-2.0
"""Bags round trip: recorded by one process, read by rosbags, played by another to a late joiner."""

import itertools
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")

from geometry_msgs.msg import TransformStamped, WrenchStamped  # noqa: E402
from rclpy.action import ActionServer  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data  # noqa: E402
from rosbags.highlevel import AnyReader  # noqa: E402
from rosbags.interfaces import QosDurability, QosReliability  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from seed_msgs.action import FollowSetpoints  # noqa: E402
from std_msgs.msg import Float32, String  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

from seed_bringup.bags import BagError  # noqa: E402
from seed_bringup.bags.files import BagWriter, describe_bag, messages_of, open_bag, read_messages  # noqa: E402
from seed_bringup.bags.play import Player  # noqa: E402
from seed_bringup.bags.record import record  # noqa: E402
from seed_bringup.bags.recording import recording  # noqa: E402
from seed_bringup.bags.sim_clock import SILENT, SimClock  # noqa: E402
from seed_bringup.bags.types import InstalledTypes, definition_file, message_class  # noqa: E402

pytestmark = pytest.mark.realtime
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TOPICS = ["/cell/wrench", "/cell/force", "/cell/mode", "/tf"]
COUNT = 40
PERIOD = 0.02  # [s]


@pytest.fixture
def node() -> Iterator[Node]:
    rclpy.init(args=[])
    node = rclpy.create_node("bag_test")
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def wait_until(condition: object, node: Node, patience: float) -> bool:
    deadline = time.monotonic() + patience
    while not condition() and time.monotonic() < deadline:  # type: ignore[operator]
        rclpy.spin_once(node, timeout_sec=0.05)
    return bool(condition())  # type: ignore[operator]


def publish_everything(node: Node, path: Path, topics: list[str]) -> Path:
    """Publish numbered messages of several kinds while they are recorded."""
    wrench = node.create_publisher(WrenchStamped, "/cell/wrench", 10)
    force = node.create_publisher(Float32, "/cell/force", qos_profile_sensor_data)
    mode = node.create_publisher(String, "/cell/mode", LATCHED)
    tf = node.create_publisher(TFMessage, "/tf", 100)
    mode.publish(String(data="remote control"))  # before the recorder is there
    with recording(path, topics) as said:
        assert wait_until(
            lambda: min(wrench.get_subscription_count(), force.get_subscription_count()) > 0, node, 15.0
        ), said()
        assert wait_until(lambda: min(mode.get_subscription_count(), tf.get_subscription_count()) > 0, node, 5.0)
        time.sleep(0.5)
        for i in range(COUNT):
            message = WrenchStamped()
            message.header.frame_id = "tip"
            message.wrench.force.z = float(i)
            wrench.publish(message)
            force.publish(Float32(data=float(i)))
            tf.publish(TFMessage(transforms=[TransformStamped(child_frame_id=f"tool{i}")]))
            time.sleep(PERIOD)
        time.sleep(0.3)
    return path


def played(arguments: list[str]) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-P", "-m", "seed_bringup.commands.bag", "play", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


def test_bag_keeps_every_message_its_quality_of_service_and_its_timing(node: Node, tmp_path: Path) -> None:
    path = publish_everything(node, tmp_path / "bag.mcap", TOPICS)
    assert path.is_file()
    with AnyReader([path]) as reader:
        assert set(reader.topics) == set(TOPICS)
        by_topic: dict[str, list[object]] = {topic: [] for topic in TOPICS}
        stamps: dict[str, list[int]] = {topic: [] for topic in TOPICS}
        for connection, stamp, data in reader.messages():
            by_topic[connection.topic].append(reader.deserialize(data, connection.msgtype))
            stamps[connection.topic].append(stamp)
        durability = {c.topic: c.ext.offered_qos_profiles[0].durability for c in reader.connections}
        reliability = {c.topic: c.ext.offered_qos_profiles[0].reliability for c in reader.connections}
    assert [m.wrench.force.z for m in by_topic["/cell/wrench"]] == [float(i) for i in range(COUNT)]
    assert [m.transforms[0].child_frame_id for m in by_topic["/tf"]] == [f"tool{i}" for i in range(COUNT)]
    assert [m.data for m in by_topic["/cell/mode"]] == ["remote control"]
    assert durability["/cell/mode"] == QosDurability.TRANSIENT_LOCAL
    assert durability["/cell/wrench"] == QosDurability.VOLATILE
    assert reliability["/cell/force"] == QosReliability.BEST_EFFORT
    assert reliability["/cell/wrench"] == QosReliability.RELIABLE
    span = (stamps["/cell/wrench"][-1] - stamps["/cell/wrench"][0]) * 1e-9
    assert span == pytest.approx((COUNT - 1) * PERIOD, rel=0.5)  # a busy machine sleeps longer


def test_played_bag_arrives_in_order_latched_topics_also_late_and_with_its_clock(node: Node, tmp_path: Path) -> None:
    bag = publish_everything(node, tmp_path / "bag", TOPICS)
    assert (bag / "metadata.yaml").is_file()
    received: dict[str, list[object]] = {"wrench": [], "mode": [], "clock": []}
    node.create_subscription(WrenchStamped, "/played/wrench", received["wrench"].append, 100)
    node.create_subscription(String, "/played/mode", received["mode"].append, LATCHED)
    node.create_subscription(Clock, "/clock", received["clock"].append, 100)
    arguments = [str(bag), "--clock", "--rate", "2.0", "--delay", "3.0", "--remap", "/cell/wrench:=/played/wrench"]
    arguments += ["/cell/mode:=/played/mode"]
    player = subprocess.Popen([sys.executable, "-P", "-m", "seed_bringup.commands.bag", "play", *arguments])
    assert wait_until(lambda: len(received["wrench"]) == COUNT, node, 20.0)
    assert player.wait(timeout=10.0) == 0
    assert [m.wrench.force.z for m in received["wrench"]] == [float(i) for i in range(COUNT)]
    assert [m.data for m in received["mode"]] == ["remote control"]
    clock = [m.clock.sec + m.clock.nanosec * 1e-9 for m in received["clock"]]
    assert clock == sorted(clock)
    assert len(clock) > COUNT


def test_type_hashes_are_those_that_rosidl_computed() -> None:
    """The independent check: rosidl writes the hash of every type beside its definition."""
    types = InstalledTypes()
    packages, checked = ("geometry_msgs", "sensor_msgs", "seed_msgs", "tf2_msgs"), []
    for prefix in os.environ["AMENT_PREFIX_PATH"].split(":"):
        for package in packages:
            for file in sorted(Path(prefix, "share", package, "msg").glob("*.json")):
                known = {t["type_name"]: t["hash_string"] for t in json.loads(file.read_text())["type_hashes"]}
                name = f"{package}/msg/{file.stem}"
                assert types.hash(name) == known[name]
                checked.append(package)
    assert set(checked) == set(packages)
    assert len(checked) > 50


def test_installed_tf_message_has_the_hash_of_the_real_one() -> None:
    """Ours is a stand-in with the wheels; rosbags carries the definitions of the ROS 2 releases."""
    real = get_typestore(Stores.ROS2_JAZZY).hash_rihs01("tf2_msgs/msg/TFMessage")
    assert InstalledTypes().hash("tf2_msgs/msg/TFMessage") == real


def test_mistakes_are_named(tmp_path: Path) -> None:
    assert "not a readable bag" in played([str(tmp_path / "gone")]).stderr
    with BagWriter(tmp_path / "one.mcap") as writer:
        connection = writer.add_topic("/force", "std_msgs/msg/Float32")
        writer.write(connection, 1, b"\x00\x01\x00\x00\x00\x00\x80?")
    wrong = played([str(tmp_path / "one.mcap"), "--topics", "/farce"])
    assert wrong.returncode == 2
    assert "the bag has no topic '/farce'; it has: /force" in wrong.stderr
    renamed = played([str(tmp_path / "one.mcap"), "--remap", "/force:=1bad"])
    assert (renamed.returncode, renamed.stderr.count("\n")) == (2, 1)
    assert "'1bad' names no topic: topic name token must not start with a number" in renamed.stderr
    with pytest.raises(BagError, match="never overwritten"):
        BagWriter(tmp_path / "one.mcap")
    with pytest.raises(BagError, match="'no_msgs/msg/Nothing' is not installed"):
        definition_file("no_msgs/msg/Nothing")


@pytest.mark.parametrize("name", ["1bad", "a//b", "a b", "", "{gone}/a"])
def test_a_name_that_no_topic_can_have_is_refused_before_a_bag_is_made(name: str, tmp_path: Path) -> None:
    with pytest.raises(BagError, match=f"^'{re.escape(name)}' names no topic: "):
        record(tmp_path / "bag", ["/force", name], duration=0.0)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["bag", "bag.mcap"])
def test_a_bag_without_a_message_is_told_as_that_and_not_kept_by_the_recorder(tmp_path: Path, name: str) -> None:
    with BagWriter(tmp_path / "empty.mcap") as writer:
        writer.add_topic("/force", "std_msgs/msg/Float32")
    assert "start      never: it holds no message\nduration   0.000 s" in describe_bag(tmp_path / "empty.mcap")
    for _ in range(2):  # the second finds no bag of the first
        with pytest.raises(BagError, match=f"{name} is not written: no message has come"):
            record(tmp_path / name, ["/nobody"], duration=-4.9)
    assert [file.name for file in tmp_path.iterdir()] == ["empty.mcap"]


def bag_of(path: Path, *topics: str) -> Path:
    """One message on each topic, all at one instant."""
    with BagWriter(path) as writer:
        for topic in topics:
            writer.write(writer.add_topic(topic, "std_msgs/msg/Float32"), 1, b"\x00\x01\x00\x00\x00\x00\x80?")
    return path


def test_commands_of_arm_and_gripper_are_played_by_name_alone(tmp_path: Path) -> None:
    bag = str(bag_of(tmp_path / "bag.mcap", "/gripper/command", "/left/target_frame", "/force"))
    ended = played([bag, "--delay", "0"])
    assert ended.returncode == 0
    assert "obey them: /gripper/command, /left/target_frame; --topics" in ended.stderr
    assert "1 messages played" in ended.stdout
    ended = played([bag, "--delay", "0", "--topics", "/gripper/command", "/force"])
    assert "2 messages played" in ended.stdout
    assert not ended.stderr
    commands = str(bag_of(tmp_path / "commands.mcap", "/gripper/command"))
    assert "commands, as /gripper/command, are played with --topics alone" in played([commands]).stderr


def test_what_another_node_publishes_is_left_out_unless_it_is_named(node: Node, tmp_path: Path) -> None:
    """A bag that is played beside a cell or an estimator mixed with what they publish, and its clock with theirs."""
    bag = str(bag_of(tmp_path / "bag.mcap", "/force", "/other"))
    node.create_publisher(Float32, "/force", 10)
    ended = played([bag])
    assert "published already, by /bag_test: /force; --topics" in ended.stderr
    assert "1 messages played" in ended.stdout
    ended = played([bag, "--topics", "/force"])
    assert "1 messages played" in ended.stdout
    assert not ended.stderr
    node.create_publisher(Float32, "/other", 10)
    ended = played([bag])
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert "nothing to play; these are published already, by /bag_test: /force, /other" in ended.stderr
    node.create_publisher(Clock, "/clock", 10)
    assert "/clock is told by /bag_test already" in played([bag, "--clock"]).stderr


@pytest.mark.parametrize(
    ("topics", "arguments", "words"),
    [
        ([], ["--loop"], "nothing to play\n"),
        (["/clock"], ["--clock"], "nothing to play; /clock is told from the bag's times, not played\n"),
        (["/clock", "/force"], ["--clock", "--topics", "/clock"], "nothing to play; /clock is told"),
        (["/left/clock"], ["--clock", "--namespace", "left"], "nothing to play; /left/clock is told"),
    ],
)
def test_nothing_to_play_is_refused(topics: list[str], arguments: list[str], words: str, tmp_path: Path) -> None:
    ended = played([str(bag_of(tmp_path / "bag.mcap", *topics)), "--delay", "0", *arguments])
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert words in ended.stderr


def test_no_connections_are_no_messages(tmp_path: Path) -> None:
    with open_bag(bag_of(tmp_path / "bag.mcap", "/force")) as reader:
        assert len(list(messages_of(reader, reader.connections))) == 1
        assert not list(messages_of(reader, []))


def test_one_instant_is_looped_once_a_second(node: Node, tmp_path: Path) -> None:
    heard: list[float] = []
    node.create_subscription(Float32, "/force", lambda _: heard.append(time.monotonic()), 100)
    bag = bag_of(tmp_path / "bag.mcap", "/force", "/torque")
    player = subprocess.Popen([sys.executable, "-P", "-m", "seed_bringup.commands.bag", "play", str(bag), "--loop"])
    try:
        assert wait_until(lambda: len(heard) == 4, node, 20.0)
    finally:
        player.send_signal(signal.SIGINT)
        player.wait(timeout=10.0)
    assert heard[3] - heard[0] > 2.5  # [s]; three rounds


def test_a_cell_in_a_namespace_is_recorded_by_its_own_clock(node: Node, tmp_path: Path) -> None:
    own, other = (node.create_publisher(Clock, f"{name}/clock", 1) for name in ("/left", ""))
    force = node.create_publisher(Float32, "/left/force", 10)
    action = ActionServer(node, FollowSetpoints, "/left/follow", lambda _: FollowSetpoints.Result())
    words = ["record", "--all", "--use-sim-time", "--namespace", "left", "-o", str(tmp_path / "bag.mcap")]
    recorder = subprocess.Popen(
        [sys.executable, "-P", "-m", "seed_bringup.commands.bag", *words], stderr=subprocess.PIPE, text=True
    )

    def recorded() -> bool:
        for publisher, t in ((own, 5), (other, 7)):
            message = Clock()
            message.clock.sec = t
            publisher.publish(message)
        force.publish(Float32())
        return force.get_subscription_count() > 0

    assert wait_until(recorded, node, 20.0)
    until = time.monotonic() + 1.0
    wait_until(lambda: recorded() and time.monotonic() > until, node, 20.0)
    recorder.send_signal(signal.SIGINT)
    assert "_action/feedback" not in recorder.communicate(timeout=20.0)[1]
    with AnyReader([tmp_path / "bag.mcap"]) as reader:
        stamps = {stamp for connection, stamp, _ in reader.messages() if connection.topic == "/left/force"}
    assert stamps == {5 * 10**9}
    action.destroy()


def test_messages_are_stamped_by_what_the_clock_showed_as_they_arrived(tmp_path: Path) -> None:
    """Two topics that tell the time of a clock, which runs at half speed."""
    context, over = Context(), threading.Event()
    rclpy.init(args=[], context=context)
    node = Node("cell", context=context)
    clock = node.create_publisher(Clock, "/clock", 10)
    force, torque = (node.create_publisher(Float32, topic, 10) for topic in ("/force", "/torque"))

    def talk() -> None:
        began = time.monotonic()
        for k in itertools.count():
            if over.is_set():
                return
            now = Clock()
            now.clock.sec, now.clock.nanosec = divmod(100 * 10**9 + k * 2_000_000, 10**9)
            clock.publish(now)
            if k % 5 == 0:
                force.publish(Float32(data=float(k)))
                torque.publish(Float32(data=float(k)))
            time.sleep(max(began + 0.004 * (k + 1) - time.monotonic(), 0.0))

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        record(tmp_path / "bag.mcap", ["/force", "/torque"], sim_time=True, duration=3.0)
    finally:
        over.set()
        thread.join()
        rclpy.try_shutdown(context=context)
    told: dict[str, list[tuple[float, float]]] = {"/force": [], "/torque": []}
    with AnyReader([tmp_path / "bag.mcap"]) as reader:
        for connection, stamp, data in reader.messages():
            published = 100.0 + 0.002 * reader.deserialize(data, connection.msgtype).data
            told[connection.topic].append((1e-9 * stamp, published))
    for rows in told.values():
        assert len(rows) > 100
        stamps, published = np.array(rows).T
        assert len(set(stamps)) == len(stamps)
        assert np.quantile(np.abs(stamps - published), 0.9) < 0.003  # [s]; by the looks it was up to 0.02 s
    order = sorted((stamp, topic, at) for topic, rows in told.items() for stamp, at in rows)
    assert np.mean([a[2] <= b[2] for a, b in pairwise(order)]) > 0.98  # what came first stands first


def test_feedback_of_an_action_is_told_to_be_that() -> None:
    name = "seed_msgs/action/FollowSetpoints_FeedbackMessage"
    for ask in (definition_file, message_class):
        with pytest.raises(BagError, match="FollowSetpoints_FeedbackMessage is the feedback of an action"):
            ask(name)


def test_a_bag_of_a_release_without_hashes_needs_no_definitions_to_be_played(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with BagWriter(tmp_path / "one.mcap") as writer:
        connection = writer.add_topic("/force", "std_msgs/msg/Float32")
    monkeypatch.delenv("AMENT_PREFIX_PATH")
    player = SimpleNamespace(create_publisher=lambda *given: given[:2])
    types = InstalledTypes()
    assert Player._publisher(player, connection._replace(digest=""), "/played", types) == (Float32, "/played")
    with pytest.raises(BagError, match="'std_msgs/msg/Float32' is not installed"):
        Player._publisher(player, connection, "/played", types)


def test_a_clock_is_told_between_its_messages_and_after_it_fell_silent() -> None:
    clock, late = SimClock(), 10 * SILENT
    assert clock.at(900, 1000) is None
    assert clock.at(900, late) == 0  # nothing was recorded before it
    for arrived, shown in ((1000, 50), (2000, 150), (3000, 20), (4000, 30)):
        clock.heard(arrived, shown)
    assert [clock.at(t, 5000) for t in (900, 1000, 1500, 2000, 2500, 3500)] == [0, 50, 100, 150, 150, 25]
    assert clock.at(4500, 5000) is None  # the next may still come
    assert clock.at(4500, late) == 30
    clock.forget(3500)
    assert clock.at(3600, 5000) == 26


def test_a_recorder_that_had_hardly_begun_does_not_hide_why_the_run_ended(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), recording(tmp_path / "bag.mcap", ["/chatter"]):
        raise KeyboardInterrupt


def test_a_recorder_completes_its_bag_when_who_started_it_is_killed(tmp_path: Path) -> None:
    bag = tmp_path / "bag.mcap"
    words = f"""
import os, time
from seed_bringup.bags.recording import recording
with recording({str(bag)!r}, ["/rosout"]) as said:
    while "recording /rosout" not in said():
        time.sleep(0.05)
    os.kill(os.getpid(), 9)
"""
    with subprocess.Popen([sys.executable, "-P", "-c", words]) as killed:
        assert killed.wait(timeout=30.0) == -9
    deadline = time.monotonic() + 20.0
    while not bag.is_file():  # it comes to its place when it is complete
        assert time.monotonic() < deadline, "the bag is still open"
        time.sleep(0.05)
    with AnyReader([bag]) as reader:
        assert [c.topic for c in reader.connections] == ["/rosout"]


def test_a_bag_that_was_cut_short_is_told_with_what_gets_it_back(tmp_path: Path) -> None:
    whole = bag_of(tmp_path / "whole.mcap", "/force")
    cut, folder = tmp_path / "cut.mcap", tmp_path / "folder"
    cut.write_bytes(whole.read_bytes()[:-40])
    folder.mkdir()
    (folder / "folder_0.mcap").write_bytes(cut.read_bytes())
    for path, file in ((cut, cut), (folder, folder / "folder_0.mcap")):
        with pytest.raises(BagError, match=re.escape(f"{path}: its recording was cut short: `mcap recover {file}")):
            describe_bag(path)
    (tmp_path / "text.mcap").write_text("none")
    with pytest.raises(BagError, match=r"text\.mcap: not a readable bag"):
        describe_bag(tmp_path / "text.mcap")
    assert "messages   1" in describe_bag(whole)


def test_a_bag_that_another_recorder_writes_or_left_behind_is_not_removed(tmp_path: Path) -> None:
    bag, left = tmp_path / "bag.mcap", tmp_path / ".bag-being-written"
    late = BagWriter(bag)  # made, and not yet open, when the other begins
    with BagWriter(bag) as writer:
        writer.write(writer.add_topic("/force", "std_msgs/msg/Float32"), 1, b"\x00\x01\x00\x00\x00\x00\x80?")
        told = f"{left} is left of it: .*`mcap recover {left}/bag/bag.mcap -o whole.mcap`.*remove that folder"
        with pytest.raises(BagError, match=told):
            BagWriter(bag)
        with pytest.raises(BagError, match=told):
            late.open()
    assert "messages   1" in describe_bag(bag)
    assert not left.exists()


def test_a_folder_that_is_no_bag_is_told_what_it_lacks(tmp_path: Path) -> None:
    for read in (describe_bag, lambda path: list(read_messages(path, bool))):
        with pytest.raises(
            BagError, match=f"^{re.escape(str(tmp_path))}: not a readable bag: this folder has no metadata"
        ):
            read(tmp_path)


def test_a_recording_of_which_nothing_came_is_a_mistake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seed_bringup.bags.record.PATIENCE", 0.5)
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # those of the tests stay
    with pytest.raises(BagError, match="bag is not written: no message has come"):
        record(tmp_path / "bag", ["/nobody/says/this"], duration=0.1)

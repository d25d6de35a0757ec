# SPDX-License-Identifier: Apache-2.0
"""Nodes that the launch files start listen on this computer only, and find each other there."""

import os
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from seed_bringup.launching.addresses import listening_as
from seed_bringup.launching.description import Description, describe
from seed_bringup.launching.launcher import Launch

pytest.importorskip("rclpy", reason="ROS 2 is not there (./seed test has it)")
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image

ROOT = Path(__file__).resolve().parents[2]
OLD, NEW = "FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"  # of Fast DDS up to Jazzy's, and of 3
RANGE, PROFILE = "ROS_AUTOMATIC_DISCOVERY_RANGE", OLD if os.environ.get("ROS_DISTRO", "jazzy") == "jazzy" else NEW
LAUNCHED = ROOT / "seed_bringup/launch/perception_launch.xml"
CAMERA = """\
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image
rclpy.init()
node = rclpy.create_node("camera")
images = node.create_publisher(Image, "image", qos_profile_sensor_data)
picture = Image(height={height}, width={width}, encoding="32FC1", step={width} * 4, data=bytes({height} * {width} * 4))
node.create_timer(0.1, lambda: images.publish(picture))
rclpy.spin(node)
"""


def described(monkeypatch: pytest.MonkeyPatch, file: Path, before: dict[str, str], **arguments: str) -> Description:
    """What the file starts for a caller with these variables; those of this process are left alone."""
    with monkeypatch.context() as caller:
        for name in (RANGE, OLD, NEW, "SEED_LOOPBACK"):
            caller.delenv(name, raising=False)
        for name, value in before.items():
            caller.setenv(name, value)
        return describe(file, arguments)


SEEDS = {RANGE: "LOCALHOST", PROFILE: "loopback.xml", "SEED_LOOPBACK": "true"}  # the environment of ./seed


@pytest.mark.parametrize(
    ("before", "arguments", "reach", "profile", "cameras"),
    [
        ({}, {}, "LOCALHOST", "loopback.xml", "loopback_images.xml"),
        (SEEDS, {}, "LOCALHOST", "loopback.xml", "loopback_images.xml"),
        ({}, {"network": "SUBNET"}, "SUBNET", None, "large_images.xml"),
        (SEEDS, {"network": "SUBNET"}, "SUBNET", None, "large_images.xml"),
        ({RANGE: "SUBNET"}, {}, "SUBNET", None, "large_images.xml"),
        ({RANGE: "SUBNET", PROFILE: "mine.xml"}, {}, "SUBNET", "mine.xml", "mine.xml"),
        ({PROFILE: "mine.xml"}, {}, "LOCALHOST", "mine.xml", "mine.xml"),
    ],
)
@pytest.mark.parametrize("file", ["cell", "demo", "perception"])
def test_nodes_are_bound_to_this_computer_unless_told_otherwise_and_that_is_said_once(
    monkeypatch: pytest.MonkeyPatch,
    file: str,
    before: dict[str, str],
    arguments: dict[str, str],
    reach: str,
    profile: str | None,
    cameras: str,
) -> None:
    found = described(monkeypatch, ROOT / f"seed_bringup/launch/{file}_launch.xml", before, **arguments)
    assert found.nodes
    for node in found.nodes:
        given = node.environment.get(PROFILE)
        assert node.environment[RANGE] == reach
        assert (given and Path(given).name) == (cameras if node.name == "bubbles" else profile)
        assert given in (None, "mine.xml") or Path(given).is_file()
    assert len(found.messages) == (reach == "SUBNET")
    assert all("listen beyond this computer" in message for message in found.messages)


@pytest.mark.parametrize(("distribution", "variable"), [("jazzy", OLD), ("kilted", NEW), ("lyrical", NEW)])
def test_the_profile_goes_by_the_name_that_the_fast_dds_of_each_distribution_reads(
    monkeypatch: pytest.MonkeyPatch, distribution: str, variable: str
) -> None:
    file = ROOT / "seed_bringup/launch/cell_launch.xml"
    for own, estimator, cameras in (
        ({}, "loopback.xml", "loopback_images.xml"),
        ({variable: "mine.xml"}, "mine.xml", "mine.xml"),
    ):
        nodes = {n.name: n for n in described(monkeypatch, file, {"ROS_DISTRO": distribution} | own).nodes}
        for name, profile in (("estimator", estimator), ("bubbles", cameras)):
            assert Path(nodes[name].environment[variable]).name == profile
            assert ({OLD, NEW} - {variable}).isdisjoint(nodes[name].environment)
    monkeypatch.setenv("ROS_DISTRO", distribution)
    assert list(listening_as("hosts.xml")) == [variable]  # of what is started without a launch file


def test_of_two_computers_each_starts_its_part_and_is_bound_to_its_address(monkeypatch: pytest.MonkeyPatch) -> None:
    given, before = {"address": "192.168.9.1", "peers": "192.168.9.2"}, SEEDS | {"ROS_LOCALHOST_ONLY": "1"}
    camera, robot = (
        described(monkeypatch, ROOT / f"seed_bringup/launch/{which}_host_launch.xml", before, **given)
        for which in ("camera", "robot")
    )
    assert [n.name for n in camera.nodes] == ["estimator"]
    assert {"estimator", "bubbles"}.isdisjoint(n.name for n in robot.nodes)
    assert "controller" in {n.name for n in robot.nodes}
    for found in (camera, robot):
        assert len(found.messages) == 1
        assert "at 192.168.9.1, and look for 192.168.9.2" in found.messages[0]
        for node in found.nodes:
            assert Path(node.environment[PROFILE]).name == "hosts.xml"
            assert node.environment[RANGE] == "LOCALHOST"
            assert node.environment["ROS_STATIC_PEERS"] == "192.168.9.2"
            assert node.environment["SEED_ADDRESS"] == "192.168.9.1"
            assert "ROS_LOCALHOST_ONLY" not in node.environment  # with it the peers do not count


@pytest.mark.skipif(
    os.environ.get("RMW_IMPLEMENTATION") not in (None, "rmw_fastrtps_cpp"), reason="profiles are Fast DDS's"
)
@pytest.mark.parametrize(
    ("profile", "everywhere", "width", "height"),
    [(None, False, 160, 120), ("large_images.xml", True, 640, 480)],  # loopback.xml has no room for large images
)
def test_a_launched_camera_is_heard_from_this_computer_and_listens_nowhere_else(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, profile: str | None, everywhere: bool, width: int, height: int
) -> None:
    """A profile of one's own without the restriction is the counter-proof: there the ports are open everywhere."""
    program = tmp_path / "camera"
    program.write_text(f"#!{sys.executable}\n{CAMERA.format(width=width, height=height)}")
    program.chmod(0o755)
    monkeypatch.setattr("seed_bringup.launching.description.executable", lambda *_: program)
    own = {} if profile is None else {PROFILE: str(ROOT / "seed_bringup/config" / profile)}
    with ExitStack() as stack:
        for _ in range(8):  # as many processes have the first ports
            idle = Context()
            rclpy.init(args=[], context=idle)
            Node("idle", context=idle)
            stack.callback(rclpy.shutdown, context=idle)
        context = Context()
        rclpy.init(args=[], context=context)
        stack.callback(rclpy.shutdown, context=context)
        node, sizes = Node("listener", context=context), []
        node.create_subscription(Image, "image", lambda m: sizes.append(len(m.data)), qos_profile_sensor_data)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        launch = Launch(LAUNCHED)
        launch.description = described(monkeypatch, LAUNCHED, own)
        stack.enter_context(launch)
        deadline = time.monotonic() + 20.0
        while len(sizes) < 3 and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.1)
        addresses = {address for n in launch.nodes for address in listening(n.process.pid)}
    assert sizes[:3] == [width * height * 4] * 3
    assert addresses
    assert ("0.0.0.0" in addresses) == everywhere
    assert everywhere or all(address.startswith("127.") for address in addresses)


def listening(process: int) -> set[str]:
    """IPv4 addresses of a process's sockets on ports of its middleware's choice; on the kernel's it only sends."""
    ephemeral = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    links = [os.readlink(f) for f in Path(f"/proc/{process}/fd").iterdir()]
    own = {link[len("socket:[") : -1] for link in links if link.startswith("socket:[")}
    found = set()
    for line in Path(f"/proc/{process}/net/udp").read_text().splitlines()[1:]:
        words = line.split()
        address, port = words[1].split(":")
        if words[9] in own and int(port, 16) < ephemeral:
            found.add(".".join(str(byte) for byte in bytes.fromhex(address)[::-1]))
    return found

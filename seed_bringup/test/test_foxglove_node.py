# SPDX-License-Identifier: Apache-2.0
"""The bridge to Foxglove, spoken to as the app does: over a WebSocket, in the protocol of the SDK."""

import json
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not there (./seed test has it)")
pytest.importorskip("foxglove", reason="needs foxglove-sdk")

from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from seed_msgs.msg import ControllerState, RelativePose, WrenchEstimate
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from websockets.sync.client import ClientConnection, connect

from seed_bringup.foxglove.offered import BUTTONS, HOST, STILL, TOPICS, offered_as
from seed_bringup.foxglove.ros.bridge import Bridge
from seed_bringup.foxglove.schemas import read_play
from seed_core.errors import FailedError
from seed_core.program.files import shared_path
from seed_ros import COMMAND, LATCHED, SENSOR
from seed_ros.testing import Bench

KINDS = {  # of the topics that the layout plots
    "/wrench_estimate": WrenchEstimate,
    "/controller/state": ControllerState,
    "/relative_pose": RelativePose,
    "/sim/ground_truth/contact_wrench": WrenchStamped,
}
PROTOCOL = "foxglove.sdk.v1"
MESSAGE, SERVICE_CALL, SERVICE_ANSWER = 1, 2, 3  # operation codes of binary frames


class App:
    """What the app does: hears of topics and services, subscribes, calls."""

    def __init__(self, port: int) -> None:
        self.socket: ClientConnection = connect(f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL])  # type: ignore[list-item]
        self.channels: dict[str, dict[str, Any]] = {}
        self.services: dict[str, dict[str, Any]] = {}
        self.messages: list[bytes] = []
        self.answers: dict[int, bytes] = {}
        self.calls = 0

    def hear(self) -> None:
        """Everything that has come."""
        while True:
            try:
                frame = self.socket.recv(timeout=0.0)
            except TimeoutError:
                return
            if isinstance(frame, str):
                told = json.loads(frame)
                if told["op"] == "advertise":
                    self.channels |= {c["topic"]: c for c in told["channels"]}
                elif told["op"] == "advertiseServices":
                    self.services |= {s["name"]: s for s in told["services"]}
            elif frame[0] == MESSAGE:
                self.messages.append(frame[1 + 4 + 8 :])  # code, subscription, time
            elif frame[0] == SERVICE_ANSWER:
                _, call, length = struct.unpack_from("<III", frame, 1)
                self.answers[call] = frame[13 + length :]

    def subscribe(self, topic: str) -> None:
        subscription = {"id": 7, "channelId": self.channels[topic]["id"]}
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": [subscription]}))

    def call(self, service: str, payload: bytes = b"") -> int:
        self.calls += 1
        head = struct.pack("<BIII", SERVICE_CALL, self.services[service]["id"], self.calls, 3)
        self.socket.send(head + b"cdr" + payload)
        return self.calls

    def answer(self, call: int) -> Trigger.Response:
        return deserialize_message(self.answers[call], Trigger.Response)


class Cell:
    """A bench with a bridge on it, and the app before it."""

    def __init__(self, buttons: bool) -> None:
        self.bench = Bench()
        self.poses = self.bench.client.create_publisher(RelativePose, "relative_pose", COMMAND)
        self.why = self.bench.client.create_publisher(String, "sim/hold_reason", LATCHED)
        self.bench.client.create_publisher(String, "secret", COMMAND)
        self.pressed: list[str] = []
        for name, kind in (("controller/enable", SetBool), ("estimator/capture_reference", Trigger)):
            self.bench.client.create_service(kind, name, lambda q, a, n=name: self._on_call(n, q, a))
        self.bridge = Bridge("127.0.0.1", 0, buttons=buttons, context=self.bench.context)
        self.bench.every.append(self.bridge.loop.once)
        self.app = App(self.bridge.port)
        self.bench.every.append(self.app.hear)

    def _on_call(self, name: str, request: Any, answer: Any) -> Any:
        self.pressed.append(f"{name} {getattr(request, 'data', '')}".strip())
        answer.success, answer.message = True, f"{name} was asked"
        return answer

    def until(self, condition: Any) -> None:
        assert self.bench.until(condition)

    def close(self) -> None:
        self.app.socket.close()
        self.bridge.close()
        self.bench.close()


@pytest.fixture
def cell(request: pytest.FixtureRequest) -> Iterator[Cell]:
    made = Cell(buttons=getattr(request, "param", True))
    yield made
    made.close()


def test_a_message_comes_as_it_is_with_its_definition_and_only_while_somebody_looks(cell: Cell) -> None:
    cell.until(lambda: "/relative_pose" in cell.app.channels)
    assert "/secret" not in cell.app.channels
    channel = cell.app.channels["/relative_pose"]
    assert (channel["encoding"], channel["schemaName"]) == ("cdr", "seed_msgs/msg/RelativePose")
    assert "geometry_msgs/PoseWithCovariance pose" in channel["schema"]
    assert "MSG: geometry_msgs/Quaternion" in channel["schema"]  # with all that it contains
    assert cell.bench.client.count_subscribers("relative_pose") == 0
    cell.app.subscribe("/relative_pose")
    cell.until(lambda: cell.bench.client.count_subscribers("relative_pose") == 1)
    sent = RelativePose(valid=True, method="rigid_fit")
    sent.pose.pose.position.z = 0.0125  # [m]

    def arrived() -> bool:
        cell.poses.publish(sent)
        return bool(cell.app.messages)

    cell.until(arrived)
    assert deserialize_message(cell.app.messages[0], RelativePose) == sent
    cell.app.socket.close()
    cell.bench.every.remove(cell.app.hear)
    cell.until(lambda: cell.bench.client.count_subscribers("relative_pose") == 0)


def test_a_newcomer_is_told_what_is_latched(cell: Cell) -> None:
    cell.why.publish(String(data="nobody sends a target"))
    cell.until(lambda: "/sim/hold_reason" in cell.app.channels)
    for app in (cell.app, App(cell.bridge.port)):
        if app is not cell.app:
            cell.bench.every.append(app.hear)
            cell.until(lambda app=app: "/sim/hold_reason" in app.channels)
        app.subscribe("/sim/hold_reason")
        cell.until(lambda app=app: app.messages)
        assert deserialize_message(app.messages[-1], String).data == "nobody sends a target"
    app.socket.close()


@pytest.mark.parametrize("quality", [COMMAND, SENSOR, LATCHED])
def test_a_panel_that_is_opened_while_the_cell_is_down_is_fed_when_it_is_back(cell: Cell, quality: QoSProfile) -> None:
    cell.until(lambda: "/relative_pose" in cell.app.channels)
    cell.bench.client.destroy_publisher(cell.poses)
    cell.until(lambda: not cell.bridge.node.get_publishers_info_by_topic("/relative_pose"))
    cell.app.subscribe("/relative_pose")
    cell.bench.spin(0.2)
    for again in (quality, COMMAND):  # and another one, as of a driver that was changed
        publisher = cell.bench.client.create_publisher(RelativePose, "relative_pose", again)
        cell.app.messages.clear()

        def arrived(publisher: Any = publisher) -> bool:
            publisher.publish(RelativePose())
            return bool(cell.app.messages)

        cell.until(arrived)
        cell.bench.client.destroy_publisher(publisher)


def test_buttons_reach_the_cell_and_its_answer_comes_back(cell: Cell) -> None:
    cell.until(lambda: set(cell.app.services) == {*STILL, *BUTTONS} and cell.bridge.hands._enable.service_is_ready())
    cell.until(lambda: cell.bridge.hands._triggers["estimator/capture_reference"].service_is_ready())
    call = cell.app.call("Reference")
    cell.until(lambda: call in cell.app.answers)
    assert (cell.app.answer(call).success, cell.pressed) == (True, ["estimator/capture_reference"])
    assert "was asked" in cell.app.answer(call).message
    call = cell.app.call("Stop")
    cell.until(lambda: call in cell.app.answers)
    assert cell.app.answer(call).success
    assert cell.pressed[-1] == "controller/enable False"
    call = cell.app.call("Cancel")
    cell.until(lambda: call in cell.app.answers)
    assert not cell.app.answer(call).success
    assert "does the cell run?" in cell.app.answer(call).message


def test_a_task_that_is_none_is_refused_with_its_reason(cell: Cell) -> None:
    cell.until(lambda: "Play" in cell.app.services)
    words = b"whipe\0"
    task = b"\x00\x01\x00\x00" + struct.pack("<I", len(words)) + words
    payload = task + b"\0" * (-(len(task) - 4) % 8) + struct.pack("<d", 5.0)
    assert read_play(payload) == ("whipe", 5.0)
    for given, says in ((payload, "whipe"), (b"\x00\x01", "no request of Play")):
        call = cell.app.call("Play", given)
        cell.until(lambda call=call: call in cell.app.answers)
        assert not cell.app.answer(call).success
        assert says in cell.app.answer(call).message


@pytest.mark.parametrize("cell", [False], indirect=True)
def test_without_buttons_only_what_brings_the_arm_to_rest_is_offered(cell: Cell) -> None:
    cell.until(lambda: cell.app.services)
    assert set(cell.app.services) == {"Stop", "Cancel"}


def test_a_port_that_is_taken_is_told(cell: Cell) -> None:
    with pytest.raises(FailedError, match="name another with --port"):
        Bridge("127.0.0.1", cell.bridge.port, context=cell.bench.context)


def test_it_listens_on_loopback_by_default(cell: Cell) -> None:
    assert HOST == "127.0.0.1"
    listening = [line.split()[1] for line in Path("/proc/net/tcp").read_text().splitlines() if line.split()[3] == "0A"]
    assert [where for where in listening if int(where[9:], 16) == cell.bridge.port] == [
        f"0100007F:{cell.bridge.port:04X}"
    ]


def test_ctrl_c_ends_the_command_as_it_ends_the_others() -> None:
    command = [
        sys.executable,
        "-P",
        "-m",
        "seed_bringup.commands.dispatch",
        "foxglove",
        "--port",
        "0",
        "--domain",
        "231",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as bridge:
        assert bridge.stdout is not None
        assert any("ws://127.0.0.1" in line for line in bridge.stdout)
        time.sleep(2.0)  # it forwards
        bridge.send_signal(signal.SIGINT)
        _, told = bridge.communicate(timeout=20.0)
    assert (bridge.returncode, told) == (130, "seed foxglove: interrupted\n")


def test_the_command_s_own_check_and_no_handler_of_rclpy_answers_ctrl_c() -> None:
    """In a process of its own: handlers that another context installed stay."""
    script = """
from rclpy.signals import get_current_signal_handlers_options
from seed_bringup.foxglove.ros.bridge import serve
def check():
    raise SystemExit(get_current_signal_handlers_options().name)
serve("127.0.0.1", 0, "/", buttons=False, check=check)
"""
    process = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60.0, check=False)
    assert process.stderr.splitlines()[-1] == "NO"


def _topics(value: Any) -> Iterator[str]:
    """Topics that a layout names, anywhere in it."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key == "topics":
                yield from inner
            elif key in ("imageTopic", "topicPath", "topicToRender", "value") and isinstance(inner, str):
                yield inner.split(".")[0]
            else:
                yield from _topics(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _topics(inner)


def test_the_shipped_layout_names_offered_topics_and_fields_that_exist() -> None:
    layout = json.loads((shared_path("seed_bringup", "layouts") / "cell.json").read_text())
    named = set(_topics(layout))
    assert len(named) >= 8
    assert {topic for topic in named if offered_as(topic) is None} == set()
    panels: set[str] = set()

    def walk(node: Any) -> None:
        if isinstance(node, str):
            panels.add(node)
        else:
            walk(node["first"])
            walk(node["second"])

    walk(layout["layout"])
    assert panels == set(layout["configById"])
    plotted = {p["value"] for c in layout["configById"].values() for p in c.get("paths", ())}
    assert len(plotted) >= 6
    for path in plotted:
        topic, *fields = path.split(".")
        value = KINDS[topic]()
        for name in fields:
            value = getattr(value, name)
        assert isinstance(value, float), path


def test_a_cell_in_a_namespace_is_seen_as_one_without() -> None:
    assert offered_as("/left/relative_pose", "/left") == "/relative_pose"
    assert offered_as("/left/tf", "/left") == "/tf"
    assert offered_as("/right/relative_pose", "/left") is None
    assert offered_as("/diagnostics", "/left") == "/diagnostics"
    assert offered_as("/controller/set_parameters") is None
    assert all(offered_as(f"/{topic}") == f"/{topic}" for topic in TOPICS)

# SPDX-License-Identifier: Apache-2.0
"""The base of the nodes: services answer in words, refusals are counted, and a node ends quietly."""

import signal
import subprocess
import sys
import time
from errno import ENOSPC
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from seed_msgs.action import FollowSetpoints
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from seed_core.errors import SeedError
from seed_ros import QUEUE, Diagnostics, FixedRateLoop, SeedNode, diagnostics
from seed_ros.arm import arm_holds
from seed_ros.testing import Bench

pytestmark = pytest.mark.ros

NODE = """
import sys
from std_msgs.msg import String
from seed_ros import FixedRateLoop, SeedNode

class Interrupted(SeedNode):
    def __init__(self):
        super().__init__("interrupted")
        self.refuse_unknown()
        self.streams = [self.create_publisher(String, f"stream_{i}", 10) for i in range(30)]
        self.loop = FixedRateLoop(self, 100.0, lambda: print("spinning", flush=True))

sys.exit(Interrupted.main())
"""


class Answering(SeedNode):
    """One of everything that the base offers."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("answering", **arguments)
        self.loop = FixedRateLoop(self, 200.0, lambda: None)
        self.listen(String, "words", self._on_words, QUEUE, refused="words_refused")
        self.serve(SetBool, "~/set", self._set)
        self.serve(Trigger, "~/save", self._save)
        self.later = Future()
        self.serve(Trigger, "~/wait", self._wait, group=ReentrantCallbackGroup())
        self.diagnose("words", lambda: (diagnostics.OK, "fine", self.counters.values()))

    def _on_words(self, message: String) -> None:
        raise SeedError(f"'{message.data}' is refused")

    def _set(self, on: bool) -> str:
        if not on:
            raise SeedError("it stays on")
        return "on"

    def _save(self) -> str:
        raise OSError(ENOSPC, "No space left on device", "replay.html")

    async def _wait(self) -> str:
        return str(await self.later)


def test_a_service_answers_with_what_its_method_returns_or_with_the_words_of_its_refusal(bench: Bench) -> None:
    bench.add(Answering)
    answer = bench.call(SetBool, "answering/set", SetBool.Request(data=True))
    assert (answer.success, answer.message) == (True, "on")
    answer = bench.call(SetBool, "answering/set", SetBool.Request(data=False))
    assert (answer.success, answer.message) == (False, "it stays on")


def test_a_service_that_cannot_write_its_file_answers_with_what_is_in_the_way(bench: Bench) -> None:
    bench.add(Answering)
    answer = bench.call(Trigger, "answering/save", Trigger.Request())
    assert (answer.success, answer.message) == (False, "replay.html: No space left on device")


@pytest.mark.parametrize("sim_time", [False, True])
def test_a_running_node_keeps_its_clock(bench: Bench, sim_time: bool) -> None:
    node = bench.add(Answering, use_sim_time=sim_time)
    (other,) = node.set_parameters([Parameter("use_sim_time", value=not sim_time)])
    assert not other.successful
    assert "use_sim_time cannot be changed while the node runs" in other.reason
    assert node.get_parameter("use_sim_time").value is sim_time
    assert node.set_parameters([Parameter("use_sim_time", value=sim_time)])[0].successful


def test_a_service_that_waits_lets_others_be_served(bench: Bench) -> None:
    node = bench.add(Answering)
    client = bench.client.create_client(Trigger, "answering/wait")
    assert bench.until(client.service_is_ready)
    waiting = client.call_async(Trigger.Request())
    bench.spin(0.2)
    assert bench.call(SetBool, "answering/set", SetBool.Request(data=True)).success
    assert not waiting.done()
    node.later.set_result("now")
    assert bench.until(waiting.done)
    assert waiting.result().message == "now"


def test_refused_messages_are_counted_with_their_words_and_told_in_the_diagnostics(bench: Bench) -> None:
    node = bench.add(Answering)
    publisher = bench.client.create_publisher(String, "words", QUEUE)
    told: list[DiagnosticArray] = []
    bench.client.create_subscription(DiagnosticArray, "/diagnostics", told.append, 10)
    assert bench.until(lambda: publisher.get_subscription_count() == 1)
    for word in ("one", "two"):
        publisher.publish(String(data=word))
    assert bench.until(lambda: node.counters["words_refused"] == 2)
    assert node.counters.last == "'two' is refused"
    told.clear()
    assert bench.until(lambda: told)
    (status,) = told[-1].status
    assert (status.name, status.hardware_id, status.message) == ("/answering", "words", "fine")
    values = {v.key: v.value for v in status.values}
    assert list(values)[:4] == ["rate_hz", "latency_ms", "lost", "reason"]
    assert (values["lost"], values["reason"], values["words_refused"]) == ("2", "", "2")


def test_the_diagnostics_tell_rate_age_and_reason_of_every_node_alike(bench: Bench) -> None:
    node = bench.add(Answering)
    told: list[DiagnosticArray] = []
    bench.client.create_subscription(DiagnosticArray, "/diagnostics", told.append, 10)
    report = (diagnostics.WARN, "no words come", {"lost": 3, "own": 1})
    Diagnostics(node, "words", lambda: report, node.beats, node.counters, name="other")
    assert bench.until(lambda: any(a.status[0].name == "other" for a in told))
    told.clear()
    for _ in range(40):
        node.beats.add(0.02)
        node.beats.add(0.04)
    began = time.monotonic()
    assert bench.until(lambda: told)
    first = {v.key: v.value for v in told[0].status[0].values}
    assert float(first["rate_hz"]) == pytest.approx(80.0 / 1.0, rel=0.5)
    assert time.monotonic() - began < 5.0
    assert float(first["latency_ms"]) == pytest.approx(30.0)
    assert bench.until(lambda: any(a.status[0].name == "other" for a in told))
    other = next(a.status[0] for a in told if a.status[0].name == "other")
    values = {v.key: v.value for v in other.values}
    assert (values["lost"], values["reason"], values["own"]) == ("3", "no words come", "1")


def test_causes_with_numbers_in_them_do_not_fill_the_memory(bench: Bench) -> None:
    node = bench.add(Answering)
    for i in range(500):
        node.counters.add(f"{i} mm too far", "words")
    assert node.counters.total() == 500
    assert len(node.counters.values()) <= 61
    assert node.counters["others"] == 440


def test_the_total_counts_every_cause_once_per_event(bench: Bench) -> None:
    node = bench.add(Answering)
    for i in range(5):
        node.counters.add(f"{i % 2} m off", "off")
    assert node.counters.total() == 5 == sum(node.counters.values().values())


def test_the_same_words_are_logged_ever_more_seldom_and_others_at_once() -> None:
    at, said = [0.0], list[tuple[float, str]]()
    clock = SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=round(1e9 * at[0])))
    logger = SimpleNamespace(warning=lambda words: said.append((at[0], words)))
    counters = diagnostics.Counters(SimpleNamespace(get_clock=lambda: clock, get_logger=lambda: logger))
    for second in range(100):
        at[0] = float(second)
        counters.add("pose", "no grasp" if second < 80 else f"{second} mm off")
    assert [t for t, words in said if words == "no grasp"] == [0.0, 5.0, 15.0, 35.0, 75.0]
    assert [t for t, words in said if words != "no grasp"] == [80.0, 85.0, 90.0, 95.0]
    assert counters["pose"] == 100


def test_a_node_interrupted_again_while_it_ends_ends_without_a_trace() -> None:
    process = subprocess.Popen([sys.executable, "-c", NODE], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "spinning\n"
    for _ in range(40):  # `ros2 launch` sends one of its own after the terminal's
        process.send_signal(signal.SIGINT)
        time.sleep(0.005)
    _, errors = process.communicate(timeout=10.0)
    assert (process.returncode, errors) == (0, "")


def test_a_node_whose_context_rclpy_ends_in_the_same_moment_ends_without_a_trace() -> None:
    """rclpy ends it by a thread of its own after Ctrl-C, also between the look whether it runs and the shutdown."""
    late = (
        "import rclpy.context\n"
        "rclpy.context.Context.try_shutdown = lambda c: [c._Context__context.shutdown() for _ in range(2)]\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", late + NODE], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "spinning\n"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=10.0)
    assert (process.returncode, errors) == (0, "")


HALF_MADE = """
import sys
import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node
from seed_msgs.action import FollowSetpoints
from seed_ros.node import run

def create():
    node = Node("half_made")
    {ends}
    {makes}

sys.exit(run(create))
"""


@pytest.mark.parametrize("makes", ["ActionClient(node, FollowSetpoints, 'action')", "Node('second')"])
def test_a_node_whose_context_is_ended_while_it_is_made_ends_without_a_trace(makes: str) -> None:
    """As rclpy's thread does after Ctrl-C, before Python hears of it."""
    program = HALF_MADE.format(ends="rclpy.shutdown()", makes=makes)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=30.0)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_mistake_while_a_node_is_made_is_told_with_its_trace() -> None:
    program = HALF_MADE.format(ends="", makes="int('no number')")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=30.0)
    assert done.returncode == 1
    assert "ValueError: invalid literal" in done.stderr


def test_a_parameter_file_that_cannot_be_read_is_named_without_a_trace(tmp_path: Path) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text("/**:\n  ros__parameters:\n    max_speed: [1\n")
    command = [sys.executable, "-c", NODE, "--ros-args", "--params-file", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30.0)
    assert done.returncode == 1
    (line,) = (line for line in done.stderr.splitlines() if not line.startswith("[ERROR]"))  # rcl has its own
    assert line.startswith("error: ")
    assert str(file) in line


def test_a_parameter_of_a_wrong_type_is_named_without_a_trace() -> None:
    command = [sys.executable, "-c", NODE, "--ros-args", "-p", "parameter_files:=foo.yaml"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30.0)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert "'parameter_files' to 'foo.yaml' of type 'STRING', expecting type 'STRING_ARRAY'" in line


def test_an_action_is_gone_with_its_node_though_somebody_still_holds_it(bench: Bench) -> None:
    """A controller that has ended would go on to be offered, until the collector comes by."""
    node = bench.add(Answering)
    server = node.serve_action(FollowSetpoints, "~/follow", lambda _: Future())
    client = ActionClient(bench.client, FollowSetpoints, "answering/follow")
    assert bench.until(client.server_is_ready)
    bench._loops.clear()
    node.destroy_node()
    assert bench.until(lambda: not client.server_is_ready(), 5.0)
    client.destroy()
    del server


@pytest.mark.parametrize(
    ("topic", "reason", "told"),
    [
        ("/driver/hold_reason", "", ""),
        ("/arm_hold_reason", "stopped", "the arm holds: stopped"),
        (
            "/driver/hold_reason",
            "stopped",
            "the arm holds: stopped; mend that, then call driver/resend_robot_program",
        ),
        (
            "/driver/hold_reason",
            "no target_frame for 0.1 s",
            "the arm holds: no target_frame for 0.1 s (this computer is too busy, or the controller has ended); "
            "mend that, then call driver/resend_robot_program",
        ),
        (
            "/sim/hold_reason",
            "no target_frame for 1 s (this computer is busy)",
            "the arm holds: no target_frame for 1 s (this computer is busy); "
            "mend that, then call sim/resend_robot_program",
        ),
        (
            "/left/guard/hold_reason",
            "waiting for resend_robot_program",
            "the arm holds: waiting for resend_robot_program; call left/guard/resend_robot_program",
        ),
    ],
)
def test_an_arm_that_holds_is_told_with_what_resumes_it(topic: str, reason: str, told: str) -> None:
    node = SimpleNamespace(resolve_topic_name=lambda _: topic)
    assert arm_holds(node, reason) == told  # type: ignore[arg-type]


@pytest.mark.parametrize("reliability", [ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE])
def test_a_publisher_that_cannot_be_heard_is_told_of_once(reliability: ReliabilityPolicy) -> None:
    bench = Bench()
    try:
        node = bench.add(Answering)
        qos = QoSProfile(depth=1, reliability=reliability, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        words = bench.client.create_publisher(String, "words", qos)
        assert bench.until(lambda: node.get_publishers_info_by_topic("words"))
        told = lambda: node.counters["qos_incompatible"]  # noqa: E731
        assert bench.until(told, patience=3.0) == (reliability == ReliabilityPolicy.BEST_EFFORT)
        bench.spin(1.5)
        if told():
            assert told() == 1
            assert node.counters.last.startswith("/words: nothing that /client publishes comes here")
            assert "Best effort publisher and reliable subscription" in node.counters.last
        bench.client.destroy_publisher(words)
    finally:
        bench.close()

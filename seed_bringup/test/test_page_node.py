# SPDX-License-Identifier: Apache-2.0
"""The buttons of the operator page against nodes that answer, refuse or are silent; and the page of a bag."""

import contextlib
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("viser", reason="needs viser (./seed test has it)")

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionServer
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from seed_msgs.action import FollowSetpoints
from seed_msgs.msg import ControllerState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker

from seed_bringup.access.policy import read_policy
from seed_bringup.bags import BagError, qos
from seed_bringup.bags.files import BagWriter, open_bag
from seed_bringup.commands import view
from seed_bringup.page.ros.hands import ACTION, CellHands
from seed_bringup.page.ros.node import PageNode
from seed_bringup.page.ros.playback import Player, Recording, served
from seed_bringup.page.ros.read import TableShape, read_state
from seed_bringup.page.state import History
from seed_bringup.page.words import headline
from seed_control.tasks import load_task, read_task, shipped_tasks
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import make_pose
from seed_ros import COMMAND, LATCHED, QUEUE
from seed_ros.conversions import estimate_to_message, pose_stamped, stamped
from seed_ros.testing import Bench
from seed_sim.plant.table import draw_surface
from seed_sim.ros.table_marker import table_marker
from seed_sim.scenario import load_scenario

pytestmark = pytest.mark.ros


class SlowCell(Node):
    """Offers what the buttons call; a reference takes until it is let go, and an arm as long as it is told to."""

    def __init__(self, context: Context, namespace: str | None = None) -> None:
        super().__init__("slow_cell", context=context, namespace=namespace)
        self.enabled, self.called = False, []
        self.go_on, self.arm_is_there, self.enable_in_time = threading.Event(), threading.Event(), threading.Event()
        self.arm_is_there.set()
        self.enable_in_time.set()
        group = ReentrantCallbackGroup()
        self.create_service(Trigger, "estimator/capture_reference", self._reference, callback_group=group)
        self.create_service(Trigger, "sim/resend_robot_program", self._resume, callback_group=group)
        self.create_service(SetBool, "controller/enable", self._enable, callback_group=MutuallyExclusiveCallbackGroup())

    def _reference(self, _: Any, response: Any) -> Any:
        self.called.append("reference")
        self.go_on.wait(10.0)
        response.success, response.message = False, "the left bubble touches something: open the gripper"
        return response

    def _resume(self, _: Any, response: Any) -> Any:
        self.called.append("resume")
        self.arm_is_there.wait(10.0)
        self.called.append("resumed")
        response.success, response.message = True, "following target_frame"
        return response

    def offer_stop(self, good: bool) -> None:
        """Be a cell with an arm's driver, which can be stopped, or else refuses."""

        def stop(_: Any, response: Any) -> Any:
            self.called.append("stop")
            response.success, response.message = good, "" if good else "the arm's program does not answer"
            return response

        self.create_service(Trigger, "driver/stop", stop, callback_group=ReentrantCallbackGroup())

    def _enable(self, request: Any, response: Any) -> Any:
        if request.data:
            self.called.append("enabling")
            self.enable_in_time.wait(10.0)
        self.enabled = request.data
        self.called.append("on" if request.data else "off")
        response.success, response.message = True, "enabled" if request.data else "disabled"
        return response


@pytest.fixture
def context() -> Iterator[Context]:
    context = Context()
    rclpy.init(args=[], context=context)
    yield context
    rclpy.try_shutdown(context=context)


@pytest.fixture
def cell(request: pytest.FixtureRequest, context: Context) -> Iterator[SlowCell]:
    """In the namespace that the test asks for."""
    node, executor = SlowCell(context, getattr(request, "param", None)), MultiThreadedExecutor(4, context=context)
    executor.add_node(node)

    def spin() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            return

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    yield node
    for event in (node.go_on, node.arm_is_there, node.enable_in_time):
        event.set()
    executor.shutdown(timeout_sec=2.0)
    thread.join(2.0)
    node.destroy_node()


@pytest.fixture
def hands(request: pytest.FixtureRequest, context: Context) -> Iterator[CellHands]:
    """In the namespace that the test asks for: nodes of the tests before may still be announced in that of all."""
    hands = CellHands(context, ("squeegee",), getattr(request, "param", ""))
    yield hands
    hands.close()


def test_the_task_that_a_simulated_cell_was_launched_with_is_known(hands: CellHands, context: Context) -> None:
    sim, executor = Node("sim", context=context), SingleThreadedExecutor(context=context)
    sim.declare_parameter("task", "write")
    executor.add_node(sim)
    until(lambda: executor.spin_once(timeout_sec=0.1) or hands.begun == "write")
    sim.destroy_node()


def until(condition: Any, patience: float = 10.0) -> None:
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def words(hands: CellHands) -> str:
    return " | ".join(text for _, text in hands.said)


def ready(hands: CellHands) -> None:
    clients = (hands._enable, hands._triggers["estimator/capture_reference"], hands._triggers[RESUME])
    until(lambda: all(c.service_is_ready() for c in clients))


DOES = ("publish", "request", "call")
RESUME = "sim/resend_robot_program"


def test_a_stop_counts_that_is_pressed_before_the_enable_is_taken_up(cell: SlowCell, hands: CellHands) -> None:
    ready(hands)
    hands._executor.create_task(time.sleep, 0.3)  # the thread of the buttons is busy
    enabling = hands.press("Enable")
    hands.stop()
    good, told = enabling.result(10.0)
    assert not good
    assert "Stop counts" in told
    assert not cell.enabled
    assert "enabling" not in cell.called


@pytest.mark.parametrize("cell", ["/left"], indirect=True)
def test_the_buttons_reach_the_cell_of_their_namespace_and_no_other(
    cell: SlowCell, context: Context, hands: CellHands
) -> None:
    cell.offer_stop(good=True)
    of_left = CellHands(context, ("squeegee",), "/left", "hands_of_left")
    try:
        ready(of_left)
        until(of_left._triggers["driver/stop"].service_is_ready)
        assert of_left.press("Enable").result(10.0) == (True, "Enable: enabled.")
        assert cell.called == ["resume", "resumed", "enabling", "on"]
        good, told = hands.stop().result(10.0)
        assert not good
        assert "no cell answers" in told
        assert cell.enabled
        good, told = of_left.stop().result(10.0)
        assert good, told
        assert not cell.enabled
    finally:
        of_left.close()


@pytest.mark.parametrize(
    ("opens", "answer", "how"),
    [
        (True, "released", "the gripper is open again"),
        (False, "the tool is loaded: lift it first", "the gripper stays closed: the tool is loaded: lift it first"),
    ],
)
def test_a_grasp_that_the_estimator_refuses_leaves_the_gripper_open_or_tells_why_not(
    cell: SlowCell, hands: CellHands, opens: bool, answer: str, how: str
) -> None:
    """As before a reference, which is of an open gripper."""

    def offer(name: str, good: bool, told: str) -> None:
        def serve(_: Any, response: Any) -> Any:
            cell.called.append(name)
            response.success, response.message = good, told
            return response

        cell.create_service(Trigger, name, serve, callback_group=ReentrantCallbackGroup())

    offer("sim/grasp", True, "grasped the squeegee")
    offer("sim/release", opens, answer)
    offer("estimator/initialize_grasp", False, "no reference: capture one with the bubbles touching nothing")
    names = ("sim/grasp", "estimator/initialize_grasp", "sim/release")
    until(lambda: all(hands._triggers[name].service_is_ready() for name in names))
    good, told = hands.press("Grasp").result(10.0)
    assert not good
    assert cell.called == list(names)
    assert told == f"Grasp: no reference: capture one with the bubbles touching nothing; {how}."


def test_stop_is_served_at_once_while_another_button_waits(cell: SlowCell, hands: CellHands) -> None:
    ready(hands)
    cell.enabled = True
    hands.press("Reference")
    until(lambda: "reference" in cell.called)
    hands.stop()
    until(lambda: not cell.enabled)
    assert not cell.go_on.is_set()  # the other one waits still
    until(lambda: "comes to rest" in words(hands))


def test_of_two_pages_that_ask_for_different_things_the_second_is_told_so(cell: SlowCell, hands: CellHands) -> None:
    ready(hands)
    hands.press("Reference")
    until(lambda: "reference" in cell.called)
    hands.press("Enable")
    until(lambda: "Enable: not now, Reference is under way" in words(hands))
    assert not cell.enabled
    cell.go_on.set()
    until(lambda: "Reference: the left bubble touches something" in words(hands))
    hands.press("Enable")
    until(lambda: cell.enabled)


@pytest.mark.parametrize("moment", ["resume", "enabling"])
def test_a_stop_counts_more_than_an_enable_that_is_under_way(cell: SlowCell, hands: CellHands, moment: str) -> None:
    cell.offer_stop(good=True)
    ready(hands)
    until(hands._triggers["driver/stop"].service_is_ready)
    slow = cell.arm_is_there if moment == "resume" else cell.enable_in_time
    slow.clear()
    hands.press("Enable")
    until(lambda: moment in cell.called)
    hands.stop()
    until(lambda: "stop" in cell.called)
    slow.set()
    until(lambda: "Stop counts" in words(hands))
    until(lambda: "stop" in cell.called[cell.called.index("stop") + 1 :])  # again: the arm has followed since the first
    until(lambda: "off" in cell.called[cell.called.index("resumed") :])
    assert not cell.enabled


def test_an_enable_that_nobody_answers_is_taken_back(
    cell: SlowCell, hands: CellHands, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("seed_bringup.page.ros.hands.PATIENCE", 1.0)
    ready(hands)
    cell.enable_in_time.clear()
    assert hands.press("Enable").result(10.0) == (False, "Enable: no answer of controller/enable.")
    cell.enable_in_time.set()
    until(lambda: cell.called[-1] == "off")
    assert not cell.enabled


def test_a_stop_is_good_only_if_everybody_stops(
    cell: SlowCell, hands: CellHands, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("seed_bringup.page.ros.hands.STOP_PATIENCE", 9.0)  # [s]: this machine may be busy
    cell.offer_stop(good=False)
    ready(hands)
    until(hands._triggers["driver/stop"].service_is_ready)
    good, told = hands.stop().result(10.0)
    assert not good
    assert "controller comes to rest" in told
    assert "driver: the arm's program does not answer" in told


def mute_controller(cell: SlowCell) -> tuple[ActionServer, threading.Event, threading.Event]:
    """Takes a task and says no more; whether the task has begun, and what ends it."""
    begun, end = threading.Event(), threading.Event()

    def play(goal: Any) -> Any:
        begun.set()
        end.wait(20.0)
        goal.abort()
        return FollowSetpoints.Result()

    return ActionServer(cell, FollowSetpoints, ACTION, play, callback_group=ReentrantCallbackGroup()), begun, end


@pytest.mark.parametrize(
    ("cell", "hands", "anew", "told"),
    [
        ("/abandoned", "/abandoned", False, "the controller has been gone for"),
        ("/restarted", "/restarted", True, "the controller was started anew, and does not know the task"),
    ],
    indirect=("cell", "hands"),
)
def test_a_task_whose_controller_has_died_ends_and_the_other_buttons_work(
    cell: SlowCell, hands: CellHands, anew: bool, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("seed_bringup.ros.played_goal.GONE", 1e9 if anew else 0.3)
    monkeypatch.setattr("seed_bringup.ros.played_goal.QUIET", 0.5)
    ready(hands)
    server, begun, end = mute_controller(cell)
    until(hands._action.server_is_ready)
    said = hands.play("squeegee", None)
    assert begun.wait(10.0)
    until(lambda: hands._ended is not None)
    assert not said.done()
    with second_controller(cell) if anew else contextlib.nullcontext():
        server.destroy()
        good, words_of_play = said.result(10.0)
    end.set()
    assert not good
    assert f"Play squeegee: {told}" in words_of_play
    assert not hands.playing.task
    hands.press("Enable")
    until(lambda: cell.enabled)


@pytest.mark.parametrize(("cell", "hands"), [("/asked", "/asked")], indirect=True)
def test_a_cancel_that_finds_no_task_ends_what_the_page_takes_for_one(
    cell: SlowCell, hands: CellHands, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("seed_bringup.ros.played_goal.QUIET", 1e9)  # it is not asked by itself
    server, begun, end = mute_controller(cell)
    until(hands._action.server_is_ready)
    said = hands.play("squeegee", None)
    assert begun.wait(10.0)
    until(lambda: hands._ended is not None)
    with second_controller(cell):
        server.destroy()
        assert hands.press("Lift").result(10.0) == (False, "Cancel: no task is being played.")
        assert "started anew" in said.result(10.0)[1]
    end.set()


@contextlib.contextmanager
def second_controller(cell: SlowCell) -> Iterator[None]:
    """Offers the same action, from before the first one goes: nobody sees a gap."""
    node = Node("controller", context=cell.context, namespace=cell.get_namespace())
    executor = SingleThreadedExecutor(context=cell.context)
    server = ActionServer(node, FollowSetpoints, ACTION, lambda _: FollowSetpoints.Result())
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    service = f"{cell.get_namespace()}/{ACTION}/_action/get_result"
    until(lambda: cell.count_services(service) == 2)
    time.sleep(0.3)  # until the others have met it as well
    try:
        yield
    finally:
        executor.shutdown(timeout_sec=2.0)
        thread.join(2.0)
        server.destroy()
        node.destroy_node()


@pytest.mark.parametrize(("cell", "hands"), [("/texts", "/texts")], indirect=True)
def test_an_own_task_is_sent_as_text_and_the_cell_s_own_by_its_place_there(
    cell: SlowCell, hands: CellHands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[str] = []

    def play(goal: Any) -> Any:
        sent.append(goal.request.task)
        goal.succeed()
        return FollowSetpoints.Result(success=True)

    server = ActionServer(cell, FollowSetpoints, ACTION, play)
    until(hands._action.server_is_ready)
    mine = tmp_path / "mine.yaml"
    mine.write_text(shipped_tasks()["squeegee"].read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.setattr(hands._known, "task", "/of/the/cell.yaml")
    for task, good in ((str(mine), True), ("/of/the/cell.yaml", True), ("/of/nobody.yaml", False)):
        assert hands.play(task, None).result(10.0)[0] == good
    server.destroy()
    assert "no task '/of/nobody.yaml'" in words(hands)
    assert [read_task(sent[0]), sent[1:]] == [load_task(mine), ["/of/the/cell.yaml"]]


@pytest.mark.usefixtures("cell")
def test_a_fault_in_a_button_or_a_timer_is_told_and_ends_nothing(hands: CellHands) -> None:
    ready(hands)

    async def faulty() -> str:
        raise RuntimeError("no such handle")

    hands._release = faulty  # type: ignore[method-assign]
    assert hands.press("Release").result(10.0) == (
        False,
        "Release: the page has a fault: RuntimeError: no such handle.",
    )

    def once() -> None:
        hands.node.destroy_timer(timer)
        raise RuntimeError("timer failed")

    timer = hands.node.create_timer(0.01, once)
    until(lambda: "The page has a fault: RuntimeError: timer failed" in words(hands))
    assert hands.press("Enable").result(10.0)[0]


@pytest.mark.usefixtures("cell")
def test_the_buttons_need_no_more_than_the_page_s_enclave_may_do(hands: CellHands) -> None:
    ready(hands)
    policy = Path(__file__).resolve().parents[1] / "config/access/cell.policy.xml"
    may = {does: {r.name for r in read_policy(policy)["/page"] if r.does == does} for does in DOES}
    names = {
        kind: {n for n, _ in getattr(hands.node, f"get_{kind}_names_and_types_by_node")("page_hands", "/")}
        for kind in ("publisher", "service", "client")
    }
    assert "/controller/operator" in names["publisher"]
    assert names["publisher"] <= may["publish"]
    assert not names["service"]
    called = {n for n in names["client"] if "/_action/" not in n}
    assert called <= may["request"]
    assert {n.partition("/_action/")[0] for n in names["client"] - called} <= may["call"]


def test_the_hands_keep_a_name_of_their_own_where_a_launch_file_names_the_page() -> None:
    context = Context()
    rclpy.init(args=["--ros-args", "-r", "__node:=page"], context=context)
    hands = CellHands(context, ("squeegee",))
    name = hands.node.get_name()
    hands.close()
    rclpy.try_shutdown(context=context)
    assert name == "page_hands"


@pytest.mark.parametrize("hands", ["/nobody"], indirect=True)
def test_without_a_cell_every_button_says_so(hands: CellHands) -> None:
    for button in ("Reference", "Grasp", "Enable", "Release", "Lift"):
        hands.press(button)
        until(lambda button=button: any(f"{button}:".replace("Lift", "Cancel") in text for _, text in hands.said))
    hands.play("squeegee", None)
    until(lambda: "Play squeegee" in words(hands))
    hands.stop()
    until(lambda: "emergency stop" in words(hands))
    assert not any(good for good, _ in hands.said)
    assert all("does the cell run" in text or "emergency" in text for _, text in hands.said)


def test_ctrl_c_ends_the_page_of_a_cell_with_130_as_every_command() -> None:
    program = "import sys; from seed_bringup.commands.view import main; sys.exit(main(['--port', '0']))"
    page = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert page.stdout is not None
    assert "http://" in page.stdout.readline()
    page.send_signal(signal.SIGINT)
    assert (page.communicate(timeout=20.0)[1], page.returncode) == ("seed view: interrupted\n", 130)


INTERRUPTED = """
import os, signal, sys
from seed_bringup.commands.view import main
from seed_bringup.page.ros import node

def interrupt(*_):
    os.kill(os.getpid(), signal.SIGINT)

node.PageServer = interrupt  # the node has its hands by now, and nobody has the node
sys.exit(main(["--port", "0"]))
"""


def test_a_page_that_is_interrupted_while_it_is_made_ends_as_well() -> None:
    """Its hands were in the middleware as Python ended: most of these aborted."""
    for _ in range(4):
        page = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=60.0)
        assert (page.stdout, page.stderr, page.returncode) == ("", "seed view: interrupted\n", 130)


def test_a_message_that_is_nonsense_is_left_out_and_the_others_are_shown() -> None:
    X = make_pose(None, (0.4, 0.1, 0.3))
    good, bad = pose_stamped(X, 5.0, "base"), pose_stamped(X, 4.0, "base")
    bad.pose.orientation.w = float("nan")
    state = read_state({"current_pose": good, "sim/ground_truth/table_pose": bad, "bubble_left/depth/x": b"?"}, {})
    np.testing.assert_allclose(state.X_WE, X, atol=1e-12)
    assert state.X_WS is None
    assert state.now == 5.0


def test_the_page_draws_the_table_as_it_is_bent() -> None:
    scenario = load_scenario("cylinder")
    surface = draw_surface(scenario.table, np.eye(4), np.random.default_rng(2), 1, 2)
    marker = table_marker(surface, pose_stamped(surface.X_WS, 1.0, "base"))
    shape, flat = TableShape(), Marker()
    mesh = shape.of(marker)
    assert shape.of(marker) is mesh  # worked out once
    upper = mesh.vertices[mesh.vertices[:, 2] > mesh.vertices[:, 2].min() + 0.015]
    np.testing.assert_allclose(upper[:, 2], surface.height(upper[:, 0], upper[:, 1]).clip(-0.12), atol=1e-9)
    assert np.ptp(upper[:, 2]) > 0.02
    with pytest.raises(ValueError, match="no triangles"):
        shape.of(flat)


class Speaking:
    """A cell that publishes its flange and controller's state, with stamps from `begins` [s] on."""

    def __init__(self, bench: Bench, arm: str, holds: str, begins: float) -> None:
        self._bench, self._begins, self._began = bench, begins, time.monotonic()
        self.node = Node(arm, context=bench.context)
        self.node.declare_parameter("model", "ur5e")
        self.node.declare_parameter("robot_ip", "192.168.56.101")
        self._executor = SingleThreadedExecutor(context=bench.context)
        self._executor.add_node(self.node)
        self._pose = self.node.create_publisher(PoseStamped, "current_pose", COMMAND)
        self._state = self.node.create_publisher(ControllerState, "controller/state", COMMAND)
        self._holds = self.node.create_publisher(String, f"{arm}/hold_reason", LATCHED)
        self._holds.publish(String(data=holds))

    def speak(self) -> None:
        """From now on."""
        self._bench.every.append(self._publish)

    def _publish(self) -> None:
        stamp = self._begins + time.monotonic() - self._began
        self._pose.publish(pose_stamped(make_pose(None, (0.4, 0.1, 0.3)), stamp, "base"))
        self._state.publish(stamped(ControllerState, stamp, "base"))
        self._executor.spin_once(timeout_sec=0.0)

    def end(self) -> None:
        if self._publish in self._bench.every:
            self._bench.every.remove(self._publish)
        self._executor.shutdown()
        self.node.destroy_node()


@pytest.fixture
def page(bench: Bench) -> Iterator[PageNode]:
    page = PageNode("page", context=bench.context, parameter_overrides=[Parameter("port", value=0)])
    bench.every.append(page.loop.once)
    yield page
    page.destroy_node()


def begun(page: PageNode) -> float:
    """Stamp of the state that is shown [s]."""
    return page.state.control.stamp if page.state.control is not None else float("nan")


@pytest.mark.parametrize("begins", [5.0, 1.9e9])  # by simulated time; later than the first, as most cells
def test_after_a_silence_the_page_shows_the_cell_that_speaks_and_nothing_of_the_one_before(
    bench: Bench, page: PageNode, begins: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("seed_bringup.page.ros.node.SILENT", 0.5)
    first = Speaking(bench, "driver", "protective stop", 1.8e9)  # time of the wall
    first.speak()
    assert bench.until(lambda: page.state.arm_holds and page.hands.arm and begun(page) > 1.8e9)
    first.end()
    bench.spin(1.0)
    assert page.state.arm_holds == "protective stop"  # the page says that it is old
    second = Speaking(bench, "sim", "", begins)
    second.speak()
    assert bench.until(lambda: begins + 1.0 < begun(page) < begins + 1e6)
    assert (page.state.arm, page.state.arm_holds) == ("simulated", "")
    ago, *_ = page.history.series(2, page.state.now)
    assert ago[0] >= -page.history.span
    assert ago[-1] == 0.0
    second.end()


def test_a_controller_whose_time_goes_back_is_another_and_what_its_cell_said_once_is_heard_again(
    bench: Bench, page: PageNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("seed_bringup.page.ros.node.SILENT", 1e9)
    first, second = Speaking(bench, "driver", "protective stop", 50.0), Speaking(bench, "sim", "no target_frame", 5.0)
    first.speak()
    assert bench.until(lambda: page.state.arm_holds == "protective stop" and "sim/hold_reason" in page._newest)
    assert bench.until(lambda: begun(page) > 50.0)
    first.end()
    second.speak()
    assert bench.until(lambda: begun(page) < 50.0)
    assert bench.until(lambda: page.state.arm_holds == "no target_frame", 5.0)
    assert page.state.arm == "simulated"
    second.end()


def test_the_page_s_time_is_the_controller_s() -> None:
    old = pose_stamped(np.eye(4), 1.8e9, "base")  # of a camera by the time of the wall
    messages = {"current_pose": old, "controller/state": stamped(ControllerState, 5.0, "base")}
    assert read_state(messages, {}).now == 5.0


def write_bag(path: Path, prefix: str = "") -> Path:
    """Ten seconds in which the flange rises by 1 mm a second, and the force by 1 N."""
    with BagWriter(path) as bag:
        poses = bag.add_topic(f"{prefix}/current_pose", "geometry_msgs/msg/PoseStamped", [qos.for_bag(QUEUE)])
        states = bag.add_topic(f"{prefix}/controller/state", "seed_msgs/msg/ControllerState", [qos.for_bag(COMMAND)])
        for t in np.arange(0.0, 10.0, 0.05):
            pose: PoseStamped = pose_stamped(make_pose(None, (0.4, 0.0, 0.3 + 1e-3 * t)), 100.0 + t, "base")
            state: ControllerState = stamped(ControllerState, 100.0 + t, "base")
            state.mode, state.enabled = "contact", True
            state.estimated.force.z = -t
            for connection, message in ((poses, pose), (states, state)):
                bag.write(connection, round(1e9 * (1000.0 + t)), serialize_message(message))
    return path


@pytest.mark.parametrize("prefix", ["", "/left"])
def test_a_bag_is_shown_as_it_was_at_any_of_its_moments(tmp_path: Path, prefix: str) -> None:
    with open_bag(write_bag(tmp_path / "bag.mcap", prefix)) as reader:
        recording = Recording(reader)
        assert recording.end - recording.start == pytest.approx(9.95, abs=0.01)
        for t in (8.0, 2.0):
            state, history = recording.at(recording.start + t), History(span=20.0)
            assert state.X_WE is not None
            assert state.control is not None
            assert state.X_WE[2, 3] == pytest.approx(0.3 + 1e-3 * t, abs=2e-4)
            assert state.control.mode == "contact"
            recording.fill(history, recording.start + t)
            ago, _, measured, _, _ = history.series(2, state.now)
            np.testing.assert_allclose(measured, -(t + ago), atol=0.1)  # the force of every moment before


def test_a_played_bag_runs_to_its_end_stops_there_and_begins_anew(tmp_path: Path) -> None:
    with open_bag(write_bag(tmp_path / "bag.mcap")) as reader, served(0, "bag") as server:
        player = Player(server, Recording(reader), "ur5e")
        player.step(0.1)
        assert player._slider.value == 0.0  # nothing plays before it is asked to
        player._toggle()
        for _ in range(50):
            player.step(0.1)
        assert player._slider.value == pytest.approx(5.0, abs=0.01)
        for _ in range(60):
            player.step(0.1)
        assert player._slider.value == player._slider.max
        assert not player._running
        player._toggle()
        assert player._slider.value == 0.0


def test_a_bag_is_opened_where_the_tool_is_held_first(tmp_path: Path) -> None:
    """A bag begins before its cell does: nothing but an empty floor would be seen."""
    with BagWriter(tmp_path / "bag.mcap") as bag:
        states = bag.add_topic("/controller/state", "seed_msgs/msg/ControllerState", [qos.for_bag(COMMAND)])
        flange = bag.add_topic("/current_pose", "geometry_msgs/msg/PoseStamped", [qos.for_bag(QUEUE)])
        grasps = bag.add_topic("/relative_pose", "seed_msgs/msg/RelativePose", [qos.for_bag(COMMAND)])
        for t in np.arange(0.0, 6.0, 0.1):
            bag.write(states, round(1e9 * (50.0 + t)), serialize_message(stamped(ControllerState, t, "base")))
            if t > 1.95:
                pose = pose_stamped(make_pose(None, (0.4, 0.0, 0.3)), t, "base")
                bag.write(flange, round(1e9 * (50.0 + t)), serialize_message(pose))
                held = estimate_to_message(RelativePoseEstimate(t, np.eye(4), valid=t > 3.95), "compliance", "tool")
                bag.write(grasps, round(1e9 * (50.0 + t)), serialize_message(held))
    with open_bag(tmp_path / "bag.mcap") as reader, served(0, "bag") as server:
        player = Player(server, Recording(reader), "ur5e")
        assert player._slider.value == pytest.approx(4.0, abs=0.11)
        assert player._slider.max == pytest.approx(5.9, abs=0.11)
        state = player._recording.at(player._recording.start + player._slider.value)
        assert state.X_WE is not None
        assert state.grasp is not None
        assert state.grasp.valid
        nothing = headline(player._recording.at(player._recording.start - 1.0), live=False)
        assert nothing.word == "Nothing yet"
        assert "launch" not in nothing.todo


def test_a_bag_without_anything_to_show_says_how_to_record_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "other.mcap"
    with BagWriter(path) as bag:
        topic = bag.add_topic("/chatter", "std_msgs/msg/String", [qos.for_bag(COMMAND)])
        bag.write(topic, 1, serialize_message(String(data="hello")))
    assert view.main([str(path)]) == 2
    told = capsys.readouterr().err
    assert "/chatter" in told
    assert "./seed bag record --all" in told


def test_a_bag_of_another_version_is_refused_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with open_bag(write_bag(tmp_path / "bag.mcap")) as reader:
        changed = [c._replace(digest="RIHS01_" + "0" * 64) for c in reader.connections]
        monkeypatch.setattr(type(reader), "connections", property(lambda _: changed))
        with pytest.raises(BagError, match=r"another version of .*; look at it with the release"):
            Recording(reader)


def test_a_file_that_is_no_bag_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert view.main([str(tmp_path / "nothing.mcap")]) == 2
    assert "not a readable bag" in capsys.readouterr().err

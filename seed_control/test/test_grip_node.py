# SPDX-License-Identifier: Apache-2.0
"""The grip that answers slip in the controller's node, with a gripper that does what it is told, or nothing."""

from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from diagnostic_msgs.msg import DiagnosticStatus
from seed_msgs.msg import MembraneMotion
from std_msgs.msg import Float64
from std_srvs.srv import SetBool
from test_control_node import Cell

from seed_ros.qos import COMMAND, QUEUE
from seed_ros.testing import Bench

pytestmark = pytest.mark.ros

FRICTION, PULL, STIFFNESS = 0.8, 6.0, 800.0  # [1], [N], [N/m]


class Gripper:
    """Fingers that push as they are asked to, at once; deaf: they do not."""

    def __init__(self, bench: Bench) -> None:
        self.force, self.deaf, self.silent = 3.0, False, False
        self.asked: list[float] = []
        client = bench.client
        client.create_subscription(Float64, "gripper/force_command", self._on_force, COMMAND)
        self._width = client.create_publisher(Float64, "gripper/width", QUEUE)
        self._force = client.create_publisher(Float64, "gripper/force", QUEUE)
        bench.every.append(self._tell)

    def _on_force(self, message: Float64) -> None:
        self.asked.append(message.data)
        if not self.deaf:
            self.force = message.data

    def _tell(self) -> None:
        if not self.silent:
            self._width.publish(Float64(data=0.02))
            self._force.publish(Float64(data=self.force))


def pull(message: Any) -> None:
    message.pose.pose.position.z = PULL / STIFFNESS


def world(**parameters: Any) -> Iterator[tuple[Bench, Cell, Gripper]]:
    bench = Bench()
    try:
        cell = Cell(bench, grip_answer__friction=FRICTION, grip_answer__answer_time=1.0, **parameters)
        yield bench, cell, Gripper(bench)
    finally:
        bench.close()


@pytest.fixture
def answering() -> Iterator[tuple[Bench, Cell, Gripper]]:
    yield from world(grip_answer__command="force")


@pytest.fixture
def off() -> Iterator[tuple[Bench, Cell, Gripper]]:
    yield from world()


def test_it_grips_as_the_pull_needs_and_tells_the_margin(answering: tuple[Bench, Cell, Gripper]) -> None:
    bench, cell, gripper = answering
    margins: list[float] = []
    told: list[DiagnosticStatus] = []
    bench.client.create_subscription(Float64, "slip_margin", lambda m: margins.append(m.data), QUEUE)
    bench.client.create_subscription(DiagnosticStatus, "controller/grip", told.append, COMMAND)
    assert bench.until(lambda: bool(margins))
    bench.spin(0.3)
    assert not gripper.asked  # nothing before enable
    cell.enabled()
    cell.change = pull
    needed = PULL / (2.0 * FRICTION)
    assert bench.until(lambda: needed < gripper.force < 1.6 * needed and 0.1 < margins[-1] < 0.4)
    assert cell.state.mode != "holding"
    told.clear()  # it is told five times a second
    assert bench.until(lambda: bool(told))
    values = {v.key: float(v.value) for v in told[-1].values}
    assert values["load_N"] == pytest.approx(PULL, rel=0.2)
    assert values["friction"] == pytest.approx(FRICTION, rel=0.2)


def test_friction_is_learnt_from_what_the_tool_slides_on_its_membranes(off: tuple[Bench, Cell, Gripper]) -> None:
    bench, cell, gripper = off
    told: list[DiagnosticStatus] = []
    bench.client.create_subscription(DiagnosticStatus, "controller/grip", told.append, COMMAND)
    gripper.force = 8.0
    slid = 0.0

    def pulled(message: Any) -> None:
        message.pose.pose.position.z = PULL / STIFFNESS + slid
        message.slid.pose.position.z = slid
        message.membrane = [MembraneMotion(finger=finger) for finger in ("left", "right")]
        for motion in message.membrane:
            motion.motion.pose.position.z = PULL / STIFFNESS

    cell.enabled()
    cell.change = pulled
    assert bench.until(lambda: bool(told) and value(told, "load_N") > 0.8 * PULL)
    stuck = value(told, "friction")
    slid = PULL / STIFFNESS  # on membranes that stay
    assert bench.until(lambda: value(told, "friction") < 0.8 * stuck)
    assert value(told, "load_N") == pytest.approx(PULL, rel=0.2)
    learnt = value(told, "friction")

    def slips(message: Any) -> None:
        pulled(message)
        message.gross_slip, message.valid = True, False

    cell.change = slips
    assert bench.until(lambda: value(told, "margin") < 0.1)
    assert value(told, "friction") <= learnt


def value(told: list[DiagnosticStatus], name: str) -> float:
    """Of the newest status."""
    return next(float(v.value) for v in told[-1].values if v.key == name)


def test_a_deaf_gripper_makes_the_arm_hold_and_is_named(answering: tuple[Bench, Cell, Gripper]) -> None:
    bench, cell, gripper = answering
    assert bench.until(lambda: cell.node.grip.hold == "")
    cell.enabled()
    gripper.deaf = True
    cell.change = pull
    assert bench.until(lambda: cell.state.mode == "holding")
    assert "the gripper does not follow: it grips with" in cell.state.reason
    refused = bench.call(SetBool, "controller/enable", SetBool.Request(data=True))
    assert not refused.success
    assert "does not follow" in refused.message
    assert gripper.asked[-1] > 3.0  # it goes on asking


def test_a_grip_that_was_set_by_hand_can_be_enabled(answering: tuple[Bench, Cell, Gripper]) -> None:
    bench, cell, gripper = answering
    assert bench.until(lambda: cell.node.grip.hold == "")
    gripper.force = 10.0  # more than the load needs
    bench.spin(2.2)  # answer_time is 1 s
    assert not gripper.asked
    assert cell.node.grip.hold == ""
    cell.enabled()
    assert bench.until(lambda: bool(gripper.asked))
    assert gripper.asked[0] > 9.0


def test_a_silent_gripper_is_refused_before_anything_moves(answering: tuple[Bench, Cell, Gripper]) -> None:
    bench, cell, gripper = answering
    gripper.silent = True
    bench.spin(0.2)
    assert bench.until(lambda: bool(cell.states) and cell.node.grip.hold != "")
    refused = bench.call(SetBool, "controller/enable", SetBool.Request(data=True))
    assert not refused.success
    assert "gripper" in refused.message


def test_it_is_off_unless_allowed(off: tuple[Bench, Cell, Gripper]) -> None:
    bench, cell, gripper = off
    cell.enabled()
    cell.change = pull
    bench.spin(0.5)
    assert not gripper.asked
    assert cell.state.mode != "holding"
    names = [p.topic_name for p in cell.node.publishers]
    assert "/gripper/command" not in names
    assert "/gripper/force_command" not in names

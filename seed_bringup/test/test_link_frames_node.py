# SPDX-License-Identifier: Apache-2.0
"""The node that draws the arm's links takes the arm's joints, and says when there are none."""

from collections.abc import Iterator

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("tf2_msgs", reason="the workspace is not built (./seed test does it)")

from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from seed_bringup.ros.link_frames import LinkFramesNode
from seed_ros import diagnostics
from seed_ros.testing import Bench

pytestmark = pytest.mark.realtime
ARM = [f"{joint}_joint" for joint in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


def publishing(bench: Bench, *names: list[str]) -> tuple[LinkFramesNode, list[TFMessage]]:
    """The node beside publishers of joints, in this order each time; and what it sends."""
    node = bench.add(LinkFramesNode)
    sent: list[TFMessage] = []
    bench.client.create_subscription(TFMessage, "/tf", sent.append, 100)
    out = bench.client.create_publisher(JointState, "joint_states", 10)
    assert bench.until(out.get_subscription_count)
    for joints in names:
        message = JointState(name=joints, position=[0.1] * len(joints))
        bench.every.append(lambda message=message: out.publish(message))
    return node, sent


@pytest.mark.parametrize("names", [["finger_joint"], [f"left_{name}" for name in ARM]])
def test_joints_of_others_are_told_and_draw_nothing(bench: Bench, names: list[str]) -> None:
    node, sent = publishing(bench, names)
    bench.spin(1.0)
    level, words, _ = node._report()
    assert level == diagnostics.STALE
    assert words.startswith(f"joint_states has no angle of {ARM[0]}, ")
    assert f"; it has {', '.join(names)}: the links are not drawn" in words
    assert not sent


def test_a_gripper_on_the_same_topic_displaces_no_message_of_the_arm(bench: Bench) -> None:
    node, sent = publishing(bench, ARM, ["finger_joint"])
    assert bench.until(lambda: len(sent) > 5, 10.0)
    assert node._report()[:2] == (diagnostics.OK, "drawing the links")
    assert {len(m.transforms) for m in sent} == {len(ARM)}


def test_without_a_message_that_is_said(bench: Bench) -> None:
    node, _ = publishing(bench)
    assert node._report()[1].startswith("no joint_states: ")

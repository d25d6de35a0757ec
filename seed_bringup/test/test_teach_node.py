# SPDX-License-Identifier: Apache-2.0
"""./seed teach: from a bag, and from a cell whose arm is led by hand."""

import os
import re
import select
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

import rclpy
from action_msgs.srv import CancelGoal
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rosbags.typesys import get_types_from_msg
from seed_msgs.msg import ControllerState, WrenchEstimate
from std_srvs.srv import SetBool

from seed_bringup.bags.files import BagWriter
from seed_bringup.bags.types import InstalledTypes, definition_file
from seed_bringup.teach import command
from seed_bringup.teach.heard import STATE, WRENCH, Heard
from seed_bringup.teach.ros import live
from seed_control.tasks import load_task
from seed_control.teach import TeachError
from seed_ros.conversions import stamped
from seed_ros.qos import COMMAND

pytestmark = pytest.mark.ros
RATE = 30.0  # [Hz]


def messages(enabled: bool, gap: float = 0.0) -> Iterator[tuple[ControllerState, WrenchEstimate]]:
    """Down to the table, 0.1 m along it with 6 N, and up."""
    corners = np.array(((0.4, 0.0, 0.03), (0.4, 0.0, 0.0), (0.4, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 0.0, 0.03)))
    at, force = np.array((0.0, 1.0, 1.6, 4.6, 5.6)), (0.0, 0.0, 6.0, 6.0, 0.0)
    for t in np.arange(0.0, at[-1], 1.0 / RATE):
        stamp = 100.0 + t + (gap if t > 3.0 else 0.0)
        state, wrench = stamped(ControllerState, stamp, "base"), stamped(WrenchEstimate, stamp, "base")
        p, state.enabled = state.tip.position, enabled
        p.x, p.y, p.z = (float(np.interp(t, at, c)) for c in corners.T)
        state.tip.orientation.x, state.tip.orientation.w = 1.0, 0.0
        wrench.wrench.force.z = -float(np.interp(t, at, force)) if 1.0 < t < 4.6 else 0.0
        yield state, wrench


def write(path: Path, **how: Any) -> Path:
    with BagWriter(path) as bag:
        states = bag.add_topic("/controller/state", "seed_msgs/msg/ControllerState")
        wrenches = bag.add_topic("/wrench_estimate", "seed_msgs/msg/WrenchEstimate")
        for k, (state, wrench) in enumerate(messages(**how)):
            bag.write(states, 1000 + 10 * k, serialize_message(state))
            bag.write(wrenches, 1001 + 10 * k, serialize_message(wrench))
    return path


@pytest.mark.parametrize("enabled", [True, False])
def test_a_bag_becomes_a_task_file(tmp_path: Path, capsys: pytest.CaptureFixture[str], enabled: bool) -> None:
    out = tmp_path / "mine.yaml"
    assert command.main([str(out), str(write(tmp_path / "bag.mcap", enabled=enabled)), "--resists", "x"]) == 0
    told = capsys.readouterr().out
    found = re.search(rf"an arm that was {'played' if enabled else 'led'}; forces (\S+) N; (\d+) mm in contact", told)
    assert found is not None
    assert [float(v) for v in found.groups()] == pytest.approx([6.0, 100.0], rel=0.05)
    task = load_task(str(out))
    wipe = next(p for p in task.phases if p.name == "wipe")
    assert wipe.control is not None
    assert wipe.control.force == pytest.approx((0.0, 0.0, -6.0), abs=0.1)
    end = task.frame.pose @ np.append(wipe.to, 1.0)
    np.testing.assert_allclose(end[1:3], 0.0, atol=1e-3)
    assert 0.5 - end[0] < 0.1 * 0.1 / 3.0 + 1e-3  # [m]: forces are averaged over 0.1 s to both sides, at 0.1 m in 3 s
    assert command.main([str(out), str(tmp_path / "bag.mcap")]) == 2
    (tmp_path / "before").hardlink_to(out)
    out.write_text("of before")
    assert command.main([str(out), str(tmp_path / "bag.mcap"), "--resists", "x", "--force"]) == 0
    assert (tmp_path / "before").read_text() == "of before"  # it stays until the new one is whole
    assert "exists: name another file" in capsys.readouterr().err


def test_a_bag_that_is_no_demonstration_is_refused_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "mine.yaml"
    assert command.main([str(out), str(write(tmp_path / "gap.mcap", enabled=True, gap=2.0))]) == 2
    assert "the demonstration has a gap of 2.03 s" in capsys.readouterr().err
    with BagWriter(tmp_path / "other.mcap") as bag:
        bag.add_topic("/controller/state", "seed_msgs/msg/ControllerState")
    assert command.main([str(out), str(tmp_path / "other.mcap")]) == 2
    assert "lacks /wrench_estimate: record with" in capsys.readouterr().err
    assert not out.exists()
    assert command.main([str(tmp_path / "none" / "mine.yaml"), "--freedrive"]) == 2  # before any arm is led
    assert "there is no folder" in capsys.readouterr().err


def shown(
    heard: Heard, *stretches: tuple[float, bool], start: float = 100.0, late: float = 0.0, ahead: int = 0
) -> Heard:
    """A tip that moves at 20 mm/s and presses with as many newtons as it went millimetres.

    stretches: [s] of each, and whether the controller was enabled. late: [s] of the states after their image.
    ahead: messages by which the states come before their forces.
    """
    states, wrenches, t = [], [], start
    for duration, enabled in stretches:
        for _ in range(round(duration * RATE)):
            t += 1.0 / RATE
            state, wrench = stamped(ControllerState, t + late, "base"), stamped(WrenchEstimate, t, "base")
            state.enabled, state.estimate_age = enabled, late
            state.tip.position.x = 0.02 * (t - start)
            wrench.wrench.force.z = -20.0 * (t - start)
            states.append(state)
            wrenches.append(wrench)
    for k in range(-abs(ahead), len(states) + abs(ahead)):
        for name, messages, at in ((STATE, states, k + max(ahead, 0)), (WRENCH, wrenches, k + max(-ahead, 0))):
            if 0 <= at < len(messages):
                heard.take(name, messages[at])
    return heard


@pytest.mark.parametrize("late", [0.0, 0.05])
@pytest.mark.parametrize("ahead", [0, 1, -1, 3])
def test_tip_and_force_are_those_of_one_image_in_whatever_order_they_come(late: float, ahead: int) -> None:
    d = shown(Heard(), (4.0, True), late=late, ahead=ahead).demonstration()
    assert len(d.stamps) == 4 * RATE
    np.testing.assert_allclose(d.X_W_tip[:, 0, 3], 0.02 * (d.stamps - 100.0), atol=1e-6)
    np.testing.assert_allclose(d.forces[:, 2], -20.0 * (d.stamps - 100.0), atol=1e-3)


@pytest.mark.parametrize(
    ("stretches", "led", "taken", "told"),
    [
        (
            [(20, False), (2, True)],
            False,
            20,
            "of 2 stretches (20.0 s led, 2.0 s played) the longest was taken, 20.0 s led",
        ),
        ([(2, False), (6, True), (0.5, False), (9, True)], False, 9, "the longest was taken, 9.0 s played"),
        ([(2, True), (3, False), (9, True)], True, 3, "the longest that was led was taken, 3.0 s led"),
        ([(5, True)], False, 5, ""),
    ],
)
def test_the_longest_stretch_counts_and_what_is_dropped_is_told(
    stretches: list[tuple[float, bool]], led: bool, taken: float, told: str
) -> None:
    heard = shown(Heard(led), *stretches)
    stamps = heard.demonstration().stamps
    assert stamps[-1] - stamps[0] == pytest.approx(taken, abs=0.1)
    assert heard.choice.endswith(told)
    assert bool(heard.choice) is bool(told)


def test_what_was_played_alone_is_nothing_that_was_led() -> None:
    with pytest.raises(TeachError, match="enabled all the while, and --freedrive teaches what is led"):
        shown(Heard(led=True), (5.0, True)).demonstration()


def test_an_arm_that_stands_for_long_before_a_task_is_no_demonstration() -> None:
    heard = Heard()
    for k in range(60 * round(RATE)):
        heard.take(STATE, stamped(ControllerState, k / RATE, "base"))
        heard.take(WRENCH, stamped(WrenchEstimate, k / RATE, "base"))
    shown(heard, (5.0, True))
    assert heard.played
    assert heard.choice == ""


def test_without_a_terminal_it_must_be_said_for_how_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with open(os.devnull) as nothing:
        for stdin in (nothing, None):
            monkeypatch.setattr("sys.stdin", stdin)
            assert command.main([str(tmp_path / "mine.yaml"), "--freedrive"]) == 2  # before any arm is led
            assert "no terminal in which Enter could end it: say --seconds" in capsys.readouterr().err


def test_what_was_typed_before_does_not_end_a_demonstration(monkeypatch: pytest.MonkeyPatch) -> None:
    keyboard, terminal = os.openpty()
    with os.fdopen(terminal) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        os.write(keyboard, b"\n")
        assert select.select([stdin], [], [], 5.0)[0]
        live.forget_typed()
        assert not select.select([stdin], [], [], 0.2)[0]
        os.write(keyboard, b"\n")
        assert select.select([stdin], [], [], 5.0)[0]
    os.close(keyboard)


def test_a_bag_of_another_version_of_the_messages_is_refused_by_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As it was before the controller's state told where the tip is."""
    before, name = InstalledTypes(), "seed_msgs/msg/ControllerState"
    for other in ("geometry_msgs/msg/Pose", "geometry_msgs/msg/Wrench", "std_msgs/msg/Header"):
        before.load(other)
    lines = definition_file(name).read_text().splitlines()
    before.register(get_types_from_msg("\n".join(line for line in lines if " tip " not in line), name))
    with BagWriter(tmp_path / "old.mcap") as bag:
        bag.add_topic("/wrench_estimate", "seed_msgs/msg/WrenchEstimate")
        old = bag.add_connection("/controller/state", name, typestore=before)
        bag.write(old, 1000, serialize_message(ControllerState()))
    assert command.main([str(tmp_path / "mine.yaml"), str(tmp_path / "old.mcap")]) == 2
    told = capsys.readouterr().err
    assert f"/controller/state was recorded with another version of {name} than is installed here" in told


def test_an_arm_that_is_led_by_hand_is_heard_and_held_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    context, over, switched = Context(), threading.Event(), []
    rclpy.init(args=[], context=context)
    node = Node("sim", context=context)
    led = threading.Event()

    def freedrive(request: Any, response: Any) -> Any:
        switched.append(request.data)
        led.set()
        response.success, response.message = True, f"freedrive {'on' if request.data else 'off'}"
        return response

    node.create_service(SetBool, "driver/set_freedrive", freedrive)
    node.create_service(CancelGoal, "controller/follow_setpoints/_action/cancel_goal", lambda _, r: r)
    publishers = [
        node.create_publisher(ControllerState, "controller/state", COMMAND),
        node.create_publisher(WrenchEstimate, "wrench_estimate", COMMAND),
    ]
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def spin() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            return

    def show() -> None:
        led.wait(30.0)
        for both in messages(enabled=False):
            for publisher, message in zip(publishers, both, strict=True):
                publisher.publish(message)
                time.sleep(0.005)
        over.set()

    threads = [threading.Thread(target=target, daemon=True) for target in (spin, show)]
    for thread in threads:
        thread.start()
    try:
        out = tmp_path / "mine.yaml"
        assert command.main([str(out), "--freedrive", "--seconds", "5"]) == 0
    finally:
        executor.shutdown(timeout_sec=2.0)
        rclpy.try_shutdown(context=context)
    told = capsys.readouterr().out
    assert "listening to a simulated arm" in told
    found = re.search(r"forces (\S+) N;", told)
    assert found is not None
    assert float(found[1]) == pytest.approx(6.0, abs=0.2)
    assert switched == [True, False]
    assert over.is_set()

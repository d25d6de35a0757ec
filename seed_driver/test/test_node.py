# SPDX-License-Identifier: Apache-2.0
"""The driver as its users see it: topics, services, parameters and refusals of the real node."""

import math
import os
import signal
import subprocess
import sys
import time
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

pytest.importorskip("rclpy", reason="rclpy is not installed")
pytest.importorskip("tf2_msgs", reason="the workspace is not built (./seed test does it)")
pytest.importorskip("rtde_control", reason="ur_rtde is not installed (pip install ur-rtde==1.6.5)")

from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64, Int8, String, UInt8
from std_srvs.srv import SetBool, Trigger

from seed_core.arm.quaternion import rotate, turned
from seed_ros.qos import LATCHED
from seed_testing.fault_bench.bench import leftover_processes
from seed_testing.peer import Peer
from seed_ur.standin_client import StandIn

pytestmark = pytest.mark.ros
WAITING = "waiting for the robot program"


def start_node(*parameters: str) -> subprocess.Popen:
    arguments = [part for p in parameters for part in ("-p", p)]
    return subprocess.Popen([sys.executable, "-m", "seed_driver.ros.node", "--ros-args", *arguments])


def stop_node(process: subprocess.Popen) -> int:
    process.send_signal(signal.SIGINT)
    return process.wait(10.0)


@pytest.fixture(scope="module")
def robot():
    with StandIn(None, "--unlock-after", "0.3") as made:
        yield made


@pytest.fixture(scope="module")
def node(robot):
    process = start_node(f"robot_ip:={robot.host}")
    yield process
    assert stop_node(process) == 0


@pytest.fixture(scope="module")
def peer(node):  # noqa: ARG001
    with DriverPeer() as made:
        made.wait(lambda: running(made), 60.0, "driver ready")
        yield made


class DriverPeer(Peer):
    """Hears what our driver says beyond the contract of an arm, and sets its parameters."""

    TOPICS = {
        "current_twist": (TwistStamped, 10),
        "wrench": (WrenchStamped, 10),
        "joint_states": (JointState, 10),
        "driver/robot_mode": (Int8, LATCHED),
        "driver/safety_mode": (UInt8, LATCHED),
        "driver/robot_program_running": (Bool, LATCHED),
        "driver/hold_reason": (String, LATCHED),
        "driver/speed_scaling": (Float64, LATCHED),
    }

    def __init__(self) -> None:
        super().__init__()
        self.latest = {}
        for topic, (kind, qos) in self.TOPICS.items():
            keep = partial(self.latest.__setitem__, topic.removeprefix("driver/"))
            self.node.create_subscription(kind, topic, keep, qos)

    def hold(self, seconds: float) -> None:
        """Stream where the arm is."""
        here = self.pose()
        self.stream(lambda _: here, seconds)

    def set_parameter(self, name: str, value: object) -> tuple[bool, str]:
        """Success and reason."""
        message = Parameter(name, value=value).to_parameter_msg()
        result = self.call("set_parameters", SetParameters, parameters=[message]).results[0]
        return result.successful, result.reason


def running(peer: DriverPeer) -> bool:
    return "robot_program_running" in peer.latest and peer.latest["robot_program_running"].data


@pytest.fixture(autouse=True)
def ready(peer, robot):
    """Every test starts with the arm at rest and targets accepted, whatever the last one left behind."""
    robot.ask("release_emergency_stop")
    peer.spin(0.3)
    if robot.ask("state")["safety_mode"] != 1:
        assert peer.call("unlock_protective_stop").success
    if robot.ask("state")["robot_mode"] != 7:
        assert peer.call("power_on").success
    assert peer.call("resend_robot_program").success


def place(robot) -> np.ndarray:
    return np.array(robot.ask("state")["tcp_pose"][:3])


def test_the_arm_follows_target_frame_and_reports_its_pose(peer, robot) -> None:
    (x, y, z), q = peer.pose()
    peer.stream(lambda t: ((x, y + 0.02 * min(1.0, t), z), turned(q, (0.0, 0.0, 0.1 * min(1.0, t)))), 1.5)
    assert_allclose(place(robot), (x, y + 0.02, z), atol=2e-4)
    p, _ = peer.pose()
    assert_allclose(p, (x, y + 0.02, z), atol=2e-4)
    age = peer.node.get_clock().now().nanoseconds * 1e-9 - stamp(peer.poses[-1][1])
    assert 0.0 <= age < 0.5
    assert peer.latest["hold_reason"].data == ""
    assert [n.split("_")[0] for n in peer.latest["joint_states"].name] == [
        "shoulder",
        "shoulder",
        "elbow",
        *["wrist"] * 3,
    ]


def stamp(message) -> float:
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def test_stamps_of_the_poses_increase(peer) -> None:
    peer.poses.clear()
    peer.spin(1.0)
    stamps = [stamp(m) for _, m in peer.poses]
    assert all(b > a for a, b in pairwise(stamps))
    assert 2 < len(stamps) <= 260  # 250 Hz, fewer on a loaded machine


@pytest.mark.parametrize(
    ("name", "change", "reason"),
    [
        ("jump of 1 m", lambda p, q: ((p[0], p[1] + 1.0, p[2]), q), " m from the command, limit 0.05 m"),
        (
            "jump of 90 degrees",
            lambda p, q: (p, turned(q, (0, 0, math.pi / 2))),
            " degrees from the command, limit 11.5",
        ),
        ("NaN", lambda p, q: ((math.nan, p[1], p[2]), q), "not finite"),
        ("no rotation", lambda p, _: (p, (0.0, 0.0, 0.0, 0.0)), "length 0.0000"),
        ("outside", lambda p, q: ((p[0], p[1], 1.7), q), "leaves the workspace"),
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_a_bad_target_holds_the_arm_with_the_reason(peer, robot, name, change, reason) -> None:
    (x, y, z), q = peer.pose()
    robot.ask("reset_stats")
    peer.stream(lambda t: ((x, y + 0.02 * (1 - math.cos(2 * t)), z), q), 0.6)
    peer.send(*change(*peer.pose()))
    peer.wait(lambda: reason in peer.latest["hold_reason"].data, 1.0, f"{name} refused")
    at = time.monotonic()
    peer.stream(lambda _: ((x, y + 0.02, z), q), 0.8)  # good targets do not move it any more
    motion = np.array(robot.ask("motion", since=at)["motion"])
    assert motion[-1, 4] < 1e-4
    assert np.linalg.norm(motion[-1, 1:4] - motion[0, 1:4]) < 0.01
    assert robot.ask("stats")["top_speed"] < 0.25


def test_an_old_target_and_a_foreign_frame_are_refused(peer) -> None:
    here = peer.pose()
    peer.hold(0.3)
    peer.send(*here, age=0.5)
    peer.wait(
        lambda: "0.5" in peer.latest["hold_reason"].data and "old" in peer.latest["hold_reason"].data, 1.0, "refusal"
    )
    assert peer.call("resend_robot_program").success
    peer.hold(0.3)
    peer.send(*here, frame="world")
    peer.wait(lambda: "frame 'world', must be 'base'" in peer.latest["hold_reason"].data, 1.0, "refusal")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda m: setattr(m.header.stamp, "sec", -1), " s old, limit 0.1 s"),
        (lambda m: setattr(m.header.stamp, "nanosec", 2**32 - 1), "ahead of this computer's clock"),
        (lambda m: setattr(m.header, "frame_id", "x" * 100_000), "must be 'base'"),
    ],
    ids=["before-1970", "nanoseconds-of-seconds", "endless-frame"],
)
def test_an_absurd_header_is_refused_as_any_other(peer, node, change, reason) -> None:
    peer.hold(0.3)
    message = PoseStamped()
    message.header.stamp, message.header.frame_id = peer.node.get_clock().now().to_msg(), "base"
    message.pose = peer.poses[-1][1].pose
    change(message)
    before = leftover_processes(node.pid)
    peer.targets.publish(message)
    peer.wait(lambda: reason in peer.latest["hold_reason"].data, 5.0, "refusal")
    assert node.poll() is None
    assert leftover_processes(node.pid) == before


def test_stop_holds_until_the_program_is_asked_for_again(peer, robot) -> None:
    (x, y, z), q = peer.pose()

    def path(t):
        return (x, y + 0.01 * (1 - math.cos(3 * t)), z), q

    peer.stream(path, 0.5)
    assert peer.call("stop").success
    assert peer.latest["hold_reason"].data == "stopped on request"
    peer.spin(0.3)
    before = place(robot)
    peer.hold(0.5)
    assert_allclose(place(robot), before, atol=1e-5)


def test_two_nodes_that_send_targets_at_once_have_the_arm_hold_and_are_named(peer, robot) -> None:
    (x, y, z), q = peer.pose()
    with Peer() as other:  # one that only could send is no matter
        other.wait(lambda: other.poses, 5.0, "pose")
        peer.hold(0.5)
        assert peer.latest["hold_reason"].data == ""
        until = time.monotonic() + 1.0
        while time.monotonic() < until:
            peer.send((x, y + 0.015, z), q)
            peer.spin(0.005)
            other.send((x, y - 0.015, z), q)
            peer.spin(0.005)
        told = "more than one node sends target_frame (/peer and /peer): end all but one"
        assert peer.latest["hold_reason"].data == told
        assert_allclose(place(robot), (x, y, z), atol=5e-3)
        assert peer.call("resend_robot_program").success  # while both go on, it holds again
        for _ in range(20):
            peer.send((x, y + 0.015, z), q)
            other.send((x, y - 0.015, z), q)
            peer.spin(0.01)
        assert peer.latest["hold_reason"].data == told
        assert_allclose(place(robot), (x, y, z), atol=5e-3)
    peer.spin(0.6)
    assert peer.call("resend_robot_program").success
    peer.hold(0.3)
    assert peer.latest["hold_reason"].data == ""


def test_wrench_is_given_in_the_tool_frame(peer, robot) -> None:
    robot.ask("wrench", wrench=[1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    peer.spin(0.3)
    message = peer.latest["wrench"]
    assert message.header.frame_id == "tool0"
    force, torque = message.wrench.force, message.wrench.torque
    assert_allclose((force.x, force.y, force.z, torque.x, torque.y, torque.z), (1, 2, 3, 0.1, 0.2, 0.3), atol=1e-6)
    assert peer.call("zero_ftsensor").success
    peer.spin(0.2)
    assert abs(peer.latest["wrench"].wrench.force.z) < 1e-6
    robot.ask("wrench", wrench=[0.0] * 6)
    assert peer.call("zero_ftsensor").success


def test_protective_stop_is_reported_unlocked_and_left_by_service_calls(peer, robot) -> None:
    robot.ask("protective_stop")
    peer.wait(lambda: not running(peer) and peer.latest["hold_reason"].data == "protective stop", 1.0, "report")
    peer.wait(lambda: peer.latest["safety_mode"].data == 3, 1.0, "safety mode")  # topics keep no common order
    refused = peer.call("resend_robot_program")
    assert not refused.success
    assert refused.message == "protective stop"
    peer.spin(0.4)
    assert peer.call("unlock_protective_stop").success
    peer.wait(lambda: peer.latest["hold_reason"].data == "waiting for the robot program", 1.0, "end of the stop")
    assert peer.call("resend_robot_program").success
    peer.wait(lambda: running(peer) and peer.latest["safety_mode"].data == 1, 1.0, "program running")


def test_unlocking_too_early_passes_on_what_the_robot_says(peer, robot) -> None:
    robot.ask("option", name="unlock_after", value=5.0)
    robot.ask("protective_stop")
    peer.wait(lambda: not running(peer), 1.0, "program not running")
    answer = peer.call("unlock_protective_stop")
    robot.ask("option", name="unlock_after", value=0.0)
    assert not answer.success
    assert "5s" in answer.message
    assert peer.call("unlock_protective_stop").success


def test_emergency_stop_needs_power_and_then_the_program(peer, robot) -> None:
    robot.ask("emergency_stop")
    peer.wait(lambda: "emergency stop" in peer.latest["hold_reason"].data, 1.0, "emergency stop named")
    robot.ask("release_emergency_stop")
    peer.wait(lambda: "powered off" in peer.latest["hold_reason"].data, 1.0, "power named")
    assert peer.call("power_on").success
    peer.spin(0.1)
    assert peer.call("resend_robot_program").success


def test_freedrive(peer, robot) -> None:
    assert peer.call("set_freedrive", SetBool, data=True).success
    assert robot.ask("state")["freedrive"] is True
    assert peer.call("set_freedrive", SetBool, data=False).success
    assert robot.ask("state")["freedrive"] is False


def test_the_end_of_a_freedrive_that_was_not_on_is_told_as_it_is(peer) -> None:
    answer = peer.call("set_freedrive", SetBool, data=False)
    assert (answer.success, answer.message) == (True, "was not in freedrive: the arm follows targets")
    assert peer.latest["hold_reason"].data == ""
    assert peer.call("stop").success
    answer = peer.call("set_freedrive", SetBool, data=False)
    assert (answer.success, answer.message) == (True, "was not in freedrive: the arm holds (stopped on request)")


def test_parameters_change_what_the_robot_does_or_are_refused(peer, robot) -> None:
    assert peer.set_parameter("payload_mass", 0.7) == (True, "")
    peer.spin(0.3)
    assert robot.ask("state")["payload"] == pytest.approx(0.7)
    refused = peer.set_parameter("servo_gain", 5000.0)
    assert refused[0] is False
    assert "servo_gain = 5000 must be within 100 and 2000" in refused[1]
    refused = peer.set_parameter("max_speed", 3.0)
    assert refused[0] is False
    assert "max_speed = 3 m/s must be within 0.001 and 1 m/s" in refused[1]
    refused = peer.set_parameter("max_jerk", 5.0)
    assert refused[0] is False
    assert "max_jerk = 5 m/s^3 with max_acceleration = 1 m/s^2" in refused[1]
    assert "robot_ip is fixed while the driver is configured" in peer.set_parameter("robot_ip", "127.0.0.1")[1]


def transit(peer: DriverPeer, *labels: str) -> None:
    for label in labels:
        assert peer.call("change_state", ChangeState, transition=Transition(label=label)).success


def test_recover_goes_from_a_safety_fault_to_an_arm_that_can_move_and_moves_nothing(peer, robot) -> None:
    before = place(robot)
    robot.ask("safety_fault")
    peer.wait(lambda: peer.latest["safety_mode"].data == 9, 2.0, "fault told")
    assert not peer.call("resend_robot_program").success
    answer = peer.call("recover")
    assert answer.success
    assert answer.message == "fault ended, power on, brake release; call resend_robot_program"
    peer.spin(0.3)
    assert not running(peer)
    assert_allclose(place(robot), before, atol=1e-3)
    robot.ask("safety_fault")
    assert peer.call("restart_safety").success
    assert robot.ask("state")["robot_mode"] == 3  # power is another request
    assert peer.call("recover").message == "power on, brake release; call resend_robot_program"


def test_safety_requests_without_a_stop_are_refused_and_the_arm_follows_on(peer, robot) -> None:
    peer.hold(0.3)
    for request, what in (("restart_safety", "restart"), ("unlock_protective_stop", "unlock")):
        refused = peer.call(request)
        assert (refused.success, refused.message) == (False, f"the safety system is NORMAL: nothing to {what}")
    assert robot.ask("state")["robot_mode"] == 7  # it has its power


@pytest.mark.parametrize("request_", ["recover", "unlock_protective_stop"])
def test_local_control_after_a_stop_is_named_before_the_program_is_asked_for(peer, robot, request_: str) -> None:
    robot.ask("protective_stop")
    peer.wait(lambda: peer.latest["hold_reason"].data == "protective stop", 1.0, "report")
    robot.ask("option", name="remote_control", value=False)
    try:
        peer.spin(0.4)
        answer = peer.call(request_)
        assert answer.success
        assert request_ != "recover" or "in local control: switch it to remote control" in answer.message
        words = "in local control: switch it to remote control on the pendant, then call resend_robot_program"
        peer.wait(lambda: words in peer.latest["hold_reason"].data, 3.0, "local control named")
    finally:
        robot.ask("option", name="remote_control", value=True)
    assert peer.call("resend_robot_program").success
    robot.ask("protective_stop")
    peer.spin(0.4)
    assert peer.call("recover").success
    peer.wait(lambda: peer.latest["hold_reason"].data == WAITING, 3.0, "no more than the program")


def test_recover_waits_for_a_protective_stop_to_be_unlocked_and_leaves_an_emergency_stop_to_people(peer, robot) -> None:
    robot.ask("protective_stop")
    assert peer.call("recover").message == "protective stop ended; call resend_robot_program"
    robot.ask("emergency_stop")
    answer = peer.call("recover")
    assert not answer.success
    assert answer.message == "the robot is in robot emergency stop: only a person at the arm can end that"


def test_a_stop_ends_a_recovery_that_waits_and_nothing_is_released_afterwards(peer, robot) -> None:
    robot.ask("option", name="unlock_after", value=60.0)
    try:
        robot.ask("protective_stop")
        client = peer.node.create_client(Trigger, "driver/recover")
        peer.wait(client.service_is_ready, 5.0, "recover")
        recovery = client.call_async(Trigger.Request())
        peer.spin(0.3)
        assert not recovery.done()
        peer.call("stop")
        peer.wait(recovery.done, 3.0, "the recovery's end")  # far less than the 10 s of its patience
        assert "given up: the arm was stopped" in recovery.result().message
    finally:
        robot.ask("option", name="unlock_after", value=0.3)


def test_the_tools_outputs_and_voltage_are_switched_and_seen_to_be(peer, robot) -> None:
    for on in True, False:
        assert peer.call("set_tool_output_1", SetBool, data=on).message == f"tool output 1 is {'on' if on else 'off'}"
        assert robot.ask("state")["tool_outputs"] == (2 if on else 0)
    assert peer.call("set_tool_power", SetBool, data=True).message == "the tool is supplied with 24 V"
    assert robot.ask("state")["tool_voltage"] == 24
    assert running(peer)  # it goes on beside
    robot.ask("option", name="remote_control", value=False)
    refused = peer.call("set_tool_power", SetBool, data=False)
    robot.ask("option", name="remote_control", value=True)
    assert not refused.success
    assert "does not supply 0 V at the tool: is it in local control?" in refused.message


def test_speed_scaling_is_published(peer, robot) -> None:
    robot.ask("option", name="speed_slider", value=0.5)
    peer.wait(lambda: peer.latest["speed_scaling"].data == 0.5, 2.0, "scaling told")
    robot.ask("option", name="speed_slider", value=1.0)
    peer.wait(lambda: peer.latest["speed_scaling"].data == 1.0, 2.0, "scaling told")


def test_what_is_fixed_can_be_changed_by_configuring_anew(peer) -> None:
    for frame in "world", "base":
        transit(peer, "deactivate")
        assert not peer.set_parameter("base_frame", frame)[0]  # the publishers have the other one
        transit(peer, "cleanup")
        assert peer.set_parameter("base_frame", frame)[0]
        peer.poses.clear()
        transit(peer, "configure", "activate")
        peer.wait(lambda: peer.latest["hold_reason"].data == WAITING and peer.poses, 20.0, "driver ready")
        assert peer.poses[-1][1].header.frame_id == frame


def test_a_call_that_waits_for_the_robot_is_answered_when_the_driver_is_deactivated(peer, robot) -> None:
    robot.ask("mute", seconds=1.0)
    unlock = peer.node.create_client(Trigger, "driver/unlock_protective_stop")
    assert unlock.wait_for_service(5.0)
    answer = unlock.call_async(Trigger.Request())
    peer.spin(0.05)
    transit(peer, "deactivate")
    peer.wait(answer.done, 5.0, "answer")
    assert not answer.result().success
    transit(peer, "activate")
    peer.wait(lambda: peer.latest["hold_reason"].data == WAITING, 20.0, "driver ready")
    here = peer.pose()
    peer.stream(lambda _: here, 0.5)
    assert not running(peer)  # a second activation starts nothing by itself
    assert peer.call("resend_robot_program").success


def test_the_servo_process_may_die_and_the_node_lives(peer, node) -> None:
    (child,) = leftover_processes(node.pid)
    os.kill(child, signal.SIGSEGV)
    peer.wait(lambda: not running(peer) and "died" in peer.latest["hold_reason"].data, 5.0, "death reported")
    assert node.poll() is None
    peer.wait(lambda: peer.latest["hold_reason"].data == WAITING, 10.0, "link back")
    assert peer.call("resend_robot_program").success


def test_wrench_rotation_is_the_inverse_of_the_flange(peer) -> None:
    """The conversion itself, on the pose that the robot has."""
    _, q = peer.pose()
    down = rotate(q, (0.0, 0.0, 1.0))
    assert down[2] < -0.99

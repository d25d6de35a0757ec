# SPDX-License-Identifier: Apache-2.0
"""The simulated cell as a real node: it follows good targets, holds on bad ones, and tells the truth."""

import base64
import re
import time
from collections.abc import Iterator
from errno import ENOSPC
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("pydrake", reason="needs Drake")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from seed_msgs.msg import RelativePose
from seed_msgs.srv import SetGripperWidth
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from seed_core.errors import SeedError
from seed_ros.conversions import pose_stamped, pose_to_matrix, seconds
from seed_ros.qos import COMMAND, LATCHED, QUEUE
from seed_ros.testing import Bench
from seed_sim.ros.node import SimNode
from seed_ur.kinematics import URKinematics

pytestmark = pytest.mark.ros
HANDS = Path(__file__).resolve().parents[2] / "seed_bringup" / "config" / "hands"


class World:
    """A client of the simulated cell."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.node = bench.add(SimNode, seed=3, target_timeout=1.0)
        self.poses: list[PoseStamped] = []
        self.truth: list[RelativePose] = []
        self.loads: list[WrenchStamped] = []
        client = bench.client
        self.target = client.create_publisher(PoseStamped, "target_frame", COMMAND)
        client.create_subscription(PoseStamped, "current_pose", self.poses.append, QUEUE)
        client.create_subscription(RelativePose, "sim/ground_truth/relative_pose", self.truth.append, QUEUE)
        client.create_subscription(WrenchStamped, "ft_sensor/wrench", self.loads.append, QUEUE)
        assert bench.until(lambda: self.poses and self.truth and self.loads)

    def flange(self) -> np.ndarray:
        return pose_to_matrix(self.poses[-1].pose)

    def send(self, X: np.ndarray, frame: str = "base", age: float = 0.0) -> None:
        now = self.bench.client.get_clock().now().nanoseconds * 1e-9
        self.target.publish(pose_stamped(X, now - age, frame))

    def trigger(self, name: str) -> Any:
        return self.bench.call(Trigger, f"sim/{name}", Trigger.Request())


@pytest.fixture
def world() -> Iterator[World]:
    bench = Bench()
    try:
        yield World(bench)
    finally:
        bench.close()


def test_the_arm_follows_targets_and_the_tool_is_carried_by_the_grasp_once_it_moves(world: World) -> None:
    assert not world.truth[-1].valid
    assert world.trigger("grasp").success
    assert world.bench.until(lambda: world.truth[-1].valid)
    assert abs(world.truth[-1].pose.pose.position.z) < 2e-5  # [m]: still in the holder
    start = world.flange()
    goal = start.copy()
    goal[2, 3] += 0.01

    def arrived() -> bool:
        world.send(goal)
        return abs(world.flange()[2, 3] - goal[2, 3]) < 1e-4

    assert world.bench.until(arrived)
    sag = 0.2 * 9.81 / 800.0  # [m] of 0.2 kg in a grasp of 800 N/m; z_C points down here
    assert world.bench.until(lambda: abs(world.truth[-1].pose.pose.position.z - sag) < 2e-4)
    assert world.bench.until(lambda: abs(world.loads[-1].wrench.force.z - 0.2 * 9.81) < 0.2)


@pytest.mark.parametrize("how", ["nan", "frame", "jump", "stale", "quaternion"])
def test_a_bad_target_is_refused_and_the_arm_holds(world: World, how: str) -> None:
    X = world.flange()
    words = {
        "nan": "not finite",
        "frame": "frame_id = 'world' is unknown here; known: base",
        "jump": "from the flange, limit 0.05 m",
        "stale": "s old, limit 1 s",
        "quaternion": "a unit quaternion",
    }
    before = X.copy()
    if how == "jump":
        X[0, 3] += 0.2
    X[2, 3] += 0.01
    message = pose_stamped(
        X, world.bench.client.get_clock().now().nanoseconds * 1e-9, "world" if how == "frame" else "base"
    )
    if how == "nan":
        message.pose.position.x = float("nan")
    if how == "quaternion":
        message.pose.orientation.w += 0.5
    if how == "stale":
        message.header.stamp.sec -= 10
    world.target.publish(message)
    assert world.bench.until(lambda: world.node.counters["targets_refused"] == 1)
    assert words[how] in world.node.counters.last
    world.bench.spin(0.2)
    np.testing.assert_allclose(world.flange(), before, atol=1e-6)


def test_after_a_refusal_the_arm_holds_until_it_is_asked(world: World) -> None:
    goal = world.flange()
    goal[2, 3] += 0.005
    far = goal.copy()
    far[0, 3] += 0.2

    def raised() -> bool:
        world.send(goal)
        return abs(world.flange()[2, 3] - goal[2, 3]) < 1e-4

    assert world.bench.until(raised)
    world.send(far)
    assert world.bench.until(lambda: "limit 0.05 m" in world.node.counters.last)
    held = world.flange()
    goal[2, 3] += 0.005
    for _ in range(20):
        world.send(goal)
        world.bench.turn()
    np.testing.assert_allclose(world.flange(), held, atol=1e-4)  # [m] it was this close to its goal when it held
    assert "not followed: target_frame is 0.2" in world.node.counters.last
    assert world.trigger("resend_robot_program").success
    assert world.bench.until(raised)


def test_an_arm_that_is_resumed_waits_for_its_first_target_and_tells_of_a_busy_computer(world: World) -> None:
    reasons: list[String] = []
    world.bench.client.create_subscription(String, "sim/hold_reason", reasons.append, LATCHED)
    goal = world.flange()
    goal[2, 3] += 0.005

    def raised() -> bool:
        world.send(goal)
        return abs(world.flange()[2, 3] - goal[2, 3]) < 1e-4

    assert world.bench.until(raised)
    world.node.time.factor = 0.71  # as measured on a busy machine
    world.node.time.measure = lambda _: False
    assert world.bench.until(lambda: reasons and reasons[-1].data, 5.0)
    assert reasons[-1].data == (
        "no target_frame for 1 s (this computer is busy: real-time factor 0.71; use_sim_time:=true lets simulated "
        "time wait)"
    )
    assert "enable the controller" in world.trigger("resend_robot_program").message
    world.bench.spin(1.5)  # longer than an arm waits that follows targets
    assert reasons[-1].data == ""
    goal[2, 3] += 0.005
    assert world.bench.until(raised)


def test_a_firmer_grip_is_stiffer_and_an_impossible_one_is_refused(world: World) -> None:
    before = np.array(world.node.plant.stiffness.translation)
    answer = world.bench.call(SetGripperWidth, "sim/set_gripper_width", SetGripperWidth.Request(width=0.015))
    assert answer.success
    assert answer.width == 0.015
    assert (np.array(world.node.plant.stiffness.translation) > before).all()
    refused = world.bench.call(SetGripperWidth, "sim/set_gripper_width", SetGripperWidth.Request(width=float("nan")))
    assert not refused.success
    assert "must be finite" in refused.message


@pytest.mark.parametrize("between", ["release", "reset"])
def test_a_tool_that_is_grasped_anew_at_once_is_told_by_invalid_poses(between: str) -> None:
    bench = Bench()
    try:
        node = bench.add(SimNode, seed=3, relative_pose=True)
        told: list[RelativePose] = []
        bench.client.create_subscription(RelativePose, "relative_pose", told.append, QUEUE)
        assert bench.call(Trigger, "sim/grasp", Trigger.Request()).success
        assert bench.until(lambda: told and told[-1].valid)
        told.clear()
        for service in (f"_{between}", "_grasp"):  # with no pose between the two
            getattr(node, service)()
        assert bench.until(lambda: told and told[-1].valid)
        assert sum(not p.valid for p in told) >= 10
        assert all("a new grasp is taken" in p.reason for p in told if not p.valid)
    finally:
        bench.close()


def test_services_in_the_wrong_state_say_so_and_reset_brings_back_the_start(world: World) -> None:
    assert world.trigger("grasp").success
    again = world.trigger("grasp")
    assert not again.success
    assert "release it first (sim/release; on the page: Release)" in again.message
    assert "start with the parameter replay" in world.trigger("save_replay").message
    assert world.trigger("reset").success
    assert world.bench.until(lambda: not world.truth[-1].valid)
    stamps = [p.header.stamp.sec + 1e-9 * p.header.stamp.nanosec for p in world.poses]
    assert stamps == sorted(stamps)  # time does not go back with the plant


def test_after_a_reset_the_arm_stays_though_it_is_sent_to_where_it_was_until_it_is_asked(world: World) -> None:
    start = world.flange()
    pressed = start.copy()
    pressed[2, 3] -= 0.035  # [m], tool on the table

    def lowered() -> bool:
        world.send(pressed)
        return abs(world.flange()[2, 3] - pressed[2, 3]) < 1e-4

    assert world.bench.until(lowered)
    world.bench.every.append(lambda: world.send(pressed))  # by a controller that has not heard of the reset yet
    assert world.trigger("reset").success
    world.bench.spin(0.3)
    np.testing.assert_allclose(world.flange(), start, atol=1e-6)
    assert "not followed: sim/reset has put it at its start; call sim/resend_robot_program" in world.node.counters.last
    world.bench.every.clear()
    world.bench.spin(0.1)
    assert world.trigger("resend_robot_program").success
    near = start.copy()
    near[2, 3] += 0.005

    def raised() -> bool:
        world.send(near)
        return abs(world.flange()[2, 3] - near[2, 3]) < 1e-4

    assert world.bench.until(raised)


def test_its_hold_reason_is_told_before_it_holds_and_its_joints_go_with_the_flange(world: World) -> None:
    reasons: list[String] = []
    joints: list[JointState] = []
    world.bench.client.create_subscription(String, "sim/hold_reason", reasons.append, LATCHED)
    world.bench.client.create_subscription(JointState, "joint_states", joints.append, QUEUE)
    assert world.bench.until(lambda: reasons and joints, 5.0)
    assert reasons[0].data == ""
    X_WE = URKinematics.for_model("ur5e").forward(np.array(joints[-1].position))
    np.testing.assert_allclose(X_WE, world.flange(), atol=1e-4)


def test_in_simulated_time_diagnostics_carry_it() -> None:
    bench = Bench()
    try:
        node = bench.add(SimNode, clock=True)
        stamps: list[tuple[float, float]] = []
        node.time.restart(time.monotonic(), 1000.0)
        bench.client.create_subscription(
            DiagnosticArray,
            "/diagnostics",
            lambda m: stamps.append((seconds(m.header.stamp), node.time.stamp)),
            QUEUE,
        )
        assert bench.until(lambda: stamps, 10.0)
        assert abs(stamps[0][0] - stamps[0][1]) < 1.0
        bench.spin(1.0)
        before = node.now()
        assert bench.call(Trigger, "sim/reset", Trigger.Request()).success
        assert before <= node.now() < before + 1.0  # the plant's time is zero again, and nobody's clock turns back
    finally:
        bench.close()


def recorded_seconds(file: Path) -> float:
    """How long the recording in a replay's page is [s]."""
    msgspec, zstandard = pytest.importorskip("msgspec"), pytest.importorskip("zstandard")
    found = re.search(r'__VISER_EMBED_DATA__="([^"]+)"', file.read_text())
    assert found
    packed = base64.b64decode(found[1])
    inner = zstandard.ZstdDecompressor().decompress(packed[8:], max_output_size=int.from_bytes(packed[:8], "little"))
    length = int.from_bytes(inner[:8], "little")
    return float(msgspec.msgpack.decode(inner[8 : 8 + length])["durationSeconds"])


def test_a_replay_is_written_again_with_all_since_the_start_and_on_exit(tmp_path: Path) -> None:
    file = tmp_path / "replay.html"
    bench = Bench()
    try:
        bench.add(SimNode, replay=str(file))
        bench.spin(1.5)
        assert bench.call(Trigger, "sim/save_replay", Trigger.Request()).success
        first = recorded_seconds(file)
        bench.spin(1.5)
        assert bench.call(Trigger, "sim/save_replay", Trigger.Request()).success
        second = recorded_seconds(file)
        assert second > first + 1.0
        bench.spin(1.5)
    finally:
        bench.close()
    assert recorded_seconds(file) > second + 1.0


def test_a_replay_that_cannot_be_written_again_leaves_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(file: Path, text: str, **_: Any) -> None:
        file.write_bytes(text[: len(text) // 2].encode())
        raise OSError(ENOSPC, "No space left on device")

    file = tmp_path / "replay.html"
    bench = Bench()
    try:
        bench.add(SimNode, replay=str(file))
        assert bench.call(Trigger, "sim/save_replay", Trigger.Request()).success
        before = file.read_bytes()
        with monkeypatch.context() as disk:
            disk.setattr(Path, "write_text", full)
            answer = bench.call(Trigger, "sim/save_replay", Trigger.Request())
        assert (answer.success, answer.message) == (False, f"{file}: No space left on device")
        assert file.read_bytes() == before
        assert [f.name for f in tmp_path.iterdir()] == ["replay.html"]
    finally:
        bench.close()


def test_a_replay_that_cannot_be_written_is_refused_at_the_start(tmp_path: Path) -> None:
    bench = Bench()
    try:
        with pytest.raises(SeedError, match="cannot be written"):
            bench.add(SimNode, replay=str(tmp_path / "none" / "replay.html"))
    finally:
        bench.close()


def test_a_cell_whose_controller_was_told_of_another_tool_does_not_start() -> None:
    bench = Bench()
    try:
        with pytest.raises(
            SeedError, match=r"the scenario 'pen' holds a 'pen' of 0.02 kg.*tells the controller of a 'squ"
        ):
            bench.add(SimNode, scenario="pen", hand_file=str(HANDS / "nominal.yaml"))
    finally:
        bench.close()


def test_a_grasp_tells_what_the_controller_was_told_wrong(tmp_path: Path) -> None:
    heavy = tmp_path / "heavy.yaml"
    heavy.write_text((HANDS / "nominal.yaml").read_text().replace("mass: 0.2", "mass: 0.5"))
    bench = Bench()
    try:
        bench.add(SimNode, hand_file=str(heavy))
        assert "mass 0.2 kg, told 0.5 kg" in bench.call(Trigger, "sim/grasp", Trigger.Request()).message
    finally:
        bench.close()


def test_two_nodes_that_send_targets_at_once_have_the_arm_hold_and_are_named(world: World) -> None:
    goal, other = world.flange(), world.flange()
    goal[2, 3] += 0.005
    other[2, 3] -= 0.005
    client = world.bench.client
    idle = client.create_publisher(PoseStamped, "target_frame", COMMAND)  # one that only could send

    def raised() -> bool:
        world.send(goal)
        return abs(world.flange()[2, 3] - goal[2, 3]) < 1e-4

    assert world.bench.until(raised)

    def both() -> bool:
        world.send(goal)
        now = client.get_clock().now().nanoseconds * 1e-9
        world.bench.turn()
        idle.publish(pose_stamped(other, now, "base"))
        return bool(world.node._latch.reason)

    assert world.bench.until(both)
    name = f"/{client.get_name()}"
    assert world.node._latch.reason == f"more than one node sends target_frame ({name} and {name}): end all but one"
    for _ in range(50):  # it comes to rest
        both()
    held = world.flange()
    for _ in range(20):
        both()
    np.testing.assert_allclose(world.flange(), held, atol=1e-4)
    world.bench.spin(0.6)  # the other one has ended
    assert world.trigger("resend_robot_program").success
    assert world.bench.until(raised)
    assert not world.node._latch.reason

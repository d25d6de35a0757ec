# SPDX-License-Identifier: Apache-2.0
"""The arm stops before it meets itself, the floor, a box or its own base's axis, says so, and may move away."""

import itertools
import math
from dataclasses import replace
from math import degrees
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from seed_core.arm.quaternion import IDENTITY, as_quaternion, to_pose, turned
from seed_core.config import ConfigError
from seed_core.vector3 import ZERO, as_vector3
from seed_driver.config import DriverConfig
from seed_driver.motion.clearances import Clearances
from seed_driver.motion.joint_speeds import JointSpeeds
from seed_driver.motion.limiter import CommandLimiter
from seed_driver.motion.overload import Overload
from seed_driver.motion.servo_motion import ServoMotion
from seed_driver.motion.stop_check import _Stop
from seed_driver.process.shared_memory import RobotState, SharedMemory, TargetSlot
from seed_ur import URKinematics
from seed_ur.capsules import HAND, JOINED

HAND_FILE = str(Path(__file__).parents[2] / "seed_bringup" / "config" / "hand.yaml")
DT = 0.002  # [s]
NUMBERS = itertools.count(1)  # of targets
READY = (math.pi, -1.7, 1.9, -1.8, -0.5 * math.pi, 0.0)  # [rad] the tool points down
FOLDED = (math.pi, -1.9, 2.5, -2.17, -0.5 * math.pi, 0.0)  # [rad] the hand is near the upper arm


class Run:
    """A motion from rest at joint angles q, with targets along a straight line."""

    def __init__(self, memory: SharedMemory, q=READY, **settings) -> None:
        self.config = DriverConfig(robot_ip="127.0.0.1", **{"hand_file": HAND_FILE, **settings})
        self.memory, self.arm, self.now = memory, URKinematics.for_model("ur5e"), 5.0
        self.motion = ServoMotion(memory, self.arm, self.config)
        X = self.arm.forward(q)
        self.p, self.q, self.joints = as_vector3(X[:3, 3]), as_quaternion(X[:3, :3]), [list(q)]
        self.motion.restart(RobotState()._replace(q=tuple(q), p=self.p, orientation=self.q))
        self.motion.accept_targets()

    def go(self, way=ZERO, turn=ZERO) -> str:
        """Targets to a place `way` [m] away, turned by `turn` [rad]; the reason it holds for, '' if it arrives."""
        (start, q), motion = self.motion.command, self.motion
        speed = 0.8 * self.config.max_speed
        steps = int(max(np.linalg.norm(way) / speed, np.linalg.norm(turn) / 0.4) / DT) + 400
        for i in range(1, steps + 1):
            share = min(1.0, i / (steps - 400))
            self.now += DT
            p, turned_by = np.array(start) + share * np.array(way), as_vector3(share * np.array(turn))
            slot = TargetSlot(next(NUMBERS), self.now, as_vector3(p), turned(q, turned_by))
            self.memory.write_target(slot)
            motion.take_target(self.now)
            motion.step()
            self.joints.append(self.arm.follow(to_pose(*motion.command), self.joints[-1]))
        assert np.abs(np.subtract(self.joints[-1], self.joints[-2])).max() < 1e-6
        return motion.latch.reason

    def flange(self) -> np.ndarray:
        return np.array([self.arm.forward(q)[:3, 3] for q in self.joints])


@pytest.fixture
def memory():
    made = SharedMemory.create()
    yield made
    made.close()


def gaps(run: Run, every: int = 10) -> dict[tuple[str, str], float]:
    """Smallest distance [m] of each pair of bodies in a run, by another way: least squares between both axes."""
    capsules = run.motion.stop_check.clearances._skeleton.capsules
    least: dict[tuple[str, str], float] = {}
    for q in run.joints[::every]:
        frames = np.concatenate((np.eye(4)[None], run.arm.frames(q), run.arm.forward(q)[None]))
        ends = [[(frames[c.frame] @ (*e, 1.0))[:3] for e in (c.start, c.end)] for c in capsules]
        for i, a in enumerate(capsules):
            for j, b in enumerate(capsules):
                if a.frame < b.frame and (a.frame, b.frame) not in JOINED:
                    (p, r), (s, t) = ends[i], ends[j]
                    best = lsq_linear(np.stack((r - p, s - t), axis=1), s - p, (0.0, 1.0), method="bvls")
                    gap = math.sqrt(2.0 * best.cost) - a.radius - b.radius
                    least[a.body, b.body] = min(gap, least.get((a.body, b.body), math.inf))
    return least


# the two motions that no check of before objected to, with the settings that every user gets
def test_the_flange_is_not_taken_into_the_axis_of_the_base(memory) -> None:
    run = Run(memory, (0.0, -1.0, 0.6, -1.17, -1.57, 0.0), hand_file="", self_check=False, max_joint_speed=3.0)
    reach = float(np.linalg.norm(run.p[:2]))
    towards = -(1.0 - 0.12 / reach) * np.array((run.p[0], run.p[1], 0.0))
    assert "of the base's axis, at least 0.15 m (min_radius)" in run.go(towards)
    radii = np.linalg.norm(run.flange()[:, :2], axis=1)
    assert 0.15 <= radii.min() < 0.17


@pytest.mark.parametrize("hand_file", [HAND_FILE, ""])
def test_the_flange_is_not_taken_below_the_floor(memory, hand_file: str) -> None:
    run = Run(memory, hand_file=hand_file, max_joint_speed=3.0)
    reason = run.go((0.0, 0.0, -0.25 - run.p[2]))
    body = "gripper" if hand_file else "wrist"
    assert f"the {body}" in reason
    assert "of the floor, at least 10 mm (clearance): call driver/resend_robot_program" in reason
    lowest = run.flange()[-1, 2]
    assert lowest == pytest.approx((0.09 + 0.075 if hand_file else 0.028) + 0.01, abs=0.002)
    # away from it, and to it again
    run.motion.accept_targets()
    assert run.go((0.0, 0.0, 0.1)) == ""
    assert "of the floor" in run.go((0.0, 0.0, -0.2))
    assert run.flange()[:, 2].min() == pytest.approx(lowest, abs=0.002)


def test_tool_and_fingers_work_on_the_floor(memory) -> None:
    """The tip reaches 5 mm into it, as it does where a table is soft or not quite where it was thought to be."""
    run = Run(memory)
    assert run.go((0.0, 0.0, 0.27 - 0.005 - run.p[2])) == ""
    assert run.go((0.0, 0.15, 0.0), (0.2, 0.0, 0.0)) == ""


@pytest.mark.parametrize(
    ("q", "way", "turn", "bodies"),
    [
        (FOLDED, (-0.2, 0.0, 0.1), ZERO, ("upper arm", "fingers")),
        (READY, ZERO, (0.0, 1.9, 0.0), ("upper arm", "tool")),
    ],
)
def test_the_arm_does_not_meet_itself(memory, q, way, turn, bodies) -> None:
    run = Run(memory, q, max_joint_speed=3.0, floor=False, min_radius=0.0)
    reason = run.go(way, turn)
    assert f"the {bodies[0]} would come within" in reason
    assert f"mm of the {bodies[1]}, at least 10 mm (clearance)" in reason
    found = gaps(run)
    assert 0.01 - 1e-4 <= min(found.values()) < 0.02
    assert min(found, key=found.__getitem__) == bodies
    # the same way without the check ends in itself
    unchecked = Run(memory, q, max_joint_speed=3.0, floor=False, min_radius=0.0, self_check=False)
    unchecked.go(way, turn)
    assert min(gaps(unchecked, every=50).values()) < 0.0


def box_file(tmp_path: Path, text: str) -> str:
    path = tmp_path / "surroundings.yaml"
    path.write_text(text)
    return str(path)


CUPBOARD = "boxes: [{name: cupboard, position: [0.85, 0.13, 0.3], size: [0.2, 0.6, 0.6], rpy_deg: [0, 0, 20]}]"


@pytest.mark.parametrize("speed", [0.05, 0.2, 0.6])
def test_a_box_is_not_met_at_any_speed(memory, tmp_path, speed: float) -> None:
    run = Run(memory, surroundings_file=box_file(tmp_path, CUPBOARD), max_speed=speed, max_joint_speed=3.0)
    reason = run.go((0.2, 0.0, 0.0))
    assert "of the cupboard, at least 10 mm" in reason
    assert 0.01 - 1e-4 <= from_box(run, (0.85, 0.13, 0.3), (0.2, 0.6, 0.6), 20.0) < 0.02


def from_box(run: Run, centre, size, yaw: float) -> float:
    """Smallest distance [m] of a run's bodies from a box turned by yaw [degrees], by points on their axes."""
    turn, shares, least = Rotation.from_euler("z", yaw, degrees=True).as_matrix(), np.linspace(0.0, 1.0, 200), math.inf
    for q in run.joints[::5]:
        frames = np.concatenate((np.eye(4)[None], run.arm.frames(q), run.arm.forward(q)[None]))
        for c in run.motion.stop_check.clearances._skeleton.capsules:
            start, end = ((frames[c.frame] @ (*e, 1.0))[:3] for e in (c.start, c.end))
            points = (start + np.outer(shares, end - start) - centre) @ turn
            outside = np.maximum(np.abs(points) - 0.5 * np.array(size), 0.0)
            least = min(least, float(np.linalg.norm(outside, axis=1).min()) - c.radius)
    return least


@pytest.mark.parametrize("way", [-0.02, 0.02])
def test_from_inside_a_box_no_way_is_followed(memory, tmp_path, way: float) -> None:
    """It is in the wrong place: the wrist cannot be there, and which way leads out is not known."""
    run = Run(memory)
    box = f"boxes: [{{name: cupboard, position: {list(run.p)}, size: [0.3, 0.3, 0.3]}}]"
    run = Run(memory, surroundings_file=box_file(tmp_path, box))
    assert "mm into the cupboard" in run.go((0.0, 0.0, way))
    assert run.motion.command[0] == pytest.approx(run.p, abs=1e-4)


def test_a_box_that_the_tool_may_touch_is_met_by_nothing_else(memory, tmp_path) -> None:
    table = "boxes: [{name: table, position: [0.6, 0, 0.1], size: [0.5, 1, 0.1], tool_may_touch: true}]"
    run = Run(memory, surroundings_file=box_file(tmp_path, table))
    assert run.go((0.1, 0.0, 0.15 + 0.27 - run.p[2])) == ""
    assert "the gripper would come" in run.go((0.0, 0.0, -0.12))


def test_what_stands_too_near_moves_away_and_no_nearer_however_slowly(memory) -> None:
    """A floor that is found to be 30 mm higher than it was."""
    run = Run(memory)
    assert "of the floor" in run.go((0.0, 0.0, -0.3))
    rest = run.motion.command[0][2]
    run = Run(memory, run.joints[-1], floor_height=0.03)
    for _ in range(3):
        assert "of the floor" in run.go((0.0, 0.0, -0.01)) or "into the floor" in run.motion.latch.reason
        run.motion.accept_targets()
    assert run.motion.command[0][2] == pytest.approx(rest, abs=5e-5)
    assert run.go((0.0, 0.0, 0.01)) == ""
    assert "of the floor" in run.go((0.0, 0.0, -0.01)) or "into the floor" in run.motion.latch.reason
    assert run.motion.command[0][2] == pytest.approx(rest + 0.01, abs=2e-3)


@pytest.mark.parametrize("q", [(0.0, -2.4, -0.1, -0.5, -0.1, 0.0), (0.0, -0.8, 0.1, -0.5, -0.1, 0.0)])
def test_where_a_branch_ends_the_arm_stops_and_is_not_judged_by_another_branch(memory, q) -> None:
    """The flange goes outwards: once the elbow is straight it could go on only with shoulder and wrist turned over."""
    run = Run(memory, q, max_speed=0.75, max_acceleration=2.0, max_joint_speed=2.0)
    outwards = np.array(run.p) - (0.0, 0.0, 0.16)
    reason = run.go(tuple(0.1 * outwards / np.linalg.norm(outwards)))
    assert "out of reach of the ur5e as the arm is bent, shoulder_pan_joint would have to jump by 15" in reason
    assert "degrees, at most 29: call driver/resend_robot_program" in reason
    assert np.abs(np.diff(run.joints, axis=0)).max() <= 2.0 * DT
    assert abs(run.joints[-1][2]) < abs(q[2])
    # back is free
    run.motion.accept_targets()
    assert run.go(tuple(-0.05 * outwards / np.linalg.norm(outwards))) == ""


def test_a_stop_that_turns_longer_than_it_moves_is_looked_at_where_its_way_bends(memory) -> None:
    """Moving ends before turning: the pose between both is one that is looked at."""
    run = Run(memory, max_acceleration=4.0, max_angular_acceleration=2.0)
    limiter = run.motion.limiter
    limiter.velocity, limiter.angular_velocity = (0.2, 0.0, 0.0), (0.0, 0.0, 0.3)  # at rest after 0.05 s and 0.15 s
    bent = 3.0 * DT + 0.05
    for fine in (False, True):
        stop = _Stop(limiter)
        times = stop.times(fine)
        assert any(math.isclose(t, bent) for t in times)
        assert times == sorted(times)
        assert times[-1] == pytest.approx(3.0 * DT + 0.15)
        assert stop.pose(bent)[0] == pytest.approx(stop.pose(times[-1])[0])


@pytest.mark.parametrize(("bound", "side"), [("joint_high", 1.0), ("joint_low", -1.0)])
def test_joints_keep_to_their_ranges(memory, bound: str, side: float) -> None:
    run = Run(memory, **{bound: (*[side * math.tau] * 5, side * 0.3)})
    reason = run.go(turn=(0.0, 0.0, -side * 0.8))
    assert f"wrist_3_joint would turn to {side * 17.3:.0f}" in reason
    assert f"beyond {bound} = {side * 0.3:g} rad ({degrees(side * 0.3):.1f} degrees)" in reason
    assert 0.28 < (side * np.array(run.joints)[:, 5]).max() <= 0.3
    run.motion.accept_targets()
    assert run.go(turn=(0.0, 0.0, side * 0.5)) == ""


def test_nothing_that_the_tasks_do_is_too_near() -> None:
    """The simulated table, 0.5 m by 0.4 m in front of the arm, with a tool upright or leaning by 15 degrees."""
    for hand in (HAND_FILE, ""):
        arm = URKinematics.for_model("ur5e")
        clearances = Clearances(arm, DriverConfig(robot_ip="127.0.0.1", hand_file=hand))
        joints = []
        for x in (0.35, 0.45, 0.6):
            for y in (-0.2, 0.0, 0.2):
                for z in (0.23, 0.27, 0.4):
                    for lean in ((0.0, 0.0), (0.26, 0.0), (-0.26, 0.0), (0.0, 0.26), (0.0, -0.26)):
                        down = turned(turned(IDENTITY, (math.pi, 0.0, 0.0)), (*lean, 0.0))
                        joints.append(arm.inverse(to_pose((x, y, z), down), READY))
        assert clearances.values(joints).min() > 0.0


def test_a_look_is_skipped_only_where_nothing_can_come_too_near(memory) -> None:
    """With and without skipped looks the arm stops at the same place, within what one step is worth."""
    rests = []
    for most in (10, 0):
        run = Run(memory)
        run.motion.stop_check.most_steps = most
        assert "of the floor" in run.go((0.05, 0.0, -0.3))
        rests.append(run.motion.command[0])
    assert math.dist(*rests) < 2e-4


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("boxes: [{name: a, size: [1, 1, 1]}]", r"'boxes\[0\].position' is missing"),
        (
            "boxes: [{name: a, position: [0, 0, 0], size: [1, 0, 1]}]",
            r"boxes\[0\].size\[1\] = 0 m must be within 0.001",
        ),
        ("boxes: [{name: '', position: [0, 0, 0], size: [1, 1, 1]}]", "a box has no name"),
        ("planes: [{name: wall, point: [0, 0, 0], normal: [0, 0, 0]}]", "the normal of plane 'wall'"),
        ("planes: [{name: wall, point: [.nan, 0, 0], normal: [0, 0, 1]}]", "must be finite"),
        ("parts: [{name: cable, start: [0, 0, 0], end: [0, 0, 0.1], radius: -1}]", r"radius = -1 m must be within"),
        ("walls: []", "unknown key 'walls'; known here: boxes, planes, parts"),
        ("boxes: 3", "boxes must be a list"),
        ("[", "not readable as YAML"),
    ],
)
def test_a_wrong_file_is_refused_with_its_place(tmp_path, text: str, words: str) -> None:
    path = box_file(tmp_path, text)
    with pytest.raises(ConfigError, match=words) as told:
        Clearances(URKinematics.for_model("ur5e"), DriverConfig(robot_ip="x", surroundings_file=path))
    assert "surroundings.yaml" in str(told.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "hand_file = .* cannot be read"),
        ("hand: {}", "has no 'hand' under ros__parameters"),
        ("/**: {ros__parameters: {hand: 3}}", "hand = 3 must be a mapping"),
        ("/**: {ros__parameters: {hand: {E_C: {position: [0, 0]}}}}", "E_C.position has 2 values; it needs 3"),
    ],
)
def test_a_wrong_hand_is_refused(tmp_path, text: str | None, words: str) -> None:
    path = tmp_path / "hand.yaml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ConfigError, match=words):
        Clearances(URKinematics.for_model("ur5e"), DriverConfig(robot_ip="x", hand_file=str(path)))


def test_every_row_is_named_and_falls_no_faster_than_it_is_said_to() -> None:
    """Rates of the rows against differences of their values, in random poses."""
    arm, rng = URKinematics.for_model("ur5e"), np.random.default_rng(5)
    clearances = Clearances(arm, DriverConfig(robot_ip="x", hand_file=HAND_FILE))
    assert {c.frame for c in clearances._skeleton.capsules} == {*range(7), HAND}
    for _ in range(100):
        q = rng.uniform(-3.0, 3.0, 6)
        turn = 1e-4 * rng.choice((-1.0, 1.0), 6)
        before, after = clearances.values([q, q + turn])
        assert (np.abs(after - before) <= clearances.rates @ np.abs(turn) + 1e-9).all()
        for row in range(len(before)):
            assert clearances.words(row, before[row])


def test_standing_still_is_no_reason() -> None:
    arm = URKinematics.for_model("ur5e")
    X = arm.forward(READY)
    limiter = CommandLimiter(as_vector3(X[:3, 3]), as_quaternion(X[:3, :3]), DT, DriverConfig(robot_ip="x"))
    memory = SharedMemory.create()
    motion = ServoMotion(memory, arm, DriverConfig(robot_ip="x", floor_height=1.0))
    assert motion.stop_check.check(limiter, READY) == ""
    memory.close()


# the wrench that the arm reads
def test_a_reading_beyond_the_limit_holds_after_its_time_and_lets_go_by_itself_only_when_asked(memory) -> None:
    run = Run(memory)
    assert run.go((0.0, 0.02, 0.0)) == ""
    pressing, gentle = (0.0, 0.0, -130.0, 0.0, 0.0, 0.0), (0.0, 0.0, -10.0, 0.0, 0.0, 0.0)
    run.motion.feel(pressing, 10.0)
    run.motion.feel(gentle, 10.04)
    run.motion.feel(pressing, 10.06)
    assert run.motion.latch.reason == ""  # never for 0.05 s on end
    run.motion.feel(pressing, 10.12)
    assert "the arm reads 130 N at its tool, beyond max_arm_force = 100 N" in run.motion.latch.reason
    run.motion.accept_targets()
    for i in range(100):
        run.motion.feel((0.0, 0.0, -135.0, 0.0, 0.0, 0.0), 11.0 + 0.002 * i)
    assert run.motion.latch.reason == ""  # it may be freed
    for i in range(100):
        run.motion.feel((0.0, 0.0, -150.0, 0.0, 0.0, 0.0), 12.0 + 0.002 * i)
    assert "150 N" in run.motion.latch.reason


def test_changed_clearances_and_a_changed_limit_of_the_force_count_at_once(memory) -> None:
    run = Run(memory, overload_time=0.0)
    assert run.go((0.0, 0.0, -0.02)) == ""
    floor = run.flange()[-1, 2] - 0.09 - 0.075 - 0.02  # [m] 2 cm below the gripper
    run.motion.configure(replace(run.config, floor_height=floor, max_arm_force=20.0))
    assert "of the floor, at least 10 mm" in run.go((0.0, 0.0, -0.02))
    run.motion.accept_targets()
    run.motion.feel((0.0, 0.0, -25.0, 0.0, 0.0, 0.0), 10.0)
    assert "max_arm_force = 20 N" in run.motion.latch.reason


def test_a_torque_and_what_is_no_number_count_as_too_much() -> None:
    overload = Overload(DriverConfig(robot_ip="x", overload_time=0.0))
    assert "25.0 N m at its tool, beyond max_arm_torque = 20 N m" in overload.update((0.0,) * 5 + (25.0,), 1.0)
    assert overload.update((math.nan,) * 6, 2.0)
    assert overload.update((0.0,) * 6, 3.0) == ""


def test_an_arm_that_is_freed_may_read_too_much_only_until_it_has_been_within_the_limit() -> None:
    overload = Overload(DriverConfig(robot_ip="x", overload_time=0.0))

    def read(torque: float) -> str:
        return overload.update((0.0,) * 5 + (torque,), 1.0)

    assert read(19.0) == ""
    assert read(25.0)
    overload.forgive()
    assert read(27.0) == ""
    assert read(19.0) == ""
    assert "27.0 N m" in read(27.0)


def test_ranges_must_have_room() -> None:
    with pytest.raises(ConfigError, match=r"joint_low\[2\] = 1 rad must be below joint_high\[2\] = 1 rad"):
        DriverConfig(robot_ip="x", joint_low=(-1.0, -1.0, 1.0, 0.0, 0.0, 0.0), joint_high=(1.0,) * 6)


def test_the_first_step_after_a_restart_is_looked_at_however_slow_the_last_was() -> None:
    arm = URKinematics.for_model("ur5e")
    X, joints = arm.forward(READY), JointSpeeds(arm, 0.5)
    limiter = CommandLimiter(as_vector3(X[:3, 3]), as_quaternion(X[:3, :3]), DT, DriverConfig(robot_ip="x"))
    joints.restart(READY)
    limiter.velocity = (1e-4, 0.0, 0.0)
    joints.limit(limiter)
    joints.restart(READY)
    limiter.velocity = (5.0, 0.0, 0.0)
    joints.limit(limiter)
    assert limiter.velocity[0] < 1.0

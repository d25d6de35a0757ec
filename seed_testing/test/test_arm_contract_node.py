# SPDX-License-Identifier: Apache-2.0
"""Our driver keeps the contract of an arm, and the check can tell an arm that does not."""

import json
import math
import re
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed")
pytest.importorskip("tf2_msgs", reason="the workspace is not built (./seed test does it)")
pytest.importorskip("rtde_control", reason="ur_rtde is not installed (pip install ur-rtde==1.6.5)")

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from seed_bringup.launching.launcher import Launch
from seed_core.config import ConfigError
from seed_core.errors import FailedError
from seed_driver.ros.target_guard import GuardNode
from seed_testing import arm_contract, contract_clauses
from seed_testing.contract_clauses import Found, Limits
from seed_testing.peer import Peer
from seed_ur.standin_client import StandIn

ROOT = Path(__file__).resolve().parents[2]
pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.realtime]  # half a minute of motion
PATIENT = Limits(pose_rate=50.0, pose_age=0.2, stop_within=0.9)  # a test machine may be loaded


def test_our_driver_keeps_every_clause() -> None:
    with StandIn() as robot:
        command = [sys.executable, "-m", "seed_driver.ros.node", "--ros-args", "-p", f"robot_ip:={robot.host}"]
        node = subprocess.Popen(command)
        try:
            verdicts = arm_contract.run("driver", PATIENT)
        finally:
            node.terminate()
            node.wait(10.0)
    assert [v for v in verdicts if not v.kept] == []
    assert len(verdicts) == 10


class Reckless(Node):
    """An arm that goes wherever it is told, at once."""

    def __init__(self, context: rclpy.Context, listens_to: str) -> None:
        super().__init__("reckless", context=context)
        self.at = PoseStamped()
        self.at.header.frame_id = "base"
        self.at.pose.orientation.w = 1.0
        self.poses = self.create_publisher(PoseStamped, "current_pose", 10)
        self.create_subscription(PoseStamped, listens_to, self.obey, 1)
        self.create_timer(0.005, self.tell)

    def obey(self, message: PoseStamped) -> None:
        if math.isfinite(message.pose.position.z):
            self.at.pose = message.pose

    def tell(self) -> None:
        self.at.header.stamp = self.get_clock().now().to_msg()
        self.poses.publish(self.at)


class Limited(Reckless):
    """An arm that goes to every target that is a number, slowly enough, and stands 0.1 s after the last."""

    goal, heard = np.zeros(3), 0.0

    def obey(self, message: PoseStamped) -> None:
        p = message.pose.position
        if math.isfinite(p.z):
            self.goal, self.heard = np.array((p.x, p.y, p.z)), time.monotonic()

    def tell(self) -> None:
        p = self.at.pose.position
        if time.monotonic() < self.heard + 0.1:
            way = self.goal - (p.x, p.y, p.z)
            p.x, p.y, p.z = (p.x, p.y, p.z) + way * min(1.0, 0.249 * 0.005 / max(np.linalg.norm(way), 1e-9))
        super().tell()


@contextmanager
def reckless_arm(listens_to: str, kind: type[Reckless] = Reckless):
    context = rclpy.Context()
    rclpy.init(context=context)
    arm = kind(context, listens_to)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(arm)
    ended = threading.Event()

    def spin() -> None:
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.1)

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    try:
        yield context
    finally:
        ended.set()
        thread.join(5.0)
        rclpy.shutdown(context=context)


def test_an_arm_that_obeys_everything_is_found_out() -> None:
    clauses = [
        contract_clauses.targets_are_reached,
        contract_clauses.jumps_are_refused,
        contract_clauses.old_targets_are_refused,
        contract_clauses.foreign_frames_are_refused,
        contract_clauses.after_silence_nothing_moves_unasked,
    ]
    with reckless_arm("target_frame"):
        found = arm_contract.run("reckless", PATIENT._replace(enable=""), clauses)
    lines = {v.clause: arm_contract.line(v) for v in found}
    assert re.match(
        r"BROKEN  jumps are refused +coasted \d+\.\d\d mm, then moved .*  "
        r"\(bound: at most 8\.95 mm, below 0\.300 mm from 0\.9 s on, at most 0\.275 m/s\)$",
        lines["jumps are refused"],
    )
    assert lines["targets are reached"].endswith("(bound: at most 1.00 mm and 0.573 degrees)")
    verdicts = {v.clause: v.kept for v in found}
    assert verdicts["targets are reached"]
    assert verdicts["jumps are refused"] is False
    assert verdicts["old targets are refused"] is False
    assert verdicts["foreign frames are refused"] is False
    assert verdicts["after silence nothing moves unasked"] is False


def test_an_arm_that_only_goes_slowly_after_a_jump_or_leaves_a_nan_out_does_not_hold() -> None:
    """It stops in silence alone: a jump leads it on at a speed that is allowed, and after a NaN its path does."""
    clauses = [
        contract_clauses.silence_stops_the_arm,
        contract_clauses.jumps_are_refused,
        contract_clauses.not_a_number_is_refused,
    ]
    with reckless_arm("target_frame", Limited):
        found = arm_contract.run("reckless", PATIENT._replace(enable=""), clauses)
    silence, jump, nan = found
    assert silence.kept, silence
    assert jump.kept is False, jump
    assert nan.kept is False, nan
    coasted = float(re.findall(r"coasted (\S+) mm", jump.found)[0])
    assert 9.0 < coasted < 60.0  # of a metre: an arm that obeys is not led on


def stalled(peer: Peer, limits: Limits) -> Found:
    """A clause during which this program sends no target for 0.2 s."""
    (x, y, z), q = peer.pose()

    def path(t: float) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
        if t > 0.1:
            time.sleep(0.2)
        return (x, y, z), q

    peer.stream(path, 0.15)
    return Found(peer.poses[-1][1].header.frame_id != "base", "the arm held", f"below {limits.lag:g} s")


def test_a_check_that_was_late_itself_does_not_blame_the_arm(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(arm_contract, "CLAUSES", (stalled, contract_clauses.poses_are_in_the_base_frame))
    words = ["--arm", "reckless", "--enable", ""]
    with reckless_arm("target_frame"):
        assert arm_contract.main(words) == 1
        told = capsys.readouterr()
        assert arm_contract.main([*words, "--json"]) == 1
        plain = json.loads(capsys.readouterr().out)["clauses"]
    late, kept = told.out.splitlines()
    assert late.startswith("open    stalled  ")
    assert re.search(r"too busy to tell: the check itself was late by [2-9]\d\d ms \(at most 50 ms\), 4 times", late)
    assert late.endswith("the arm held  (bound: below 0.2 s)")
    assert kept.startswith("kept    poses are in the base frame ")
    assert "say nothing of the arm" in told.err
    assert [clause["kept"] for clause in plain] == [None, True]


def test_the_guard_refuses_a_limit_that_it_does_not_have() -> None:
    with reckless_arm("guarded_frame") as context, pytest.raises(ConfigError, match="'max_sped'; did you mean max_spe"):
        GuardNode(context=context, parameter_overrides=[Parameter("max_sped", value=0.1)])


def test_the_guard_makes_it_keep_the_contract() -> None:
    guard = subprocess.Popen([sys.executable, "-m", "seed_driver.ros.target_guard"])
    try:
        with reckless_arm("guarded_frame"):
            verdicts = arm_contract.run("guard", PATIENT)
    finally:
        guard.terminate()
        guard.wait(10.0)
    assert [v for v in verdicts if not v.kept] == []
    assert len(verdicts) == 10


@pytest.mark.skipif(not (ROOT / "seed").is_file(), reason="this is an installed copy, not the checkout")
def test_the_arm_of_the_tutorial_keeps_the_contract_behind_the_guard(tmp_path: Path) -> None:
    """As the page has it: its arm, a copy of its launch file with the limits that it begins with, its topics."""
    page = (ROOT / "docs/tutorials/own_arm.md").read_text()
    (code,) = re.findall(r'^```python title="my_arm.py"\n(.*?)^```', page, re.MULTILINE | re.DOTALL)
    limits = "\n".join(re.findall(r"^ +(<param name=.*/>)$", page, re.MULTILINE))
    launch, arm = tmp_path / "mine_launch.xml", tmp_path / "my_arm.py"
    base = '<param name="base_frame" value="$(var base)" type="str"/>'
    given = (ROOT / "seed_bringup/launch/own_arm_launch.xml").read_text()
    assert base in given
    assert limits.count("<param") == 2
    launch.write_text(given.replace(base, base + limits))
    arm.write_text(code)
    said: list[str] = []
    topics = {"base": "fr3_link0", "arm_target": "/fr3/target", "arm_pose": "/fr3/pose"}
    node = subprocess.Popen([sys.executable, str(arm)])
    try:
        with Launch(launch, topics, output=lambda label, line: said.append(f"[{label}] {line}")):
            verdicts = arm_contract.run("guard", PATIENT, base="fr3_link0", current_pose="/fr3/pose")
    finally:
        node.terminate()
        node.wait(10.0)
    assert [v for v in verdicts if not v.kept] == [], said
    assert len(verdicts) == 10


def test_a_topic_on_which_nothing_comes_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arm_contract, "FIRST", 0.2)
    with pytest.raises(FailedError, match=r"a first pose on /fr3/pose .--current-pose names another.: not within"):
        arm_contract.run("guard", PATIENT, current_pose="/fr3/pose")

# SPDX-License-Identifier: Apache-2.0
"""A bag of a hand that was turned with a known tool in it gives the stiffness of the grasp, or says what is missing."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from rclpy.serialization import serialize_message
from std_msgs.msg import Float32, Float64

from seed_bringup import identify
from seed_bringup.bags import qos
from seed_bringup.bags.files import BagWriter
from seed_core.bushing import Bushing, Stiffness
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Hand, weight_about_T
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, rotation_from_rpy
from seed_core.stiffness_file import load_stiffness
from seed_ros.conversions import estimate_to_message, pose_stamped
from seed_ros.qos import SENSOR
from seed_sysid.fit.weight import ORIENTATIONS_DEG

pytestmark = pytest.mark.ros

K = Stiffness(rotation=(2.0, 1.0, 1.5), translation=(700.0, 1100.0, 900.0))
MASS, CENTER = 0.4, (0.03, 0.01, 0.05)
HAND_FILE = """
/**:
  ros__parameters:
    hand: {name: my_hand}
    tool: {name: weight, mass: 0.4, center_of_mass: [0.03, 0.01, 0.05]}
"""
START, REST, DT = 1_700_000_000.0, 2.0, 0.05  # [s]


def held(R_WC: Array) -> Array:
    """X_CT of the tool that hangs in the spring with the hand at R_WC."""
    X_TC = np.eye(4)
    for _ in range(50):
        load = weight_about_T(MASS, CENTER, R_WC @ inverse_pose(X_TC)[:3, :3])
        X_TC = Bushing(K).pose(Wrench.zero().minus(load))
    return inverse_pose(X_TC)


def write_bag(path: Path, prefixes: tuple[str, ...] = ("",), poses: bool = True) -> Path:
    """The arm of each cell rests in every orientation, one after the other, with images unless `poses` is False."""
    with BagWriter(path) as writer:
        topics: dict[str, Any] = {}

        def put(topic: str, kind: str, message: Any, t: float) -> None:
            if topic not in topics:
                topics[topic] = writer.add_topic(topic, kind, [qos.for_bag(SENSOR)])
            writer.write(topics[topic], round(t * 1e9), serialize_message(message))

        for i, attitude in enumerate(ORIENTATIONS_DEG):
            R_WC = rotation_from_rpy(np.deg2rad([*attitude, 0.0]))
            X_CT = held(R_WC)
            for t in START + REST * i + np.arange(0.0, REST, DT):
                for prefix in prefixes:
                    arm = pose_stamped(make_pose(R_WC @ Hand().X_EC[:3, :3].T, (0.4, 0.0, 0.4)), t, "base")
                    put(f"{prefix}/current_pose", "geometry_msgs/msg/PoseStamped", arm, t)
                    tool = estimate_to_message(RelativePoseEstimate(t, X_CT), "compliance", "tool")
                    name = "relative_pose" if poses else "sim/ground_truth/relative_pose"
                    put(f"{prefix}/{name}", "seed_msgs/msg/RelativePose", tool, t)
                    put(f"{prefix}/gripper/width", "std_msgs/msg/Float64", Float64(data=0.02), t)
                    put(f"{prefix}/bubble_left/pressure", "std_msgs/msg/Float32", Float32(data=1031.0), t)
                    put(f"{prefix}/bubble_right/pressure", "std_msgs/msg/Float32", Float32(data=1033.0), t)
    return path


@pytest.fixture
def hand(tmp_path: Path) -> str:
    (tmp_path / "my hand.yaml").write_text(HAND_FILE, encoding="utf-8")
    return str(tmp_path / "my hand.yaml")


def run(*arguments: object) -> int:
    return identify.main(["--procedure", "weight", *map(str, arguments)])


def test_a_recording_gives_a_stiffness_that_the_controller_loads(
    tmp_path: Path, hand: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, out = write_bag(tmp_path / "a bag"), tmp_path / "the results"
    assert run("--from", bag, "--hand", hand, "--out", out) == 0
    said = capsys.readouterr().out
    assert "by the weight of 'weight', 0.4 kg, in 10 attitudes" in said
    file = load_stiffness(out / "stiffness.yaml")
    (grip,) = file.grips
    np.testing.assert_allclose(grip.stiffness.vector(), K.vector(), rtol=1e-3)
    assert (file.hand, file.tool) == ("my_hand", "weight")
    assert (grip.width_m, grip.pressure_hpa) == pytest.approx((0.02, 1032.0))
    assert sorted(f.name for f in out.iterdir()) == ["stiffness.yaml", "summary.json", "weight.svg"]
    assert run("--from", bag, "--hand", hand, "--json") == 0
    assert json.loads(capsys.readouterr().out)["undetermined"] == {}


def test_what_a_recording_lacks_is_named(tmp_path: Path, hand: str, capsys: pytest.CaptureFixture[str]) -> None:
    for bag, told in (
        (write_bag(tmp_path / "truth", poses=False), "has no topic relative_pose; record one cell: ./seed bag record"),
        (write_bag(tmp_path / "two", ("/left", "/right")), "several cells: /left/current_pose, /right/current_pose"),
        (tmp_path / "none", "not a readable bag"),
    ):
        assert run("--from", bag, "--hand", hand) == 2
        assert told in capsys.readouterr().err
    assert run("--from", tmp_path / "two") == 2
    assert "wants --hand" in capsys.readouterr().err
    assert run("--from", tmp_path / "two", "--hand", hand, "--seed", 3) == 2
    assert "leave --seed out" in capsys.readouterr().err
    assert identify.main(["--from", str(tmp_path / "two"), "--hand", hand]) == 2
    assert "leave --hand out" in capsys.readouterr().err

# SPDX-License-Identifier: Apache-2.0
"""A bag of rendered images, played into a fresh estimator, gives the poses that the bag's own truth says."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("seed_sim.tactile", reason="needs the renderer of seed_sim")

from rclpy.serialization import serialize_message
from seed_msgs.msg import RelativePose
from std_srvs.srv import Trigger

from seed_bringup.bags import qos
from seed_bringup.bags.files import BagWriter
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Hand
from seed_core.spatial import pose_from_rpy, rotation_error
from seed_estimation.ros.node import EstimatorNode
from seed_ros.conversions import estimate_to_message, pose_to_matrix, seconds
from seed_ros.images import Intrinsics, camera_info
from seed_ros.images.arrays import image_message
from seed_ros.qos import COMMAND, SENSOR
from seed_ros.testing import Bench
from seed_sim import tactile
from seed_testing.validation import command as validate

pytestmark = pytest.mark.ros

PERIOD = 0.08  # [s]: leaves time to a busy test machine
START = 1_700_000_000.0  # [s]
TRUTH = "/sim/ground_truth/relative_pose"


def motion(share: float) -> np.ndarray:
    """There and back over all axes."""
    s = np.sin(np.pi * share)
    return pose_from_rpy(np.deg2rad([3.0 * s, -5.0 * s, 3.0 * s]), [1e-3 * s, 4e-4 * s, 2e-3 * s])


def write_bag(path: Path, renderer: Any, start: float, poses: list[np.ndarray | None]) -> Path:
    """Images of both fingers and the truth, one set per pose; None: nothing grasped."""
    with BagWriter(path) as writer:
        topics: dict[str, Any] = {}

        def put(topic: str, kind: str, message: Any, t: float, profile: Any) -> None:
            if topic not in topics:
                topics[topic] = writer.add_topic(topic, kind, [qos.for_bag(profile)])
            writer.write(topics[topic], round(t * 1e9), serialize_message(message))

        for i, X in enumerate(poses):
            t = start + i * PERIOD
            images = renderer.no_contact(t) if X is None else renderer.render(X, t)
            truth = RelativePoseEstimate(t, np.eye(4) if X is None else X, valid=X is not None)
            put(TRUTH, "seed_msgs/msg/RelativePose", estimate_to_message(truth, "compliance", "tool"), t, COMMAND)
            for finger, pair in images.items():
                c, frame, bubble = renderer.cameras[finger], f"bubble_{finger}_optical", f"/bubble_{finger}"
                info = camera_info(Intrinsics(c.width, c.height, list(c.K.ravel()), list(c.D), c.model), t, frame)
                put(f"{bubble}/depth/camera_info", "sensor_msgs/msg/CameraInfo", info, t, SENSOR)
                counts = np.clip(np.rint(pair.ir), 0, 65535).astype(np.uint16)
                depth = image_message(pair.depth, "32FC1", t, frame)
                put(f"{bubble}/depth/image_rect_raw", "sensor_msgs/msg/Image", depth, t, SENSOR)
                put(
                    f"{bubble}/ir/image_rect_raw",
                    "sensor_msgs/msg/Image",
                    image_message(counts, "mono16", t, frame),
                    t,
                    SENSOR,
                )
    return path


def play(bag: Path, *arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-P", "-m", "seed_bringup.commands.bag", "play", str(bag), *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL)


@pytest.mark.realtime
@pytest.mark.slow  # three recordings are played in real time
def test_played_images_give_the_poses_of_the_bag(bench: Bench, tmp_path: Path) -> None:
    renderer = tactile.TactileRenderer(tactile.TactileParameters(), Hand(), seed=6)
    node = bench.add(EstimatorNode, reference_frames=6, grasp_frames=4, max_gap=60.0)
    estimates: list[RelativePose] = []
    truth: dict[float, np.ndarray] = {}
    client = bench.client
    client.create_subscription(RelativePose, "relative_pose", estimates.append, COMMAND)
    client.create_subscription(
        RelativePose, TRUTH, lambda m: truth.update({seconds(m.header.stamp): pose_to_matrix(m.pose.pose)}), 20
    )
    stages: list[tuple[str, list[np.ndarray | None]]] = [
        ("capture_reference", [None] * 20),
        ("initialize_grasp", [np.eye(4)] * 20),
        ("", [motion(i / 35) for i in range(36)]),
    ]
    start = START
    for number, (service, poses) in enumerate(stages):
        bag = write_bag(tmp_path / f"stage{number}.mcap", renderer, start, poses)
        start += len(poses) * PERIOD
        player = play(bag, "--rate", "1.0" if service else "0.5")  # slowly: images are best effort
        try:
            if service:
                before = len(truth)
                assert bench.until(lambda before=before: len(truth) > before, 30.0), "the player does not play"
                answer = bench.call(Trigger, f"estimator/{service}", Trigger.Request())
                assert answer.success, answer.message
            assert bench.until(lambda player=player: player.poll() is not None, 60.0)
            assert player.returncode == 0
        finally:
            player.kill()
            player.wait()
    bench.spin(0.3)
    moved = [e for e in estimates if seconds(e.header.stamp) >= START + 40 * PERIOD - 1e-3]
    good = [e for e in moved if e.valid]
    assert len(good) > 18, [e.reason for e in moved if not e.valid][:3]
    pairs = [
        (pose_to_matrix(e.pose.pose), truth[seconds(e.header.stamp)]) for e in good if seconds(e.header.stamp) in truth
    ]
    assert len(pairs) > 15
    translation = np.array([estimate[:3, 3] - true[:3, 3] for estimate, true in pairs])
    rotation = np.array([rotation_error(estimate[:3, :3], true[:3, :3]) for estimate, true in pairs])
    assert np.sqrt((translation**2).mean(axis=0)).max() < 2e-4  # [m]
    assert np.rad2deg(np.sqrt((rotation**2).mean(axis=0))).max() < 0.8
    assert node.inputs.counts()["images_out_of_order"] == 0


def test_a_bag_with_truth_is_validated_by_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Images before the truth becomes valid are the reference, those right after it the grasp."""
    renderer = tactile.TactileRenderer(tactile.TactileParameters(), Hand(), seed=8)
    poses = [None] * 12 + [np.eye(4)] * 8 + [motion(i / 29) for i in range(30)]
    bag = write_bag(tmp_path / "whole.mcap", renderer, START, poses)
    assert validate.main(["estimator", "--from", str(bag), "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    assert out["frames"] == 30
    assert out["valid_fraction"] == 1.0
    assert max(out["rmse"][name] for name in ("x_mm", "y_mm", "z_mm")) < 0.2
    assert max(out["rmse"][name] for name in ("roll_deg", "pitch_deg", "yaw_deg")) < 0.8
    assert validate.main(["estimator", "--method", "published", "--from", str(bag), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rmse"]["z_mm"] > 0.2  # along a long cylinder it is blind


def test_a_tool_that_is_released_is_scored_as_long_as_it_is_held(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    renderer = tactile.TactileRenderer(tactile.TactileParameters(), Hand(), seed=8)
    held = [motion(max(0, i - 12) / 24) for i in range(25)]
    again = [np.eye(4)] * 10
    bag = write_bag(tmp_path / "released.mcap", renderer, START, [*[None] * 22, *held, *[None] * 15, *again])
    assert validate.main(["estimator", "--from", str(bag), "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    assert out["frames"] == 17
    assert out["valid_fraction"] == 1.0
    assert max(out["rmse"][name] for name in ("x_mm", "y_mm", "z_mm")) < 0.2

# SPDX-License-Identifier: Apache-2.0
"""A recorded press, which no renderer made, through the real estimator node: `./seed recordings`."""

import json
from pathlib import Path

import numpy as np
import pytest

from seed_estimation import ContactPatch, PinholeCamera, TactileImages
from seed_testing.recordings import command as recordings
from seed_testing.recordings.press import TOUCHED, UNTOUCHED, Press, findings

PRESS = recordings.folder() / recordings.PRESS


@pytest.mark.ros
@pytest.mark.realtime  # large images may be lost on a busy machine
@pytest.mark.slow
@pytest.mark.skipif(not PRESS.exists(), reason=f"no recorded press at {PRESS}; set SEED_DATA")
def test_the_node_finds_and_holds_a_recorded_press(capsys: pytest.CaptureFixture[str]) -> None:
    """No contact in frames 0-58, contact from 64 at the latest, centroid steady from 72, depth follows force."""
    pytest.importorskip("rclpy", reason="needs ROS 2")
    assert recordings.main(["--only", "press", "--press", str(PRESS)]) == 0
    told = json.loads(capsys.readouterr().out.strip().splitlines()[-1])["press"]
    assert told["frames"] == 85
    assert told["false_contacts"] == 0
    assert UNTOUCHED <= told["contact_from"] <= TOUCHED
    assert told["centroid_std_mm"] <= 0.15
    assert told["correlation"] > 0.97


def pressed(frame: int, from_frame: int) -> ContactPatch:
    touches = frame >= from_frame
    return ContactPatch("left", touches, np.full(3, 0.08), mean_indentation=0.001 * (frame - from_frame) * touches)


@pytest.mark.parametrize(("from_frame", "good"), [(62, True), (64, True), (65, False), (58, False)])
def test_findings_are_good_only_where_contact_begins_in_time(from_frame: int, good: bool) -> None:
    patches = [pressed(i, from_frame) for i in range(85)]
    force = np.array([p.mean_indentation for p in patches])
    assert findings(patches, force).good is good


def test_a_contact_that_is_lost_again_is_not_held() -> None:
    patches = [pressed(i, 62) for i in range(84)] + [ContactPatch("left")]
    assert findings(patches, np.arange(85.0)).contact_from is None


def test_a_missing_recording_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert recordings.main(["--only", "press", "--press", str(tmp_path / "none.npz")]) == 2
    assert "none.npz: not a recorded press" in capsys.readouterr().err


def test_a_press_becomes_a_bag_with_the_same_images(tmp_path: Path) -> None:
    pytest.importorskip("rclpy", reason="needs ROS 2")
    from seed_bringup.bags.files import read_messages
    from seed_ros.images import depth_from_message, gray_from_message
    from seed_testing.recordings.press_bag import START, write

    camera = PinholeCamera(16, 12, np.array(((5.0, 0.0, 1.5), (0.0, 5.0, 1.0), (0.0, 0.0, 1.0))))
    depths = [np.full((12, 16), 0.08 + 0.001 * i, np.float32) for i in range(3)]
    images = [TactileImages(d, np.full((12, 16), 10.0 * i, np.float32), 7.0 + 0.5 * i) for i, d in enumerate(depths)]
    depths[1][0, 0] = np.nan
    write(Press(camera, images, np.zeros((3, 6))), tmp_path / "press.mcap", "right")
    found = list(read_messages(tmp_path / "press.mcap", lambda topic: topic.startswith("/bubble_right/")))
    seen = [m for topic, _, m in found if topic.endswith("depth/image_rect_raw")]
    grey = [m for topic, _, m in found if topic.endswith("ir/image_rect_raw")]
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in seen]
    np.testing.assert_allclose(stamps, [START, START + 0.5, START + 1.0])
    np.testing.assert_array_equal([depth_from_message(m) for m in seen], depths)
    np.testing.assert_array_equal([gray_from_message(m) for m in grey], [i.ir for i in images])
    cameras = [m for topic, _, m in found if topic.endswith("camera_info")]
    assert all(list(m.k) == camera.K.ravel().tolist() for m in cameras)
    assert len(found) == 9

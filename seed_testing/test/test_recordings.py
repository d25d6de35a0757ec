# SPDX-License-Identifier: Apache-2.0
"""A recorded press, which no renderer made, through the real estimator node: `./seed recordings`."""

import json
from pathlib import Path

import numpy as np
import pytest

from seed_estimation import ContactPatch
from seed_testing.recordings import command as recordings
from seed_testing.recordings.press import TOUCHED, UNTOUCHED, findings

PRESS = recordings.folder() / recordings.PRESS


@pytest.mark.ros
@pytest.mark.realtime  # large images may be lost on a busy machine
@pytest.mark.neighbourly  # every image waits for the node's answer
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

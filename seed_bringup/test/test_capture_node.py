# SPDX-License-Identifier: Apache-2.0
"""./seed capture before the simulated cameras: calibration is two commands."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from seed_bringup.ros import capture
from seed_core.hand import Hand
from seed_estimation.calibration import calibrate, file

pytestmark = [pytest.mark.ros, pytest.mark.neighbourly]


def test_a_capture_before_simulated_cameras_calibrates(tmp_path: Path, capsys: Any) -> None:
    made, found = tmp_path / "capture.npz", tmp_path / "calibration.yaml"
    assert capture.main(["--practice", "--out", str(made), "--frames", "16", "--per-pose", "6"]) == 0
    said = capsys.readouterr().out
    assert said.count("  taken: ") == 6
    assert f"./seed calibrate {made} --radius 0.012" in said
    assert calibrate.main([str(made), "--out", str(found), "--radius", "0.012"]) == 0
    hand = file.load(found).hand(Hand())
    np.testing.assert_allclose(hand.X_CL, Hand().X_CL, atol=3e-3)  # as drawn: 3 mm, and 0.003 rad
    assert capture.main(["--practice", "--out", str(made)]) == 2  # a file that exists stays
    assert "exists: name another file" in capsys.readouterr().err


def test_cameras_that_do_not_run_are_told_by_their_topics(
    tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(capture, "FIRST", 0.5)
    assert capture.main(["--out", str(tmp_path / "c.npz"), "--left", "/bubble_1"]) == 1
    assert "nothing on /bubble_1/depth/image_rect_raw" in capsys.readouterr().err

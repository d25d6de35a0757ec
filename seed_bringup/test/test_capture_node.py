# SPDX-License-Identifier: Apache-2.0
"""./seed capture before the simulated cameras: calibration is two commands."""

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from rclpy.serialization import serialize_message

from seed_bringup.ros import capture
from seed_bringup.ros.session import Session
from seed_bringup.ros.tactile_streams import TactileStreams
from seed_core.errors import FailedError
from seed_core.hand import Hand
from seed_estimation.calibration import calibrate, file
from seed_ros.images import image_message

pytestmark = pytest.mark.ros


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


def test_a_pause_of_the_cameras_costs_the_step_and_not_the_capture(capsys: Any) -> None:
    class Streams:
        problem = ""
        use: Any = None

    class Session:
        """Cameras that pause in the second and the third step."""

        def __init__(self) -> None:
            self.asked = 0

        def until(self, *_: Any) -> None:
            self.asked += 1
            for _i in range(1 if self.asked in (2, 4) else 3):
                streams.use({"left": None})

    class Taken:
        poses = 0

        def free(self, got: list[Any]) -> str:
            return f"{len(got)} images"

        def pose(self, got: list[Any]) -> str:
            self.poses += 1
            return f"pose {self.poses} of {len(got)} images"

    streams, taken = Streams(), Taken()
    guide = capture.Guide(Session(), streams, taken, lambda _: "")  # type: ignore[arg-type]
    guide.run(3, 3)
    assert taken.poses == capture.MOST_POSES
    assert capsys.readouterr().out.count("not taken: 1 of 3 images") == 2
    dead = Session()
    dead.asked, dead.until = 1, lambda *_: None  # type: ignore[method-assign]
    with pytest.raises(FailedError, match="0 of 3 images"):
        capture.Guide(dead, streams, Taken(), lambda _: "").run(3, 3)  # type: ignore[arg-type]


@pytest.mark.parametrize(("encoding", "kind", "full"), [("mono16", np.uint16, 65535.0), ("mono8", np.uint8, 255.0)])
def test_a_full_pixel_is_told_by_the_encoding_however_dim_the_images_are(encoding: str, kind: Any, full: float) -> None:
    session = Session(lambda: None, follow=False)
    with closing(session):
        streams = TactileStreams(session.node, {"left": "bubble_left"}, "ir", rectified=False)
        depth = serialize_message(image_message(np.ones((4, 6), np.float32), "32FC1", 1.0, "cam"))
        dim = serialize_message(image_message(np.full((4, 6), 40, kind), encoding, 1.0, "cam"))
        streams._on_image("left", "depth", depth)
        streams._on_image("left", "ir", dim)
    assert len(streams.recent) == 1
    assert streams.full == full


def test_a_file_that_cannot_be_written_is_refused_first_and_never_costs_the_capture(
    tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert capture.main(["--out", str(tmp_path / "missing/c.npz")]) == 2
    assert "missing/c.npz cannot be written: No such file" in capsys.readouterr().err
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    class Full:
        def save(self, path: Path) -> None:
            if path.parent == tmp_path:
                raise OSError(28, "No space left on device")
            path.write_text("all of it")

    with pytest.raises(FailedError, match=r"No space left on device; the capture is in .*/c.npz"):
        capture.save(Full(), tmp_path / "c.npz")  # type: ignore[arg-type]
    assert next(tmp_path.glob("seed-capture-*/c.npz")).read_text() == "all of it"


def test_cameras_that_do_not_run_are_told_by_their_topics(
    tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(capture, "FIRST", 0.5)
    assert capture.main(["--out", str(tmp_path / "c.npz"), "--left", "/bubble_1"]) == 1
    assert "nothing on /bubble_1/depth/image_rect_raw" in capsys.readouterr().err
    assert capture.main(["--out", str(tmp_path / "c.npz"), "--brightness", "infra1"]) == 1
    assert "bubble_left/infra1/image_rect_raw" in capsys.readouterr().err

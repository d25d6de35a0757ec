# SPDX-License-Identifier: Apache-2.0
"""The pictures of the documents are drawn by the committed script, and every one that a document shows is there."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from seed_bringup.pictures.__main__ import PICTURES, main
from seed_bringup.pictures.drawing import example, hand_panel
from seed_bringup.pictures.scene import camera_on

ROOT = Path(__file__).resolve().parents[2]
checkout = pytest.mark.skipif(not (ROOT / "seed").is_file(), reason="this is an installed copy, not the checkout")


@pytest.mark.parametrize("name", ["bubble", "series_elastic", "chain", "sees"])
def test_a_picture_is_drawn(name: str, tmp_path: Path) -> None:
    main([str(tmp_path), name])
    pixels = cv2.imread(str(tmp_path / f"{name}.png"))
    assert pixels is not None
    assert min(pixels.shape[:2]) >= 390
    assert pixels.std() > 15.0, "something is drawn"


def test_every_frame_of_the_hand_is_named_in_its_drawing() -> None:
    _, axes = hand_panel((260, 206))
    said = " ".join(text.get_text() for text in axes.texts)
    for name in ("tool0", "compliance", "bubble_left_optical", "bubble_right_optical", "tip", "soft bubble"):
        assert name in said


def test_an_unknown_picture_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([str(tmp_path), "nonsense"])
    assert "known: frames" in capsys.readouterr().err


@checkout
def test_every_picture_of_the_script_is_shown_and_every_one_shown_exists() -> None:
    shown = {
        (file.parent / link).resolve()
        for file in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md"))
        for link in re.findall(r'(?:!\[[^]]*\]\(|<img[^>]*src=")([^)"]+\.(?:png|svg))', file.read_text())
        if not link.startswith("http")
    }
    assert not [p for p in shown if not p.is_file()]
    assert {f"{name}.png" for name in PICTURES} <= {p.name for p in shown}


def test_the_camera_holds_hand_and_tip_in_the_picture() -> None:
    scene = example(0.02)
    camera = camera_on(scene, (600, 400))
    X_WE = scene.X_WC @ np.linalg.inv(scene.hand.X_EC)
    pixels, depth = camera.project([scene.X_WC[:3, 3], scene.tip, X_WE[:3, 3]])
    assert (depth > 0.3).all()
    assert (pixels >= (100, 0)).all()
    assert (pixels <= (500, 380)).all()

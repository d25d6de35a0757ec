# SPDX-License-Identifier: Apache-2.0
"""A capture takes what calibrates, and refuses what would not, with what to do."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from seed_core.errors import FailedError
from seed_core.hand import Hand
from seed_core.spatial import pose_from_rpy
from seed_estimation import TactileImages
from seed_estimation.calibration.calibrate import MembraneShape, calibrate, read_capture
from seed_estimation.calibration.capture import Capture
from seed_sim.tactile.parameters import TactileParameters
from seed_sim.tactile.renderer import TactileRenderer

Frames = list[Mapping[str, TactileImages]]
P = TactileParameters(range_offset=1.0)
SHAPE = MembraneShape(P.rim_x, P.rim_z, P.height, 0.105 - P.tool.radius + P.squeeze)


@pytest.fixture(scope="module")
def bubbles() -> TactileRenderer:
    return TactileRenderer(P, Hand(), 7)


@pytest.fixture(scope="module")
def free(bubbles: TactileRenderer) -> Frames:
    return [bubbles.no_contact(k / 45) for k in range(16)]


def held(bubbles: TactileRenderer, *rpy_deg: float, slide: float = 0.0) -> Frames:
    """The cylinder turned by roll, pitch and yaw [deg], which slides along x by so much meanwhile [m]."""
    return [
        bubbles.render(pose_from_rpy(np.deg2rad(rpy_deg), (slide * k / 8, 0.0, 0.0)), 1.0 + k / 45) for k in range(8)
    ]


def begun(bubbles: TactileRenderer, free: Frames) -> Capture:
    capture = Capture(bubbles.cameras, Hand(), SHAPE, P.tool.radius, full=65535.0)
    assert "coverage" in capture.free(free)
    return capture


def test_a_capture_of_three_poses_calibrates(bubbles: TactileRenderer, free: Frames, tmp_path: Path) -> None:
    capture, file = begun(bubbles, free), tmp_path / "capture.npz"
    for rpy in ((0, 0, 0), (10, 0, 0), (0, 20, 0)):
        words = capture.pose(held(bubbles, *rpy))
    assert "degrees from the nearest other pose" in words
    capture.save(file)
    found = calibrate(*read_capture(file), SHAPE, P.tool.radius, Hand())
    assert found.mutual_rotation_std > 0.0  # the cameras' places were found
    for finger, one in found.fingers.items():
        error = (one.offset_map() + bubbles.fingers[finger].noise.offset)[25:155, 30:180]
        assert np.abs(error).mean() < 0.2e-3  # [m]


def test_the_lens_model_survives_the_file(bubbles: TactileRenderer, free: Frames, tmp_path: Path) -> None:
    capture, file = begun(bubbles, free), tmp_path / "capture.npz"
    file.write_text("a capture of before")
    (tmp_path / "before").hardlink_to(file)
    capture.save(file)
    assert (tmp_path / "before").read_text() == "a capture of before"  # it stays until the new one is whole
    cameras, _, grasped = read_capture(file)
    assert all(camera.matches(bubbles.cameras[f]) for f, camera in cameras.items())
    assert grasped == {}


def test_what_would_not_calibrate_is_refused(bubbles: TactileRenderer, free: Frames) -> None:
    capture = begun(bubbles, free)
    capture.pose(held(bubbles, 0, 0, 0))
    with pytest.raises(FailedError, match=r"lies as in pose 1, within .* degrees.*tilt it by 10 to 20 degrees"):
        capture.pose(held(bubbles, 1, 0, 0))
    with pytest.raises(FailedError, match="shows no contact"):
        capture.pose(free)
    with pytest.raises(FailedError, match="keep"):
        capture.pose([*free[:4], *held(bubbles, 10, 0, 0)[:4]])
    assert capture.poses == 1


def blind(image: TactileImages) -> TactileImages:
    return TactileImages(np.full_like(image.depth, np.nan), image.ir, image.stamp)


def glaring(image: TactileImages) -> TactileImages:
    return TactileImages(image.depth, np.full_like(image.ir, 65535.0), image.stamp)


def dark(image: TactileImages) -> TactileImages:
    return TactileImages(image.depth, np.zeros_like(image.ir), image.stamp)


def inflating(image: TactileImages) -> TactileImages:
    return TactileImages(image.depth + np.float32(4.5e-3 * image.stamp), image.ir, image.stamp)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (blind, "only 0% of the image has depth"),
        (glaring, "shorter exposure"),
        (dark, "the picture is black"),
        (inflating, r"moved by .* mm meanwhile"),
    ],
)
def test_bad_images_are_refused_with_their_cause(
    bubbles: TactileRenderer, free: Frames, spoil: Callable[[TactileImages], TactileImages], words: str
) -> None:
    bad = [{**frame, "right": spoil(frame["right"])} for frame in free]
    capture = Capture(bubbles.cameras, Hand(), SHAPE, P.tool.radius, full=65535.0)
    with pytest.raises(FailedError, match=rf"right: .*{words}"):
        capture.free(bad)

# SPDX-License-Identifier: Apache-2.0
"""Recorded data that no renderer made: a press on a D405 bubble and infrared images of a PicoFlexx bubble."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from seed_core.config import load_file
from seed_core.hand import Hand
from seed_estimation import EstimatorParameters, TactileImages
from seed_estimation.contact.membrane import membrane_at_rest
from seed_estimation.contact.patch import PatchFinder
from seed_testing.recordings import infrared as real_ir
from seed_testing.recordings import press
from seed_testing.recordings.command import main
from seed_testing.recordings.infrared import Motion

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SEED_DATA", ROOT.parent / "shared" / "data"))
PRESS, INFRARED = DATA / "uiuc_punyo_d405_dev.npz", DATA / "picoflexx_ir_dev.npz"
needs_press = pytest.mark.skipif(not PRESS.exists(), reason=f"no recorded press at {PRESS}; set SEED_DATA")
needs_infrared = pytest.mark.skipif(not INFRARED.exists(), reason=f"no infrared images at {INFRARED}; set SEED_DATA")


@pytest.fixture(scope="module")
def recorded() -> press.Press:
    return press.load(PRESS)


def test_a_folder_without_recordings_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SEED_DATA", str(tmp_path))
    assert main([]) == 2
    assert f"in {tmp_path}: the recordings are no part of the project" in capsys.readouterr().err


@needs_press
@pytest.mark.parametrize("decimate", [1, 2])
def test_a_recorded_press_is_found_and_held(recorded: press.Press, decimate: int) -> None:
    """No contact in frames 0-58, contact from 64 at the latest, centroid steady from 72, depth follows force."""
    p = load_file(ROOT / "seed_estimation" / "config" / "d405.yaml", EstimatorParameters)
    p = EstimatorParameters(**{**p.__dict__, "decimate": decimate})
    depth = [np.ascontiguousarray(i.depth[::decimate, ::decimate]) for i in recorded.images]
    membrane = membrane_at_rest("left", recorded.camera.decimated(decimate), Hand().X_CL, depth[:15], p)
    found = [PatchFinder(membrane).find(d + membrane.correction, p)[1] for d in depth]
    assert not any(q.in_contact for q in found[:59])
    assert all(q.in_contact for q in found[64:])
    assert np.std([q.centroid for q in found[72:]], axis=0).max() < 0.15e-3
    for name in ("mean_indentation", "max_indentation"):
        assert np.corrcoef([getattr(q, name) for q in found], recorded.force())[0, 1] > 0.97


@needs_infrared
@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize("bright", [False, True])
@pytest.mark.parametrize(
    "end", [Motion(turn=30.0), Motion(turn=-15.0), Motion(turn=5.0), Motion(right=-20.0), Motion(down=20.0)]
)
def test_a_real_image_is_followed(index: int, bright: bool, end: Motion) -> None:
    """Within 1.5 % of every turn and shift, also 30 % brighter and with a reflection."""
    images, K = real_ir.load(INFRARED)
    image = real_ir.WarpedImage(images[index], K, brightness=0.3 * bright, spot=bright, seed=index)
    assert real_ir.relative_error(end, real_ir.follow(image, real_ir.path_to(end))[-1]) < 0.015


@pytest.mark.parametrize("lost_last", [False, True])
def test_an_estimate_that_is_not_valid_is_no_small_error(lost_last: bool) -> None:
    """A patch that leaves the image cannot be followed, whatever comes before or after it."""
    texture = cv2.GaussianBlur(np.random.default_rng(0).random((171, 224)), (0, 0), 2.0)
    texture = (1000.0 * (texture - texture.min()) / np.ptp(texture) + 200.0).astype(np.float32)
    image = real_ir.WarpedImage(texture, np.array(((214.0, 0.0, 116.0), (0.0, 214.0, 87.0), (0.0, 0.0, 1.0))))
    ends = [Motion(right=5.0), Motion(right=-200.0)]
    assert real_ir.largest_error(image, ends[:1]) < 0.015
    assert np.isnan(real_ir.largest_error(image, ends if lost_last else ends[::-1]))


def broad_spot(ir: np.ndarray) -> np.ndarray:
    v, u = np.mgrid[: ir.shape[0], : ir.shape[1]]
    return ir + 2000.0 * np.exp(-((u - 86) ** 2 + (v - 95) ** 2) / (2.0 * 6.0**2))


def uneven_light(ir: np.ndarray) -> np.ndarray:
    return ir * np.linspace(0.5, 1.5, ir.shape[1])


def blurred(ir: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(ir, (0, 0), 1.0)


def eight_bits(ir: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(ir / 16.0), 0.0, 255.0)


class Changed(real_ir.WarpedImage):
    """An image that is changed as soon as it moves."""

    change = staticmethod(blurred)

    def render(self, motion: Motion, stamp: float, contact: bool = True) -> TactileImages:
        images = super().render(motion, stamp, contact)
        return images if motion == Motion() else replace(images, ir=self.change(images.ir).astype(np.float32))


@needs_infrared
@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize("change", [broad_spot, uneven_light, blurred, eight_bits], ids=lambda v: v.__name__)
@pytest.mark.parametrize("end", [Motion(15.0, 10.0, 0.0), Motion(-30.0, -8.0, 8.0)])
def test_a_real_image_that_changes_is_followed(index: int, change: Callable[..., np.ndarray], end: Motion) -> None:
    """Turn and shift at once within 1.5 % each, though the image looks otherwise as soon as it moves."""
    images, K = real_ir.load(INFRARED)
    image = Changed(images[index], K, seed=20 + index)
    image.change = change
    found = real_ir.follow(image, real_ir.path_to(end))[-1]
    assert abs(found.turn - end.turn) < 0.015 * abs(end.turn)
    assert np.hypot(found.right - end.right, found.down - end.down) < 0.015 * np.hypot(end.right, end.down)


@needs_infrared
def test_to_and_fro_does_not_drift() -> None:
    """The reference never changes, so that nothing can; `./seed recordings` does 1000 frames."""
    images, K = real_ir.load(INFRARED)
    last = real_ir.follow(real_ir.WarpedImage(images[0], K), real_ir.to_and_fro(15.0, 8.0, 100))[-1]
    assert abs(last.turn) < 0.1
    assert np.hypot(last.right, last.down) < 0.1

# SPDX-License-Identifier: Apache-2.0
"""Recorded data that no renderer made: a press on a D405 bubble and infrared images of a PicoFlexx bubble."""

import os
from pathlib import Path

import numpy as np
import pytest

from seed_core.config import load_file
from seed_estimation import press, real_ir
from seed_estimation.parameters import EstimatorParameters
from seed_estimation.real_ir import Motion

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SEED_DATA", ROOT.parent / "shared" / "data"))
PRESS, INFRARED = DATA / "uiuc_punyo_d405_dev.npz", DATA / "picoflexx_ir_dev.npz"
needs_press = pytest.mark.skipif(not PRESS.exists(), reason=f"no recorded press at {PRESS}; set SEED_DATA")
needs_infrared = pytest.mark.skipif(not INFRARED.exists(), reason=f"no infrared images at {INFRARED}; set SEED_DATA")


@pytest.fixture(scope="module")
def recorded() -> press.Press:
    return press.load(PRESS)


@needs_press
@pytest.mark.parametrize("decimate", [1, 2])
def test_a_recorded_press_is_found_and_held(recorded: press.Press, decimate: int) -> None:
    """No contact in frames 0-58, contact from 64 at the latest, centroid steady from 72, depth follows force."""
    p = load_file(ROOT / "seed_estimation" / "config" / "d405.yaml", EstimatorParameters)
    p = EstimatorParameters(**{**p.__dict__, "decimate": decimate})
    found = press.patches(recorded, p)
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


@needs_infrared
def test_to_and_fro_does_not_drift() -> None:
    """The reference never changes, so that nothing can; `python -m seed_estimation.real_ir` does 1000 frames."""
    images, K = real_ir.load(INFRARED)
    last = real_ir.follow(real_ir.WarpedImage(images[0], K), real_ir.to_and_fro(15.0, 8.0, 100))[-1]
    assert abs(last.turn) < 0.1
    assert np.hypot(last.right, last.down) < 0.1

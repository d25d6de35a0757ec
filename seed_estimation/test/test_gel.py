# SPDX-License-Identifier: Apache-2.0
"""Parts of the gel: depth from slopes, dots, and colours to slopes, each against a formula."""

import math
from pathlib import Path

import numpy as np
import pytest

from seed_core.errors import SeedError
from seed_estimation import PinholeCamera
from seed_estimation.gel.calibration import calibrated, load, save
from seed_estimation.gel.depth import Integrator
from seed_estimation.gel.dots import DotFinder, matched
from seed_estimation.gel.image import GelImage
from seed_estimation.gel.settings import GelSettings
from seed_estimation.gel.shading import Canvas, Press, Shading, filled, fit_shading

CAMERA = PinholeCamera(320, 240, np.array(((370.5, 0.0, 159.5), (0.0, 370.5, 119.5), (0.0, 0.0, 1.0))))
CANVAS = Canvas(CAMERA, 0.022, 2)


def test_a_hill_comes_back_from_its_slopes() -> None:
    x, y = CANVAS.place
    hill = 5e-4 * np.exp(-((x - 0.002) ** 2 + (y + 0.001) ** 2) / (2 * 0.0018**2))
    gx, gy = -(x - 0.002) / 0.0018**2 * hill, -(y + 0.001) / 0.0018**2 * hill
    found = Integrator(CANVAS).imprint(np.float32(gx), np.float32(gy))
    np.testing.assert_allclose(found, hill, atol=4e-6)  # a cell is 0.12 mm wide


def test_dots_are_found_to_a_tenth_of_a_pixel() -> None:
    rng = np.random.default_rng(4)
    v, u = np.mgrid[:240, :320]
    picture = 120.0 + 0.2 * u
    true = np.array([(40.3 + 35.2 * i, 30.6 + 35.7 * j) for i in range(8) for j in range(6)])
    for a, b in true:
        picture *= 1.0 - 0.85 * np.clip(0.5 + 4.4 - np.hypot(u - a, v - b), 0.0, 1.0)
    noisy = np.clip(picture + rng.normal(0.0, 1.3, picture.shape), 0, 255).astype(np.uint8)
    found, hidden = DotFinder(9.0, 0.25).find(np.repeat(noisy[..., None], 3, axis=2))
    index = matched(found, true, 5.0)
    assert (index >= 0).all()
    assert len(found) == len(true)
    assert np.sqrt(((found[index] - true) ** 2).mean()) < 0.1
    assert hidden[31, 40]
    assert not hidden[48, 58]
    assert (matched(found, true + 20.0, 5.0) == -1).all()
    assert matched(found[:0], true, 5.0).tolist() == [-1] * len(true)


def test_what_dots_hide_is_filled_from_around() -> None:
    ramp = np.float32(np.mgrid[:40, :60][1])
    hole = np.zeros((40, 60), np.uint8)
    hole[15:20, 30:35] = 1
    broken = np.where(hole > 0, np.float32(1e4), ramp)
    np.testing.assert_allclose(filled(broken, hole, 3.0), ramp, atol=1.5)


def colours(gx: np.ndarray, gy: np.ndarray) -> np.ndarray:
    """r (3, h, w) of three lamps whose slant changes over the gel, and a gamma."""
    x, y = CANVAS.place / 0.0095
    lamps = [np.deg2rad(a) + 0.2 * x * s for a, s in ((90, 1), (210, -1), (330, 0.5))]
    light = [np.maximum(1.0 - (2.2 + 0.4 * y) * (np.cos(a) * gx + np.sin(a) * gy), 0.05) for a in lamps]
    return np.float32(np.log(light) / 2.0)


def ball(x0: float, y0: float, depth: float, radius: float = 0.002) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of a ball's imprint where it touches; the gel is bent by a skirt beside it."""
    x, y = CANVAS.place[0] - x0, CANVAS.place[1] - y0
    rho = np.hypot(x, y)
    edge = 0.5 * radius
    steep = np.where(
        rho < edge, rho / np.sqrt(radius**2 - np.minimum(rho, edge) ** 2), 0.577 * np.exp(-(rho - edge) / 8e-4)
    )
    return -x / np.maximum(rho, 1e-9) * steep * depth / 9e-4, -y / np.maximum(rho, 1e-9) * steep * depth / 9e-4


def test_a_ball_teaches_what_colours_mean() -> None:
    nothing = np.zeros(CANVAS.shape, np.uint8)
    places = [(a, b) for a in np.linspace(-0.0085, 0.0085, 7) for b in np.linspace(-0.006, 0.006, 5)]
    presses = [Press(colours(*ball(a, b, 9e-4)), nothing) for a, b in places]
    shading = fit_shading(presses, CANVAS, 0.002)
    gx, gy = shading.slopes(colours(*ball(0.0031, -0.0017, 9e-4)), shading.maps(CANVAS))
    tx, ty = ball(0.0031, -0.0017, 9e-4)
    near = np.hypot(CANVAS.place[0] - 0.0031, CANVAS.place[1] + 0.0017) < 8e-4
    assert np.abs(gx - tx)[near].max() < 0.05
    assert np.abs(gy - ty)[near].max() < 0.05
    flat = shading.slopes(np.zeros((3, *CANVAS.shape), np.float32), shading.maps(CANVAS))
    assert not np.any(flat)
    with pytest.raises(SeedError, match="of 3 images"):
        fit_shading(presses[15:18], CANVAS, 0.002)
    for radius in (2.0, 2e-4, 0.0, math.nan):
        with pytest.raises(SeedError, match="in metres"):
            fit_shading(presses, CANVAS, radius)


def test_what_is_no_calibration_is_refused(tmp_path: Path) -> None:
    zipped, one, text, shading = tmp_path / "a.npz", tmp_path / "b.npz", tmp_path / "c.npz", tmp_path / "d.npz"
    zipped.write_bytes(b"PK\x03\x04 cut off")
    with one.open("wb") as file:
        np.save(file, np.zeros(3))
    text.write_text("no calibration")
    np.savez(shading, left=np.zeros((10, 6, 2)))
    for file in (zipped, one, text, shading):
        with pytest.raises(SeedError, match=f"{file.name}: no calibration of gels"):
            load(file)
    with pytest.raises(SeedError, match=r"'left' are float64 of shape \(10, 6, 2\); .* \(19, 6, 2\) are needed"):
        load(shading)
    with pytest.raises(SeedError, match=r"missing.npz: there is no such file"):
        load(tmp_path / "missing.npz")
    whole = Shading(np.random.default_rng(0).normal(size=(19, 6, 2)))
    before = tmp_path / "before.npz"
    before.hardlink_to(shading)
    old = before.read_bytes()
    save(shading, {"right": whole})
    assert before.read_bytes() == old  # it stays until the new one is whole
    np.testing.assert_array_equal(load(shading)["right"].coefficients, whole.coefficients)
    settings, image = GelSettings(), GelImage(np.zeros((10, 10, 3), np.uint8), 0.0)
    with pytest.raises(SeedError, match="no image of the free gel"):
        calibrated([], [image], 0.002, CAMERA, settings)
    with pytest.raises(SeedError, match=r"shape \(10, 10\)"):
        calibrated([image], [image], 0.002, CAMERA, settings)

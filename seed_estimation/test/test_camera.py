# SPDX-License-Identifier: Apache-2.0
"""Rays, projection and calibration values."""

import cv2
import numpy as np
import pytest

from seed_estimation import CameraError, PinholeCamera

PICOFLEXX = PinholeCamera.from_info(
    224, 171, [214.06, 0, 116.25, 0, 214.06, 87.57, 0, 0, 1], [0.368, -4.494, 0, 0, 7.971], "plumb_bob"
)
D405 = PinholeCamera.from_info(
    640,
    480,
    [384.0, 0, 320.5, 0, 384.0, 239.0, 0, 0, 1],
    [-0.054, 0.057, 0.0003, 0.0006, -0.018],
    "inverse_brown_conrady",
)


@pytest.mark.parametrize("camera", [PICOFLEXX, D405], ids=["picoflexx", "d405"])
def test_projection_inverts_back_projection(camera: PinholeCamera) -> None:
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.05, 0.12, camera.shape)
    points = camera.back_project(depth, np.ones(camera.shape))
    v, u = np.nonzero(np.ones(camera.shape))
    np.testing.assert_allclose(camera.project(points), np.stack((u, v), axis=1), atol=1e-6)


@pytest.mark.parametrize("camera", [PICOFLEXX, D405], ids=["picoflexx", "d405"])
def test_the_quick_projection_agrees_with_the_exact_one(camera: PinholeCamera) -> None:
    pixels = np.random.default_rng(3).uniform((0, 0), (camera.width - 1, camera.height - 1), (2000, 2))
    points = (0.09 * camera.pixel_rays(pixels)).astype(np.float32)
    np.testing.assert_allclose(camera.project32(points.T).T, pixels, atol=0.02)  # [px]


def test_plumb_bob_agrees_with_opencv() -> None:
    points = np.random.default_rng(1).uniform((-0.04, -0.03, 0.08), (0.04, 0.03, 0.11), (100, 3))
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), PICOFLEXX.K, PICOFLEXX.D)
    np.testing.assert_allclose(PICOFLEXX.project(points), expected[:, 0], atol=1e-9)


def test_inverse_model_follows_its_formula() -> None:
    """One pixel worked out by hand from the definition."""
    a, b = (100 - 320.5) / 384.0, (50 - 239.0) / 384.0
    k1, k2, p1, p2, k3 = -0.054, 0.057, 0.0003, 0.0006, -0.018
    r2 = a * a + b * b
    c = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    expected = (a * c + 2 * p1 * a * b + p2 * (r2 + 2 * a * a), b * c + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b, 1.0)
    np.testing.assert_allclose(D405.rays[50, 100], expected, atol=1e-12)


def test_back_projection_leaves_out_pixels_without_depth() -> None:
    depth = np.full(PICOFLEXX.shape, np.nan, np.float32)
    depth[80, 100] = 0.1
    points = PICOFLEXX.back_project(depth, np.ones(PICOFLEXX.shape, bool))
    np.testing.assert_allclose(points, 0.1 * PICOFLEXX.rays[80, 100][None], rtol=1e-6)


def test_a_point_behind_the_camera_has_no_pixel() -> None:
    assert np.isnan(PICOFLEXX.project([0.0, 0.0, -0.1])).all()


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"k": [0.0] * 9}, "calibrated"),
        ({"k": [1.0] * 8}, "9"),
        ({"k": [214.0, 0, 500.0, 0, 214.0, 80.0, 0, 0, 1]}, "resolution"),
        ({"k": [np.nan] * 9}, "finite"),
        ({"d": [np.inf] * 5}, "finite"),
        ({"d": [0.1] * 8}, "rational"),
        ({"model": "equidistant", "d": [0.1] * 4}, "equidistant"),
        ({"width": 0}, "width"),
    ],
)
def test_a_calibration_that_is_none_is_refused_by_name(change: dict, word: str) -> None:
    values = {"width": 224, "height": 171, "k": [214.0, 0, 116, 0, 214.0, 87, 0, 0, 1], "d": [], "model": "plumb_bob"}
    with pytest.raises(CameraError, match=word):
        PinholeCamera.from_info(**{**values, **change})

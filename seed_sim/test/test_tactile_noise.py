# SPDX-License-Identifier: Apache-2.0
"""Rendered images have the statistics that were measured on recordings of the two cameras."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.hand import Hand
from seed_sim.tactile import TactileParameters, TactileRenderer
from seed_sim.tactile.noise import PicoFlexxNoise, range_error

FRAMES = 60


def correlation(a, b):
    good = np.isfinite(a) & np.isfinite(b)
    return float(np.corrcoef(a[good], b[good])[0, 1])


@pytest.fixture(scope="module")
def picoflexx():
    renderer = TactileRenderer(TactileParameters(), Hand(), 21)
    frames = [renderer.no_contact(i / 45)["left"] for i in range(FRAMES)]
    return renderer, np.stack([f.depth for f in frames]), np.stack([f.ir for f in frames])


@pytest.fixture(scope="module")
def d405():
    renderer = TactileRenderer(TactileParameters(camera="d405"), Hand(), 22)
    return renderer, np.stack([renderer.no_contact(i / 30)["left"].depth for i in range(40)])


def test_picoflexx_noise_is_half_a_millimetre_and_white(picoflexx):
    _, depth, _ = picoflexx
    noise = depth - np.nanmean(depth, axis=0, where=np.isfinite(depth), keepdims=True)
    inner = noise[:, 20:150, 20:200]
    assert_allclose(np.nanstd(inner), 0.0005, rtol=0.05)
    assert abs(correlation(inner[:, :, 1:], inner[:, :, :-1])) < 0.02
    assert abs(correlation(inner[1:], inner[:-1])) < 0.03


def test_picoflexx_fixed_pattern_has_its_size_and_grain(picoflexx):
    renderer, _, _ = picoflexx
    for finger in renderer.fingers.values():
        fixed = finger.noise.fixed
        assert_allclose(fixed.std(), 0.00058, rtol=0.02)
        assert_allclose(correlation(fixed[:, 1:], fixed[:, :-1]), 0.69, atol=0.02)


def test_picoflexx_corners_never_give_depth(picoflexx):
    _, depth, _ = picoflexx
    never = np.isnan(depth).all(axis=0)
    assert_allclose(never.mean(), 0.034, atol=0.003)
    assert never[0, 0]
    assert never[-1, -1]
    assert not never[85, 112]


@pytest.mark.parametrize("seed", range(4))
def test_range_reads_far_by_what_was_measured(seed):
    """Median 5.7 mm, 5-95 % 1.6 to 17 mm; usable crop 4.7 +- 2.7 mm."""
    error = 1e3 * range_error((171, 224), np.random.default_rng(seed))
    low, median, high = np.percentile(error, (5, 50, 95))
    assert 0.8 < low < 3.2
    assert 4.5 < median < 7.0
    assert 13.0 < high < 20.0
    crop = error[20:160, 25:200]
    assert 3.7 < crop.mean() < 5.7
    assert 1.4 < crop.std() < 3.2


def test_range_error_is_off_unless_asked_for_and_then_adds():
    shape, albedo, ir = (171, 224), np.ones((171, 224), np.float32), np.ones((171, 224), np.float32)
    silent = {"noise": 0.0, "pattern": 0.0, "dropouts": 0.0}
    for scale in (0.0, 1.0):
        p = TactileParameters(range_offset=scale, **silent)
        noise = PicoFlexxNoise(shape, p, np.random.default_rng(1))
        depth, _ = noise.add_to(np.full(shape, 0.08, np.float32), albedo, ir)
        assert_allclose(np.nanmedian(depth) - 0.08, scale * np.median(noise.offset), atol=5e-4)


def test_infrared_has_the_counts_and_noise_of_real_images(picoflexx):
    """Real: 1, 50, 99 % of counts 96, 755, 1292; noise about 1 % (2 to 13 counts); one spot up to 2895."""
    _, _, ir = picoflexx
    low, median, high = np.percentile(ir, (1, 50, 99))
    assert 40 < low < 160
    assert 600 < median < 900
    assert 1150 < high < 1450
    deviation = ir.std(axis=0)
    assert 1.5 < np.percentile(deviation, 5) < 4.0
    assert 9.0 < np.percentile(deviation, 95) < 17.0
    assert 2700 < ir.max() < 3100
    assert_allclose(ir, np.rint(ir))


def test_dots_have_the_measured_number_spacing_and_contrast(picoflexx):
    """Real: about 390 visible, nearest neighbour 7 px (10-90 %: 5.5 to 9.4), contrast 0.36 to 0.67."""
    _, _, ir = picoflexx
    image = ir.mean(axis=0).astype(np.float32)
    fine, around = cv2.GaussianBlur(image, (0, 0), 0.7), cv2.GaussianBlur(image, (0, 0), 6)
    dots = np.argwhere((fine == cv2.erode(fine, np.ones((5, 5)))) & (fine < 0.85 * around))
    nearest = np.sort(np.linalg.norm(dots[:, None] - dots[None], axis=-1), axis=1)[:, 1]
    v, u = dots.T
    contrast = 1.0 - image[v, u] / cv2.dilate(image, np.ones((9, 9)))[v, u]
    assert 330 < len(dots) < 480
    assert 6.0 < np.median(nearest) < 8.3
    assert 4.0 < np.percentile(nearest, 10) < 6.5
    assert 0.3 < np.percentile(contrast, 10) < 0.45
    assert 0.55 < np.percentile(contrast, 90) < 0.75


def test_printed_dots_leave_dipoles_in_depth():
    p = TactileParameters(noise=0.0, dropouts=0.0)
    renderer = TactileRenderer(p, Hand(), 3)
    finger = renderer.fingers["left"]
    depth, albedo, _ = finger.clean(renderer.membranes["left"].rest, 0.0)
    measured = renderer.no_contact(0.0)["left"].depth
    left_over = (measured - depth - finger.noise.fixed)[:, 1:-1]
    slope = albedo[:, 2:] - albedo[:, :-2]
    assert correlation(left_over, slope) > 0.95
    assert 1e-4 < np.nanmax(np.abs(left_over)) < 1.2e-3  # [m]


def test_d405_noise_is_small_slow_and_smooth(d405):
    """Real: median 0.045 mm, 95 % 0.11; lag-1 in time 0.63; in space 0.82, 0.59, 0.35, 0.09 at 1, 4, 8, 16 px."""
    _, depth = d405
    inner = depth[:, 140:340, 220:460].astype(float)
    deviation = np.nanstd(inner, axis=0)
    assert 0.03e-3 < np.nanmedian(deviation) < 0.09e-3
    finger = d405[0].fingers["left"].noise
    a = finger._state.copy()
    for lag, low, high in ((1, 0.75, 0.95), (4, 0.48, 0.7), (8, 0.24, 0.46), (16, -0.02, 0.22)):
        assert low < correlation(a[:, lag:], a[:, :-lag]) < high, lag
    finger.add_to(np.full(a.shape, 0.08, np.float32), np.ones_like(a), np.ones_like(a))
    assert_allclose(correlation(finger._state, a), 0.63, atol=0.08)


def test_d405_depth_comes_in_tenths_of_millimetres_with_holes(d405):
    """Real: quantum 0.1 mm; 30 % of the image without depth; 0.8 % of the interior missing per frame."""
    _, depth = d405
    near = depth[np.isfinite(depth) & (depth < 0.12)]
    assert_allclose(near * 1e4, np.rint(near * 1e4), atol=2e-3)
    assert 0.2 < np.isnan(depth).mean() < 0.4
    inner = np.isnan(depth[:, 140:340, 220:460])
    assert 0.003 < inner.mean() < 0.016
    assert np.nanmax(depth) > 0.2  # values metres away beside the membrane


def test_noise_scales():
    quiet, loud = (TactileRenderer(TactileParameters(noise=n), Hand(), 4) for n in (1.0, 2.0))
    spread = [np.nanstd(r.no_contact(0.0)["left"].depth - r.no_contact(0.1)["left"].depth) for r in (quiet, loud)]
    assert_allclose(spread[1] / spread[0], 2.0, rtol=0.05)

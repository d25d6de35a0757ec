# SPDX-License-Identifier: Apache-2.0
"""The observer of the surface: height, slope, compliance, steps, and directions that turn."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_control.law.surface_models import RESTING
from seed_control.law.surface_observer import MAX_SHARE, SurfaceObserver
from seed_control.parameters import ControllerParameters
from seed_core.vector3 import as_vector3

TUNING = ControllerParameters(surface_noise=0.2, slope_noise=2e-3, slope_prior=0.03, compliance_prior=0.1)
UP = np.array((0.0, 0.0, 1.0))
FRAME = 1.0 / 45.0


def height(observer: SurfaceObserver, n: np.ndarray, tip: np.ndarray, deflection: float = -0.01) -> float:
    """Height [m] along n that the observer asks for with the tip at (3,)."""
    offset, gradient, _ = observer.wanted_height(as_vector3(n), deflection)
    return offset + float(np.dot(gradient, tip))


def wipe(observer: SurfaceObserver, slope: float, seconds: float, noise: float, seed: int = 0) -> np.ndarray:
    """Move along x at 50 mm/s over a plane that the gripper follows; returns the tip at the last image."""
    rng = np.random.default_rng(seed)
    for i in range(round(seconds / FRAME)):
        x = 0.05 * i * FRAME
        true = np.array((x, 0.0, slope * x))
        tip = true + np.array((0.0, 0.0, noise * rng.standard_normal()))
        undeflected = true + np.array((0.0, 0.0, -0.01))
        if i == 0:
            observer.start(0.0, UP, tip, undeflected)
        observer.update(i * FRAME, UP, tip, undeflected, max(noise, 1e-5) ** 2)
    return true


def test_slope_is_learnt_and_used_ahead_of_the_image() -> None:
    observer = SurfaceObserver(TUNING)
    last = wipe(observer, slope=0.03, seconds=3.0, noise=0.0)
    ahead = last + np.array((0.01, 0.0, 0.0))  # 0.2 s further on
    target = height(observer, UP, ahead)
    assert_allclose(target, 0.03 * ahead[0] - 0.01, atol=2e-5)
    assert_allclose(observer.x[1], 0.03, atol=2e-3)


def test_noise_is_averaged_well_below_one_frames() -> None:
    errors = []
    for seed in range(20):
        observer = SurfaceObserver(TUNING)
        last = wipe(observer, slope=0.03, seconds=3.0, noise=3e-4, seed=seed)
        errors.append(height(observer, UP, last) - (last[2] - 0.01))
    assert np.std(errors) < 1.2e-4  # [m], from 0.3 mm per frame
    assert abs(np.mean(errors)) < 6e-5


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6])
def test_compliance_is_learnt_from_pressing(share: float) -> None:
    observer = SurfaceObserver(TUNING)
    for i in range(30):
        c = -0.02 * i / 29.0
        tip, undeflected = np.array((0.0, 0.0, share * c)), np.array((0.0, 0.0, c))
        if i == 0:
            observer.start(0.0, UP, tip, undeflected)
        observer.update(i * FRAME, UP, tip, undeflected, 1e-9)
    assert_allclose(observer.x[4], share, atol=0.02)
    # the deflection c - y = -10 mm then needs c = -10 mm / (1 - beta)
    target = height(observer, UP, observer.anchor)
    assert_allclose(target, -0.01 / (1.0 - share), rtol=0.05)


def test_share_is_bounded_when_nothing_resists() -> None:
    observer = SurfaceObserver(TUNING)
    for i in range(60):
        p = np.array((0.0, 0.0, -0.001 * i))
        if i == 0:
            observer.start(0.0, UP, p, p)
        observer.update(i * FRAME, UP, p, p, 1e-9)
    assert 0.0 <= observer.x[4] <= MAX_SHARE
    assert np.isfinite(height(observer, UP, p))


def test_step_of_the_surface_is_taken_over_within_a_few_images() -> None:
    observer = SurfaceObserver(TUNING)
    wipe(observer, slope=0.0, seconds=2.0, noise=0.0)
    for i in range(4):  # the surface falls by 5 mm; the gripper has not followed yet
        place = observer.anchor * np.array((1.0, 1.0, 0.0))
        tip, undeflected = place - 0.005 * UP, place - 0.01 * UP
        observer.update(2.0 + i * FRAME, UP, tip, undeflected, 9e-8)
    wanted = height(observer, UP, tip)
    assert_allclose(wanted, -0.015, atol=5e-4)


@pytest.mark.parametrize("frequency", [0.4, 0.5, 1.3])
def test_a_surface_that_swings_is_foretold(frequency: float) -> None:
    """After two periods under noise, the height a tenth of a second ahead is known better than an image's."""
    w, ahead, errors = 2.0 * np.pi * frequency, 0.1, []
    rng = np.random.default_rng(1)
    observer = SurfaceObserver(TUNING)
    for i in range(round((2.0 / frequency + 2.0) / FRAME)):
        t = i * FRAME
        tip = UP * (3e-3 * np.sin(w * t) + 3e-4 * rng.standard_normal())
        built = min(t / 0.3, 1.0)  # of the deflection
        undeflected = UP * (3e-3 * np.sin(w * (t - 0.1)) - 0.01 * built)  # the gripper trails
        if i == 0:
            observer.start(t, UP, tip, undeflected)
        observer.update(t, UP, tip, undeflected, 9e-8)
        offset, gradient, rate = observer.wanted_height(as_vector3(UP), -0.01, ahead)
        if t > 2.0 / frequency:
            wanted = 3e-3 * np.sin(w * (t + ahead)) - 0.01
            errors.append((offset + np.dot(gradient, tip) - wanted, rate - 3e-3 * w * np.cos(w * (t + ahead))))
    height_error, rate_error = np.sqrt(np.mean(np.square(errors), axis=0))
    assert height_error < 2.5e-4
    assert rate_error < 0.2 * 3e-3 * w
    assert observer.weights[:RESTING].sum() < 0.1


def test_a_surface_that_rests_is_taken_for_one_that_rests_though_its_noise_is_understated() -> None:
    observer = SurfaceObserver(TUNING)
    rng = np.random.default_rng(2)
    for i in range(200):
        tip, undeflected = UP * 3e-4 * rng.standard_normal(), -0.01 * UP
        if i == 0:
            observer.start(0.0, UP, tip, undeflected)
        observer.update(i * FRAME, UP, tip, undeflected, 1e-8)  # a ninth of its variance
    assert observer.weights[:RESTING].sum() > 0.9


def test_nothing_moves_where_the_surface_is_said_to_rest() -> None:
    observer = SurfaceObserver(replace(TUNING, moving_surface=0.0))
    for i in range(100):
        tip = UP * 3e-3 * np.sin(3.0 * i * FRAME)
        if i == 0:
            observer.start(0.0, UP, tip, tip - 0.01 * UP)
        observer.update(i * FRAME, UP, tip, tip - 0.01 * UP, 9e-8)
    assert observer.wanted_height(as_vector3(UP), -0.01, 0.1)[2] == 0.0


def test_estimate_does_not_depend_on_how_the_world_is_turned() -> None:
    """Frame covariance: the same motion seen along another direction gives the same numbers."""
    n = np.array((0.6, 0.0, 0.8))
    across = np.array((0.8, 0.0, -0.6))
    results = []
    for up, along in ((UP, np.array((1.0, 0.0, 0.0))), (n, across)):
        observer = SurfaceObserver(TUNING)
        for i in range(60):
            s = 0.05 * i * FRAME
            tip = s * along + 0.02 * s * up
            undeflected = tip - 0.01 * up
            if i == 0:
                observer.start(0.0, up, tip, undeflected)
            observer.update(i * FRAME, up, tip, undeflected, 9e-8)
        results.append((height(observer, up, tip + 0.01 * along), observer.x[1:4] @ along, observer.x[4]))
    assert_allclose(results[0], results[1], atol=1e-12)


def test_a_slope_that_nobody_expects_is_not_trailed_for_long() -> None:
    """A table four deviations steeper than expected, after standing still: the mean of the first half second."""
    slope, speed, errors = 0.12, 0.1, []
    for seed in range(12):
        rng, observer = np.random.default_rng(seed), SurfaceObserver(TUNING)
        for i in range(90):
            t = i * FRAME
            x, pressed = speed * max(t - 1.5, 0.0), 0.01 * min(t / 0.3, 1.0)
            tip, undeflected = np.array((x, 0.0, slope * x)), np.array((x, 0.0, slope * x - pressed))
            tip[2] += 3e-4 * rng.standard_normal()
            if i == 0:
                observer.start(t, UP, tip, undeflected)
            observer.update(t, UP, tip, undeflected, 9e-8)
            if t > 1.5:
                errors.append(height(observer, UP, undeflected) - (slope * x - 0.01))
    assert abs(np.mean(errors)) < 2.8e-4  # [m]; 0.37 mm if nothing steep is thought of


def test_filters_that_are_sure_stay_in_the_world_when_the_share_is_beyond_its_bounds() -> None:
    """A grasp that turns as it is pressed lifts the tip: no share fits, and images that are exact forgive nothing."""
    observer = SurfaceObserver(TUNING)
    rng = np.random.default_rng(3)
    for i in range(500):
        t = 0.004 * i
        c = -0.014 * (1.0 - np.exp(-4.0 * t))
        tip = np.array((0.05 * t, 0.0, -0.05 * c + 2e-6 * rng.standard_normal()))
        undeflected = np.array((0.05 * t, 0.0, c))
        if i == 0:
            observer.start(t, UP, tip, undeflected)
        innovation = observer.update(t, UP, tip, undeflected, 1e-10)
        assert abs(innovation) < 2e-3, t
        assert np.abs(observer._x[:, 0]).max() < 0.02, t

# SPDX-License-Identifier: Apache-2.0
"""The paper's method: what it sees on rendered bubbles, and what not."""

from dataclasses import replace

import numpy as np
import pytest
from rendered import held

from seed_core.errors import SeedError
from seed_core.spatial import make_pose, pose_from_rpy, rotation_from_rpy
from seed_estimation.estimator import PATCH_METHODS
from seed_estimation.parameters import METHODS
from seed_estimation.published import dense_flow, fitted_gain, mean_curl, patch_frame
from seed_sim.tactile.parameters import TactileParameters


def test_the_patch_frame_worked_out_by_hand() -> None:
    """Sec. VII-B: y along p_L - p_R, x without a z component, the origin half way; then the pitch, about y."""
    p_L, p_R = np.array((0.01, 0.05, 0.02)), np.array((0.01, -0.03, -0.04))  # 80 mm along y, 60 mm along z
    x, y, z = (1.0, 0.0, 0.0), (0.0, 0.8, 0.6), (0.0, -0.6, 0.8)
    R = np.column_stack((x, y, z))
    np.testing.assert_allclose(patch_frame(p_L, p_R, 0.0), make_pose(R, (0.01, 0.01, -0.01)), atol=1e-12)
    pitched = make_pose(R @ rotation_from_rpy((0.0, 0.3, 0.0)), (0.01, 0.01, -0.01))
    np.testing.assert_allclose(patch_frame(p_L, p_R, 0.3), pitched, atol=1e-12)


@pytest.mark.parametrize("p_R", [(0.0, 0.0, 0.0), (0.0, 0.0, 0.08)], ids=["one place", "above each other"])
def test_patches_that_define_no_frame_are_told(p_R: tuple[float, float, float]) -> None:
    assert patch_frame(np.zeros(3), np.array(p_R), 0.1) is None


@pytest.mark.parametrize("turn", [-0.2, 0.05, 0.3])
def test_pitch_from_curl_is_twice_the_sine_of_a_rigid_turn(turn: float) -> None:
    """Sec. VII-C: v = du, dv of points that turn about the middle of the image."""
    v, u = np.mgrid[-40.0:41.0, -50.0:51.0]
    c, s = np.cos(turn), np.sin(turn)
    flow = np.stack((c * u - s * v - u, s * u + c * v - v), axis=-1).astype(np.float32)
    inside = (u**2 + v**2 < 30.0**2).astype(np.uint8)
    assert mean_curl(flow, inside) == pytest.approx(2.0 * s, abs=1e-5)
    assert mean_curl(flow, np.zeros_like(inside)) == 0.0


def test_the_flow_of_a_shifted_image_is_its_shift() -> None:
    image = np.random.default_rng(1).uniform(0.0, 255.0, (24, 30)).repeat(4, axis=0).repeat(4, axis=1).astype(np.uint8)
    flow = dense_flow(image, np.roll(image, (2, 3), axis=(0, 1)), 25)[20:-20, 20:-20]
    np.testing.assert_allclose(flow.reshape(-1, 2).mean(axis=0), (3.0, 2.0), atol=0.1)  # [px] u, v


def test_the_published_method_sees_y_and_is_blind_along_a_long_cylinder() -> None:
    """The paper's findings (Sec. VII-D) for a cylinder along z: y is good, z does not show at all."""
    estimator, bubbles = held(TactileParameters(), 12, "published")
    moved = np.linspace(-0.003, 0.003, 7)
    seen = []
    for i, v in enumerate(moved):
        y = estimator.update(bubbles.render(make_pose(p=(0.0, v, 0.0)), 0.1 * (i + 1)), 0.1 * (i + 1))
        seen.append(y.X_CT[1, 3])
    z = estimator.update(bubbles.render(make_pose(p=(0.0, 0.0, 0.004)), 1.0), 1.0)
    assert np.corrcoef(moved, seen)[0, 1] > 0.99
    # the patch grows as it is pressed: new, less indented membrane holds its mean back, on a cylinder by a quarter
    assert 0.6 < np.polyfit(moved, seen, 1)[0] < 1.1
    assert abs(z.X_CT[2, 3]) < 0.001
    assert not z.observed[2]
    assert y.observed[1]


def test_the_published_method_sees_pitch() -> None:
    estimator, bubbles = held(TactileParameters(), 12, "published")
    estimate = estimator.update(bubbles.render(pose_from_rpy((0.0, 0.12, 0.0), np.zeros(3)), 0.1), 0.1)
    assert -estimate.X_CT[2, 0] == pytest.approx(np.sin(0.12), rel=0.25)


def test_the_published_methods_constant_is_calibrated_from_known_pitches() -> None:
    estimator, bubbles = held(TactileParameters(), 12, "published")
    assert estimator.parameters.curl_gain == 1.0  # so that pitches come out as curls

    def curl(pitch: float, t: float) -> float:
        estimate = estimator.update(bubbles.render(pose_from_rpy((0.0, pitch, 0.0), np.zeros(3)), t), t)
        return float(-np.arcsin(estimate.X_CT[2, 0]))

    known = np.deg2rad((-8.0, -4.0, 4.0, 8.0))
    gain = fitted_gain([curl(p, 0.1 * (i + 1)) for i, p in enumerate(known)], known)
    assert gain * curl(0.1, 1.0) == pytest.approx(0.1, rel=0.05)
    estimator.reconfigure(replace(estimator.parameters, curl_gain=2.0 * gain))  # counts from the next images on
    assert curl(0.1, 1.1) == pytest.approx(0.2, rel=0.05)
    with pytest.raises(SeedError, match="turn the tool"):
        fitted_gain([0.0, 0.0], [0.1, -0.1])


def test_every_method_that_has_a_name_has_its_class() -> None:
    assert {"rigid_fit", *PATCH_METHODS} == set(METHODS)

# SPDX-License-Identifier: Apache-2.0
"""Rendered gels: their mechanics and light, and the tool's pose from their images."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seed_core.errors import SeedError
from seed_core.spatial import Array, pose_from_rpy, so3_log
from seed_estimation import EstimatorError
from seed_sim.closed_loop.relative_poses import pose_source
from seed_sim.gel import GelParameters, GelRenderer, gel_hand
from seed_sim.gel.estimator import BALL, calibrate_gels, gel_estimator
from seed_sim.gel.shapes import ball_surface, tool_surface
from seed_sim.gel.stiffness import gel_stiffness
from seed_sim.gel.surface import CELL, GelSurface
from seed_sim.scenario import load_scenario
from seed_sim.tactile.parameters import ToolShape

P = GelParameters()


@pytest.fixture(scope="module")
def gels() -> GelRenderer:
    return GelRenderer(P, gel_hand(P), 11)


def ball(p: GelParameters, depth: float) -> Array:
    s = GelSurface(p)
    return s.press(ball_surface(0.003, np.array((0.0, 0.0, p.distance - depth + 0.003)), s.x, s.y), np.eye(4)).u


def test_an_imprint_is_the_ball_where_it_touches_and_falls_off_beside_it() -> None:
    p = replace(P, bulge=0.0)
    u, x = ball(p, 5e-4)[80], (np.arange(200) - 99.5) * CELL
    touching = np.abs(x) < 6e-4
    np.testing.assert_allclose(u[touching], 5e-4 - 0.003 + np.sqrt(0.003**2 - x[touching] ** 2), atol=5e-6)
    away = u[(x > 0.0022) & (x < 0.0045)]
    rate = -np.polyfit(np.arange(away.size) * CELL, np.log(away), 1)[0]
    assert 1.0 < rate * p.skirt * p.thickness < 1.6  # around a point it falls as K_0(r / l), a little faster than e


def test_displaced_gel_rises_around_the_ball() -> None:
    kept = ball(P, 5e-4)
    assert kept.min() < 0.0
    assert ball(replace(P, bulge=0.0), 5e-4).min() > -1e-9


def test_what_sticks_moves_with_the_tool_and_what_is_far_away_does_not() -> None:
    s = GelSurface(replace(P, spread=0.0, creep=0.0))
    X = pose_from_rpy((0.0, 0.0, 0.05), (3e-4, -2e-4, 0.0))
    still = np.eye(4)
    still[2, 3] = P.distance - P.squeeze + 0.005
    shape = ToolShape(kind="cylinder", radius=0.005, length=0.01)
    on_end = tool_surface(shape, X @ still @ pose_from_rpy((0.0, 0.0, 0.3), np.zeros(3)), s.x, s.y)
    pressed = s.press(on_end, X)
    gone = np.stack([s.x - pressed.material[0], s.y - pressed.material[1]])
    inside = pressed.u > 0.999 * pressed.u.max()
    lay = np.stack([pressed.material[0][inside], pressed.material[1][inside]])
    np.testing.assert_allclose(gone[:, inside], X[:2, :2] @ lay + X[:2, 3:] - lay, atol=2e-5)
    assert np.abs(gone[:, :3, :3]).max() < 0.2 * np.abs(gone).max()


def test_a_tool_that_is_nearer_is_seen_as_far_as_it_is() -> None:
    s = GelSurface(P)
    box = ToolShape(kind="box", radius=0.01, width=0.008, length=0.02)
    X = np.eye(4)
    X[:3, :3] = np.array(((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)))  # y of the tool towards the camera
    X[2, 3] = 0.03
    z = tool_surface(box, X, s.x, s.y)
    assert z[80, 100] == pytest.approx(0.02, abs=1e-7)
    assert z[80, 20] > 0.5


def test_a_slope_towards_a_lamp_is_brighter_and_one_image_is_not_like_the_other(gels: GelRenderer) -> None:
    finger = gels.fingers["left"]
    flat, up = np.zeros((240, 320), np.float32), np.full((240, 320), 0.2, np.float32)
    plain, tilted, other = (finger._lamps.linear(s) for s in ((flat, flat), (flat, -up), (flat, up)))
    assert tilted[120, 160, 0] > plain[120, 160, 0] > other[120, 160, 0] or (
        tilted[120, 160, 0] < plain[120, 160, 0] < other[120, 160, 0]
    )
    a, b = gels.no_contact(0.0)["left"].rgb, gels.no_contact(0.0)["left"].rgb
    noise = (a.astype(float) - b).std() / np.sqrt(2.0)
    assert 0.8 < noise < 3.0
    assert a.shape == (240, 320, 3)


def test_two_gels_tell_the_pose(gels: GelRenderer) -> None:
    estimator = gel_estimator(gels, calibrate_gels(gels, places=(6, 4)))
    with pytest.raises(EstimatorError, match="touches nothing"):
        estimator.initialize_grasp([gels.no_contact(-0.2)])
    estimator.initialize_grasp([gels.render(np.eye(4), -0.1 + 0.01 * i) for i in range(3)])
    errors = []
    for k in range(1, 13):
        X = pose_from_rpy(np.deg2rad((1.0, 4.0, -1.0)) * k / 12, np.array((4e-4, 5e-5, -4e-4)) * k / 12)
        found = estimator.update(gels.render(X, 0.03 * k), 0.03 * k)
        assert found.valid, found.reason
        assert all(found.observed)
        turn = np.rad2deg(so3_log(found.X_CT[:3, :3] @ X[:3, :3].T))
        errors.append(np.concatenate([turn, 1e3 * (found.X_CT[:3, 3] - X[:3, 3])]))
    rms = np.sqrt(np.square(errors).mean(axis=0))
    assert rms[:3].max() < 0.5
    assert rms[3:].max() < 0.06  # [deg], [mm]; docs/other_sensors.md has many draws
    assert estimator.debug_image().shape == (240, 640, 3)
    black = {f: replace(i, rgb=0 * i.rgb, stamp=0.5) for f, i in gels.no_contact(0.5).items()}
    assert "lamps" in estimator.update(black, 0.5).reason


PAGE = Path(__file__).resolve().parents[2] / "docs/other_sensors.md"


@pytest.mark.skipif(not PAGE.is_file(), reason="this is an installed copy")
def test_the_gel_of_the_page_is_calibrated_saved_and_takes_images(
    gels: GelRenderer, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"^```py\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    finger = gels.fingers["left"]
    places = [(x, y) for x in np.linspace(-0.008, 0.008, 6) for y in np.linspace(-0.005, 0.005, 5)]
    made = {
        "empty": [finger.image(finger.surface.free, 0.0).rgb] * 2,
        "pressed": [finger.image(finger.ball(BALL, u, v, 9e-4), 0.0).rgb for u, v in places],
        "camera": finger.camera,
        "hand": gels.hand,
    }
    exec(compile(code, str(PAGE), "exec"), made)
    estimator = made["estimator"]
    estimator.capture_reference([{"left": gels.no_contact(0.0)["left"]}])
    estimator.initialize_grasp([{"left": gels.render(np.eye(4), 0.1)["left"]}])
    assert estimator.update({"left": gels.render(np.eye(4), 0.2)["left"]}, 0.2).valid


def test_the_shipped_scenario_is_what_its_gels_make_it() -> None:
    scenario = load_scenario("gel")
    assert scenario.gel is not None
    hand, tool = gel_hand(scenario.gel), scenario.gel.tool
    np.testing.assert_allclose(scenario.hand.X_CL, hand.X_CL, atol=1e-9)
    np.testing.assert_allclose(scenario.hand.X_CR, hand.X_CR, atol=1e-9)
    stiffness = gel_stiffness(1.5e5, scenario.gel.thickness, tool.width, 0.020, tool.radius)
    np.testing.assert_allclose(scenario.grasp.stiffness.vector(), stiffness.vector(), rtol=0.01)


def test_a_gel_half_as_thick_is_sheared_twice_as_hard_and_pressed_more_than_four_times() -> None:
    thick, thin = (gel_stiffness(1e5, t, 0.009, 0.02, 0.012) for t in (0.003, 0.0015))
    assert thick.translation[0] == pytest.approx(2 * 1e5 * 0.009 * 0.02 / 0.003)
    assert thin.translation[0] == pytest.approx(2.0 * thick.translation[0])
    assert thin.translation[1] > 4.0 * thick.translation[1]


def test_each_estimator_says_which_scenarios_it_can_read() -> None:
    with pytest.raises(SeedError, match="--scenario gel"):
        pose_source("gel", load_scenario("nominal"), 0, 250.0)
    with pytest.raises(SeedError, match="--estimator gel"):
        pose_source("rigid_fit", load_scenario("gel"), 0, 250.0)

# SPDX-License-Identifier: Apache-2.0
"""Rendered bubbles: geometry against independent sums, and what moves, bulges, lags and slips."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.config import ConfigError, checked
from seed_core.hand import Hand
from seed_core.spatial import inverse_pose, pose_from_rpy
from seed_sim.tactile import TactileParameters, TactileRenderer, ToolShape
from seed_sim.tactile.cameras import camera_model, coarse_rays
from seed_sim.tactile.geometry import tool_depth
from seed_sim.tactile.membrane import Membrane, followed
from seed_sim.tactile.sheet import share_at
from seed_sim.tactile.texture import Light

CLEAN = TactileParameters(noise=0.0, pattern=0.0, dropouts=0.0)
BOX = ToolShape(kind="box", width=0.03, length=0.04)


@pytest.fixture(scope="module")
def clean():
    return TactileRenderer(CLEAN, Hand(), 11)


def points(renderer, finger, images):
    """(H, W, 3) in C."""
    X_CX = renderer.hand.X_CL if finger == "left" else renderer.hand.X_CR
    p = renderer.cameras[finger].rays * images[finger].depth[..., None]
    return p @ X_CX[:3, :3].T + X_CX[:3, 3]


@pytest.mark.parametrize("finger", ["left", "right"])
def test_free_membrane_is_the_measured_dome(clean, finger):
    p = points(clean, finger, clean.no_contact(0.0))
    side = 1.0 if finger == "left" else -1.0
    height = CLEAN.tool.radius - CLEAN.squeeze + CLEAN.height - side * p[..., 1]
    out = (p[..., 0] / CLEAN.rim_x) ** 2 + (p[..., 2] / CLEAN.rim_z) ** 2
    inside = out < 0.7
    inside[:, [0, -1]] = inside[[0, -1]] = False  # the outermost pixels repeat their neighbours
    expected = CLEAN.height * np.sqrt(np.maximum(1 - out, 0.0))
    assert inside.sum() > 10000
    assert_allclose(height[inside], expected[inside], atol=5e-5)  # [m]; the coarse grid is interpolated


def test_membrane_lies_where_real_ones_do(clean):
    for images in clean.no_contact(0.0).values():
        depth = images.depth[np.isfinite(images.depth)]
        assert 0.058 <= depth.min() < depth.max() <= 0.110  # [m]


@pytest.mark.parametrize("X_CT", [np.eye(4), pose_from_rpy((0.1, 0.2, -0.1), (0.004, 0.001, -0.003))])
@pytest.mark.parametrize("finger", ["left", "right"])
def test_patch_lies_on_the_cylinder(clean, finger, X_CT):
    free, images = clean.no_contact(0.0), clean.render(X_CT, 0.0)
    imprint = free[finger].depth - images[finger].depth
    v, u = np.unravel_index(np.nanargmax(cv2.GaussianBlur(np.nan_to_num(imprint), (0, 0), 2.0)), imprint.shape)
    p_T = points(clean, finger, images)[v - 4 : v + 5, u - 4 : u + 5].reshape(-1, 3) @ X_CT[:3, :3]
    p_T = p_T - X_CT[:3, :3].T @ X_CT[:3, 3]
    assert_allclose(np.hypot(p_T[:, 0], p_T[:, 1]), CLEAN.tool.radius, atol=5e-5)  # [m]


def test_nothing_sees_through_the_tool(clean):
    """No point of the membrane lies inside the cylinder."""
    X_CT = pose_from_rpy((0.15, -0.2, 0.1), (0.005, -0.002, 0.004))
    for finger in ("left", "right"):
        p = (points(clean, finger, clean.render(X_CT, 0.0)) - X_CT[:3, 3]) @ X_CT[:3, :3]
        assert np.nanmin(np.hypot(p[..., 0], p[..., 1])) > CLEAN.tool.radius - 1e-4  # [m]


def test_grasp_leaves_an_imprint_of_the_squeeze(clean):
    free, held = clean.no_contact(0.0), clean.render(np.eye(4), 0.0)
    for finger in ("left", "right"):
        assert_allclose(np.nanmax(free[finger].depth - held[finger].depth), CLEAN.squeeze, atol=1e-4)


def test_imprint_decays_as_in_the_recorded_press():
    """A recorded press of 5.4 mm on one bubble falls to 1.5 mm at 14 mm from its middle and to 0.5 mm at 24 mm."""
    thin = replace(CLEAN, tool=ToolShape(kind="short_handle", radius=0.003, length=0.01), squeeze=0.0055, bulge=0.0)
    renderer = TactileRenderer(thin, Hand(), 0)
    imprint = renderer.membranes["left"].press(np.eye(4), np.eye(4)).imprint
    p = renderer.membranes["left"].rest.material
    for distance, low, high in ((0.014, 0.9e-3, 2.2e-3), (0.024, 0.25e-3, 0.9e-3)):
        ring = np.abs(np.hypot(p[0], p[1]) - distance) < 0.0007
        assert low < float(imprint[ring].mean()) < high


def test_bulge_keeps_the_volume_of_air(clean):
    """Volume under the membrane is the same without and with the tool, but for what leaves the view."""
    membrane = clean.membranes["left"]
    shape = membrane.press(np.eye(4), np.eye(4))
    pressed_in = float((shape.imprint * membrane._area).sum())
    change = float(((shape.depth - membrane.dome) * membrane._area).sum())
    assert pressed_in > 3e-6  # [m^3]
    assert abs(change) < 0.45 * pressed_in  # the rim's bulge is out of view
    stiff = TactileRenderer(replace(CLEAN, bulge=0.0), Hand(), 11).membranes["left"]
    assert float(((stiff.press(np.eye(4), np.eye(4)).depth - stiff.dome) * stiff._area).sum()) < -0.99 * pressed_in


def test_a_point_press_bulges_by_what_was_measured():
    """A press of 5.6 mm with a point bulges the bubble by 0.8 mm elsewhere."""
    point = replace(CLEAN, tool=ToolShape(kind="short_handle", radius=0.003, length=0.01), squeeze=0.0101)
    membrane = TactileRenderer(point, Hand(), 0).membranes["left"]
    aside = pose_from_rpy((0.0, 0.0, 0.0), (-0.03, 0.0, 0.0))  # as it was pressed, where the dome is 4.5 mm lower
    shape = membrane.press(aside, aside)
    assert_allclose(shape.imprint.max(), 0.0056, atol=5e-4)
    assert 0.5e-3 < float((shape.depth - membrane.dome).max()) < 1.1e-3  # [m]


@pytest.mark.parametrize("tool", [ToolShape(), BOX])
@pytest.mark.parametrize("turn", [0.05, 0.5])
def test_dots_in_contact_move_rigidly_with_the_tool(tool, turn):
    """Material seen at a point of the patch is that which lay there, in the tool's frame, at the grasp."""
    membrane = TactileRenderer(replace(CLEAN, tool=tool), Hand(), 2).membranes["left"]
    X_CT = pose_from_rpy((0.0, turn, 0.0), (0.003, 0.0, -0.002))
    held, moved = membrane.press(np.eye(4), np.eye(4)), membrane.press(X_CT, X_CT)
    touching = tool_depth(membrane.rays, tool, X_CT) - moved.depth < 1e-5
    stuck = touching & (
        cv2.erode((share_at(membrane.sheet.share(0.0), moved.material) > 0.999).astype(np.uint8), np.ones((3, 3))) > 0
    )
    p_T = membrane.rays.at(moved.depth)[:, stuck].T.astype(float) @ X_CT[:3, :3] + inverse_pose(X_CT)[:3, 3]
    assert stuck.sum() > 100
    assert_allclose(moved.material[:, stuck], p_T[:, ::2].T, atol=2e-5)  # [m]
    assert_allclose(held.material, membrane.rays.at(held.depth)[::2], atol=1e-6)


def test_the_rim_stays_where_it_is(clean):
    X_CT = pose_from_rpy((0.0, 0.4, 0.0), (0.008, 0.0, 0.0))
    membrane = clean.membranes["left"]
    moved = membrane.press(X_CT, X_CT)
    lateral = membrane.rays.at(moved.depth)[::2]
    rim = (lateral[0] / CLEAN.rim_x) ** 2 + (lateral[1] / CLEAN.rim_z) ** 2 > 0.93
    way = np.hypot(*(moved.material - lateral))[rim]
    assert rim.sum() > 20
    assert float(np.median(way)) < 0.0012  # [m] of 8 mm and 23 degrees


def test_micro_slip_leaves_material_behind_by_its_share():
    X_CT = pose_from_rpy((0.0, 0.2, 0.0), (0.005, 0.0, 0.0))
    X = followed(X_CT, 0.2)
    assert_allclose(X[:3, 3], (0.004, 0.0, 0.0))
    assert_allclose(X[:3, :3], pose_from_rpy((0.0, 0.16, 0.0), (0, 0, 0))[:3, :3], atol=1e-12)


def test_sliding_moves_the_imprint_but_not_the_dots(clean):
    X = pose_from_rpy((0.0, 0.0, 0.0), (0.006, 0.0, 0.0))
    membrane = clean.membranes["left"]
    slid = membrane.press(X, np.eye(4))
    assert_allclose(slid.material, membrane.rays.at(slid.depth)[::2], atol=1e-6)
    held = membrane.press(np.eye(4), np.eye(4))
    assert float(np.abs(slid.depth - held.depth).max()) > 0.002  # [m]


def test_outline_lags_behind_the_tool():
    """The centre of the thresholded patch moves less than the tool; without lag it moves further."""
    X = pose_from_rpy((0.0, 0.0, 0.0), (0.006, 0.0, 0.0))
    moved = []
    for lag in (0.0, 0.35):
        membrane = TactileRenderer(replace(CLEAN, lag=lag), Hand(), 1).membranes["left"]
        shape = membrane.press(X, X)
        patch = shape.imprint > 0.0015
        moved.append(float(membrane.rays.at(shape.depth)[0][patch].mean()))
    assert moved[1] < moved[0] - 0.0003
    assert 0.002 < moved[1] < 0.006  # [m]


def test_depth_of_a_spun_long_cylinder_only_tells_by_what_sticks():
    X = pose_from_rpy((0.0, 0.0, 0.2), (0.0, 0.0, 0.0))
    blind = TactileRenderer(replace(CLEAN, lag=1.0), Hand(), 1).membranes["left"]
    assert_allclose(blind.press(X, X).imprint, blind.press(np.eye(4), np.eye(4)).imprint, atol=1e-5)


def test_contact_brightens_and_swings(clean):
    free, held = clean.no_contact(0.0)["left"].ir, clean.render(np.eye(4), 0.0)["left"].ir
    middle = (slice(70, 100), slice(100, 130))
    assert 1.05 < held[middle].mean() / free[middle].mean() < 1.5
    swing = TactileRenderer(replace(CLEAN, brightness_change=0.3), Hand(), 11)
    dim, bright = (swing.render(np.eye(4), t)["left"].ir[middle].mean() for t in (0.0, 3.5))
    assert_allclose(bright / dim, 1.3, atol=0.02)


@pytest.mark.parametrize("camera", ["picoflexx", "d405"])
@pytest.mark.parametrize("degrees", [0.03, 30.0, 60.0])
def test_a_slope_is_darker_by_half_of_lamberts_cosine(camera, degrees):
    """Plane z = 90 mm + x tan(a), seen along the optical axis, against the same plane with a = 0."""
    p = replace(CLEAN, camera=camera)
    rays = coarse_rays(camera_model(camera), Hand(), "left")
    rest = Membrane(rays, p).rest
    light = Light(rays, rest, camera_model(camera).shape, p, np.random.default_rng(0))
    slope = np.float32(np.tan(np.deg2rad(degrees)))
    planes = (np.float32(0.09) / (1.0 - a * rays.directions[0]) for a in (0.0 * slope, slope))
    flat, tilted = (light.counts(rest._replace(depth=plane), 0.0) for plane in planes)
    middle = np.unravel_index(np.argmin(np.square(rays.directions[[0, 2]]).sum(axis=0)), flat.shape)
    expected = 0.5 + 0.5 * np.cos(np.deg2rad(degrees))
    assert_allclose(tilted[middle] / flat[middle], expected, rtol=0.03)  # the middle pixel is half a pixel off the axis


def test_same_seed_same_images_other_seed_other_images():
    one, two = (TactileRenderer(TactileParameters(), Hand(), s).render(np.eye(4), 0.0)["right"] for s in (5, 5))
    other = TactileRenderer(TactileParameters(), Hand(), 6).render(np.eye(4), 0.0)["right"]
    np.testing.assert_array_equal(one.depth, two.depth)
    np.testing.assert_array_equal(one.ir, two.ir)
    assert np.abs(one.ir - other.ir).mean() > 20.0


def test_one_finger_delivers_one_camera():
    renderer = TactileRenderer(TactileParameters(fingers="right"), Hand(), 0)
    assert set(renderer.cameras) == set(renderer.render(np.eye(4), 0.0)) == {"right"}


WRONG = [{"squeeze": 0.02}, {"noise": -1.0}, {"camera": "webcam"}, {"dot_contrast": (0.6, 0.2)}]


@pytest.mark.parametrize("wrong", WRONG)
def test_impossible_parameters_are_refused(wrong):
    with pytest.raises(ConfigError):
        checked(replace(TactileParameters(), **wrong))

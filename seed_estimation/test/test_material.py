# SPDX-License-Identifier: Apache-2.0
"""The membrane's material is followed wherever it goes on a tool: by images that are warped by known fields.

The band around the patch hangs on it: it is followed on membranes with mechanics, in seed_sim's test_membrane_cell.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rendered import PERIOD, held
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from seed_core.membrane.material import deformation, rigid_motion
from seed_core.spatial import Array, inverse_pose, make_pose, rotation_error, so3_exp
from seed_estimation import Estimator, TactileImages, tracker
from seed_estimation.material.motion import MaterialMotion, about_middle
from seed_estimation.rigid_fit.reference import _evenly
from seed_sim.tactile.parameters import TactileParameters, ToolShape
from seed_sim.tactile.renderer import TactileRenderer

Field = Callable[[Array], Array]  # x and z (2, ...) of material at the grasp to how far it has gone since [m]
FRAMES = 10  # over which a field grows


@pytest.fixture(autouse=True)
def _looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Patches that go with the tool as one are followed here, too."""
    monkeypatch.setattr(tracker, "CLEAR", 2.0)


def surface(tool: ToolShape, x: Array) -> Array:
    """Height (...) of the tool's surface over its axis at x [m]."""
    return np.full_like(x, tool.radius) if tool.kind == "box" else np.sqrt(np.maximum(tool.radius**2 - x * x, 1e-6))


def slid(images: TactileImages, bubbles: TactileRenderer, finger: str, tool: ToolShape, field: Field) -> TactileImages:
    """Images of a finger whose membrane slides by a field on a tool that stays; B-splines, which change no position."""
    camera, X_CX = bubbles.cameras[finger], bubbles.hand.X_CL if finger == "left" else bubbles.hand.X_CR
    side = 1.0 if finger == "left" else -1.0
    q = np.moveaxis(camera.rays @ X_CX[:3, :3].T, -1, 0)  # rays in C
    depth = (side * surface(tool, np.zeros(camera.shape)) - X_CX[1, 3]) / q[1]
    for _ in range(20):  # where the rays meet the tool
        point = q * depth + X_CX[:3, 3][:, None, None]
        depth = (side * surface(tool, point[0]) - X_CX[1, 3]) / q[1]
    now = point[[0, 2]]
    before = now - field(now)
    for _ in range(20):
        before = now - field(before)
    p = np.stack((before[0], side * surface(tool, before[0]), before[1]))
    X_XC = inverse_pose(X_CX)
    pixels = camera.project(np.moveaxis(p, 0, -1) @ X_XC[:3, :3].T + X_XC[:3, 3])
    ir = map_coordinates(images.ir.astype(float), np.moveaxis(pixels[..., ::-1], -1, 0), order=3, mode="nearest")
    return replace(images, ir=ir.astype(np.float32))


def expected(estimator: Estimator, finger: str, field: Field, tool: ToolShape) -> tuple[Array, Array]:
    """Rigid motion (4, 4) and deformation (9,) of the patch that the estimator follows."""
    assert estimator._tracker is not None
    p = next(m for m in estimator._tracker.models if m.finger == finger).patch.area.astype(float)
    gone = p[[0, 2]] + field(p[[0, 2]])
    after = np.stack((gone[0], p[1] + np.sign(p[1]) * (surface(tool, gone[0]) - surface(tool, p[0])), gone[1]))
    X = rigid_motion(p, after)
    return X, deformation(X, p, after)


def patches(estimator: Estimator) -> dict[str, MaterialMotion]:
    """How the material of the patches has moved, by finger, in the last frame."""
    assert estimator._tracker is not None
    return estimator._tracker.patches


def at_the_patch(X: Array, X_true: Array, p: Array) -> Array:
    """Error (3,) [m] of two motions at a point (3,) of the grasp."""
    return np.asarray(X[:3, :3] @ p + X[:3, 3] - X_true[:3, :3] @ p - X_true[:3, 3])


def shifted(m: Array) -> Array:
    """By 1.3 and -0.9 mm, and turned by 2 degrees."""
    return np.stack((1.3e-3 - 0.035 * m[1], -0.9e-3 + 0.035 * m[0]))


def stretched(m: Array) -> Array:
    """The ends stay behind on both sides, and are sheared."""
    return np.stack((0.015 * m[0] + 0.008 * m[1], 0.008 * m[0] - 0.014 * m[1]))


def bent(m: Array) -> Array:
    """The middle goes along, both ends do not."""
    return np.stack((1e-3 - 0.9 * m[1] ** 2, 5e-4 + 1.2 * m[0] * m[1]))


@pytest.mark.parametrize("field", [shifted, stretched, bent])
@pytest.mark.parametrize("kind", ["box", "cylinder"])
def test_material_that_slides_on_a_tool_at_rest_is_followed(kind: str, field: Field) -> None:
    """Shift, turn, stretch and bending of the patch are found while the tool is where it was.

    Without a pattern in depth: what dots do to it goes with the dots, which go in the infrared images alone here.
    """
    tool = ToolShape(kind, length=0.2 if kind == "cylinder" else 0.045)
    estimator, bubbles = held(TactileParameters(tool=tool, pattern=0.0), 31)
    found = []
    for i in range(1, FRAMES + 7):
        share = min(i / FRAMES, 1.0)
        images = {
            f: slid(image, bubbles, f, tool, lambda m, share=share: share * field(m))  # type: ignore[misc]
            for f, image in bubbles.render(np.eye(4), i * PERIOD).items()
        }
        estimator.update(images, i * PERIOD)
        if i > FRAMES:
            found.append(patches(estimator))
    for finger in ("left", "right"):
        X_true, d_true = expected(estimator, finger, field, tool)
        motions = [frame[finger] for frame in found if finger in frame]
        assert len(motions) >= 5
        patch = estimator.patches[finger].centroid_C
        off = np.mean([at_the_patch(m.X_CM, X_true, patch) for m in motions], axis=0)
        assert_allclose(off[[0, 2]], 0.0, atol=0.05e-3)
        assert abs(off[1]) < 0.06e-3
        turn = np.mean([rotation_error(m.X_CM[:3, :3], X_true[:3, :3]) for m in motions], axis=0)
        assert abs(turn[1]) < np.deg2rad(0.15)
        # the field is one of the tool's surface, beside which the membrane hangs at the edges of a round tool
        assert np.abs(turn).max() < np.deg2rad(0.6 if kind == "box" else 2.0)
        error = np.mean([m.deformation for m in motions], axis=0) - d_true
        narrow = np.isin(np.arange(9), (3, 6)) if kind == "cylinder" else np.zeros(9, bool)  # u^2 of a narrow patch
        assert np.abs(error[~narrow]).max() < (0.06e-3 if kind == "box" else 0.09e-3)
        assert np.abs(error[narrow]).max(initial=0.0) < 0.35e-3


def test_material_that_sticks_moves_as_the_tool_does() -> None:
    estimator, bubbles = held(TactileParameters(tool=ToolShape("box", length=0.045)), 32)
    X = np.eye(4)
    for i in range(1, 25):
        turn, way = np.deg2rad(np.array((0.1, 0.5, 0.05)) * i), np.array((1e-4, 0.2e-4, -1e-4)) * i
        X = make_pose(so3_exp(turn), way)
        estimate = estimator.update(bubbles.render(X, i * PERIOD), i * PERIOD)
    assert {m.finger for m in estimate.membrane} == {"left", "right"}
    for told in estimate.membrane:
        m, middle = patches(estimator)[told.finger], told.centroid[1]
        error = np.concatenate((rotation_error(m.X_CM[:3, :3], X[:3, :3]), m.X_CM[:3, 3] - X[:3, 3]))
        assert error @ np.linalg.solve(m.covariance, error) < 60.0
        assert np.abs(error[:3]).max() < np.deg2rad(0.5)
        assert np.abs(at_the_patch(m.X_CM, X, np.array((0.0, middle, 0.0)))).max() < 0.1e-3
        assert np.abs(m.deformation).max() < 0.1e-3
        assert 5e-4 < told.area < 5e-3
        assert 0.002 < told.indentation < 0.007


@pytest.mark.parametrize("tool", [ToolShape("box", length=0.045), ToolShape(), ToolShape(radius=0.006)])
def test_what_has_not_moved_is_told_so(tool: ToolShape) -> None:
    """A blurred reference lies 12 to 56 um beside the surface that is seen, and by 0.12 degrees askew."""
    estimator, bubbles = held(TactileParameters(tool=tool, noise=0.01, pattern=0.0), 34)
    for i in range(1, 6):
        estimate = estimator.update(bubbles.render(np.eye(4), i * PERIOD), i * PERIOD)
    assert np.abs(estimate.X_CT[:3, 3]).max() < 1e-6
    for told in estimate.membrane:
        X, middle = patches(estimator)[told.finger].X_CM, np.array((0.0, told.centroid[1], 0.0))
        assert np.abs(rotation_error(X[:3, :3], np.eye(3))).max() < np.deg2rad(0.03)
        assert np.abs(at_the_patch(X, np.eye(4), middle)).max() < 8e-6


def test_how_well_a_patch_is_known_holds_about_its_middle() -> None:
    """A patch known to so much at its middle, and by its size in turn: by drawing such motions."""
    rng, off, size, middle = np.random.default_rng(8), 3e-4, 0.012, np.array((0.004, 0.025, 0.002))
    R, after = so3_exp(np.array((0.25, 0.0, 0.2))), middle + np.array((0.005, 0.0, 0.004))
    turns, ways = rng.normal(size=(20000, 3)) * off / size, rng.normal(size=(20000, 3)) * off
    origins = [after + way - so3_exp(turn) @ R @ middle for turn, way in zip(turns, ways, strict=True)]
    drawn = np.std(np.hstack((turns, origins)), axis=0)
    assert_allclose(np.sqrt(np.diag(about_middle(middle, size, off, R))), drawn, rtol=0.03)


def test_nothing_is_told_of_material_that_is_covered() -> None:
    estimator, bubbles = held(TactileParameters(), 33)
    cloth = np.random.default_rng(33).normal(600.0, 100.0, (171, 224)).astype(np.float32)
    images = bubbles.render(np.eye(4), PERIOD)
    images["left"] = replace(images["left"], ir=cloth)
    estimate = estimator.update(images, PERIOD)
    assert [m.finger for m in estimate.membrane] == ["right"]
    estimate = estimator.update(bubbles.render(np.eye(4), 2 * PERIOD), 2 * PERIOD)
    assert [m.finger for m in estimate.membrane] == ["left", "right"]


def test_points_of_an_area_are_spread_evenly_whatever_its_edge():
    v, u = np.mgrid[:170, :220]
    for width in np.linspace(39.0, 40.0, 6):
        rows, columns = _evenly(((u - 110) / width) ** 2 + ((v - 85) / 65) ** 2 < 1.0, 300)
        assert 270 < len(rows) < 330
        points = np.stack([rows, columns], axis=1)
        gaps = cKDTree(points).query(points, k=2)[0][:, 1]
        assert gaps.min() > 4.0  # [px]; 5.2 on average
        assert gaps.max() < 7.0

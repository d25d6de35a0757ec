# SPDX-License-Identifier: Apache-2.0
"""Images of a membrane given by nodes, against surfaces and motions whose formulas are known."""

from typing import NamedTuple

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from seed_core.hand import Hand
from seed_core.spatial import Array, so3_exp
from seed_sim.tactile import MeshRenderer, TactileParameters
from seed_sim.tactile.cameras import camera_model, coarse_rays
from seed_sim.tactile.mesh_view import MeshView

RIM_X, RIM_Z, RIM = 0.057, 0.040, 0.0355  # [m] semi-axes of the rim, and its distance from C
SPACING = 0.004  # [m] of the nodes
CLEAN = TactileParameters(noise=0.0, pattern=0.0, dropouts=0.0)


class Mesh(NamedTuple):
    nodes: Array
    triangles: NDArray[np.integer]
    material: Array


def flat_sheet() -> tuple[Array, NDArray[np.integer]]:
    """Material (n, 2) of unevenly spread nodes within the rim, and triangles."""
    rng = np.random.default_rng(3)
    x, z = (v.ravel() for v in np.meshgrid(np.arange(-0.06, 0.06, SPACING), np.arange(-0.044, 0.044, SPACING)))
    x, z = x + rng.uniform(-0.2, 0.2, x.size) * SPACING, z + rng.uniform(-0.2, 0.2, x.size) * SPACING
    inside = (x / (RIM_X - 0.4 * SPACING)) ** 2 + (z / (RIM_Z - 0.4 * SPACING)) ** 2 < 1.0
    turn = np.linspace(0.0, 2.0 * np.pi, 76, endpoint=False)
    material = np.stack([np.append(x[inside], RIM_X * np.cos(turn)), np.append(z[inside], RIM_Z * np.sin(turn))], 1)
    return material, Delaunay(material).simplices


def cap(material: Array, side: float, height: float = 0.022) -> Mesh:
    """A dome: a paraboloid over the rim, from `side` towards the other finger; material moves along y alone."""
    x, z = material.T
    y = side * (RIM - height * (1.0 - (x / RIM_X) ** 2 - (z / RIM_Z) ** 2))
    return Mesh(np.stack([x, y, z], axis=1), Delaunay(material).simplices, material)


def view(camera: str, finger: str, mesh: Mesh) -> MeshView:
    hand = Hand()
    X_CX = hand.X_CL if finger == "left" else hand.X_CR
    return MeshView(coarse_rays(camera_model(camera), hand, finger), X_CX, *mesh)


@pytest.mark.parametrize(("camera", "finger"), [("picoflexx", "left"), ("picoflexx", "right"), ("d405", "left")])
def test_depth_is_that_of_the_dome_which_the_nodes_lie_on(camera, finger):
    side = 1.0 if finger == "left" else -1.0
    material, _ = flat_sheet()
    seen = view(camera, finger, cap(material, side)).rest
    rays = coarse_rays(camera_model(camera), Hand(), finger)
    o, d = rays.origin, rays.directions.astype(float)
    # side y = RIM - h + h (x^2 / a^2 + z^2 / b^2) along o + s d: a quadratic, of which the camera sees the near root
    h = 0.022
    a = h * ((d[0] / RIM_X) ** 2 + (d[2] / RIM_Z) ** 2)
    b = 2.0 * h * (o[0] * d[0] / RIM_X**2 + o[2] * d[2] / RIM_Z**2) - side * d[1]
    c = RIM - h + h * ((o[0] / RIM_X) ** 2 + (o[2] / RIM_Z) ** 2) - side * o[1]
    s = (-b - np.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
    s = np.where(s > 0.0, s, (-b + np.sqrt(b * b - 4.0 * a * c)) / (2.0 * a))
    x, z = o[0] + s * d[0], o[2] + s * d[2]
    inside = (x / RIM_X) ** 2 + (z / RIM_Z) ** 2 < 0.85
    assert inside.sum() > 3000
    assert_allclose(seen.depth[inside], s[inside], atol=2e-5)  # [m]
    assert_allclose(seen.material[0][inside], x[inside], atol=2e-5)
    assert_allclose(seen.material[1][inside], z[inside], atol=2e-5)


def test_sphere_pressed_into_the_dome_shows_no_facets():
    material, _ = flat_sheet()
    x, z = material.T
    free = cap(material, 1.0)
    radius, middle = 0.025, -0.005  # [m] of the sphere, on which the sheet lies in the middle and leaves it smoothly
    r = np.hypot(x, z)
    away = np.clip((r - 0.010) / 0.020, 0.0, 1.0)
    y = middle + np.sqrt(radius**2 - np.minimum(r, 0.0245) ** 2)
    y += (free.nodes[:, 1] - y) * away**3 * (10.0 - 15.0 * away + 6.0 * away**2)
    shape = view("picoflexx", "left", free).shape(np.stack([x, y, z], axis=1))
    rays = coarse_rays(camera_model("picoflexx"), Hand(), "left")
    p = rays.at(shape.depth).astype(float)
    inside = p[0] ** 2 + p[2] ** 2 < 0.009**2
    distance = np.sqrt(p[0] ** 2 + (p[1] - middle) ** 2 + p[2] ** 2)
    assert inside.sum() > 300
    assert_allclose(distance[inside], radius, atol=5e-5)  # [m]; facets of 4 mm would be 0.08 mm deep
    assert shape.imprint[inside].min() > 0.0


def test_material_is_found_where_a_known_motion_has_carried_it():
    """The whole sheet is sheared and stretched smoothly; every pixel knows where its material came from."""
    material, _ = flat_sheet()
    free = cap(material, 1.0)
    fade = 1.0 - (material[:, 0] / RIM_X) ** 2 - (material[:, 1] / RIM_Z) ** 2
    moved = free.nodes.copy()
    moved[:, 0] += 0.004 * fade + 0.05 * fade * material[:, 1]
    moved[:, 2] += -0.003 * fade
    shape = view("picoflexx", "left", free).shape(moved)
    p = coarse_rays(camera_model("picoflexx"), Hand(), "left").at(shape.depth).astype(float)
    m = shape.material.astype(float)
    f = 1.0 - (m[0] / RIM_X) ** 2 - (m[1] / RIM_Z) ** 2
    inside = f > 0.15
    assert inside.sum() > 2500
    assert_allclose((m[0] + 0.004 * f + 0.05 * f * m[1])[inside], p[0][inside], atol=5e-5)  # [m]
    assert_allclose((m[1] - 0.003 * f)[inside], p[2][inside], atol=5e-5)
    assert_allclose(p[1][inside], (RIM - 0.022 * f)[inside], atol=5e-5)


def test_camera_follows_the_finger_when_the_gripper_closes():
    material, _ = flat_sheet()
    free = cap(material, -1.0)
    seen = view("picoflexx", "right", free)
    assert_allclose(seen.shape(free.nodes + np.array((0.0, 0.003, 0.0))).depth, seen.rest.depth, atol=1e-6)


def test_nearest_of_two_layers_is_seen():
    """A fold: the middle of the sheet is drawn out sideways over its neighbourhood, towards the camera."""
    material, _ = flat_sheet()
    free = cap(material, 1.0)
    bump = np.exp(-(material[:, 0] ** 2 + material[:, 1] ** 2) / 0.008**2)
    moved = free.nodes + bump[:, None] * (0.02, 0.02, 0.0)
    depth = view("picoflexx", "left", free).shape(moved).depth
    top = moved[np.argmax(bump)]
    pixel = camera_model("picoflexx").project((top - (0.0, 0.105, 0.0)) @ Hand().X_CL[:3, :3])
    u, v = np.rint((pixel - 0.5) / 2.0).astype(int)
    assert depth[v, u] < 0.105 - top[1] + 3e-4  # [m]
    assert np.isfinite(depth).all()


def test_dots_move_with_the_material_and_light_stays():
    material, _ = flat_sheet()
    free = {name: cap(material, side) for name, side in (("left", 1.0), ("right", -1.0))}
    renderer = MeshRenderer(CLEAN, Hand(), 5, free)
    before = renderer.no_contact(0.0)
    shift = np.array((0.003, 0.0, 0.0))
    moved = {n: m._replace(nodes=m.nodes + shift * _inner(material)[:, None]) for n, m in free.items()}
    after = renderer.render(moved, 0.1)
    for finger in free:
        still, gone = (v[finger].ir.astype(np.float32)[60:110, 80:140] for v in (before, after))
        depth = float(np.median(before[finger].depth[60:110, 80:140]))
        expected = 214.06 * 0.003 / depth  # [px] along the image's columns, which run along x of C
        high = [v - cv2.GaussianBlur(v, (0, 0), 4.0) for v in (still, gone)]
        (dx, dy), response = cv2.phaseCorrelate(*high)
        assert response > 0.2
        assert_allclose((dx, dy), (expected, 0.0), atol=0.15 * expected)


def _inner(material: Array) -> Array:
    """1 in the middle of the sheet, 0 at its rim."""
    out = (material[:, 0] / RIM_X) ** 2 + (material[:, 1] / RIM_Z) ** 2
    return np.clip(1.6 * (1.0 - out), 0.0, 1.0)


def test_same_seed_has_the_dots_of_the_other_renderer():
    """Whatever bends the membrane: print, light and camera are one."""
    from seed_sim.tactile import TactileRenderer

    material, _ = flat_sheet()
    free = {name: cap(material, side) for name, side in (("left", 1.0), ("right", -1.0))}
    mesh = MeshRenderer(CLEAN, Hand(), 5, free).fingers["right"]
    other = TactileRenderer(CLEAN, Hand(), 5).fingers["right"]
    assert_allclose(mesh._dots.albedo, other._dots.albedo)


@pytest.mark.parametrize("turn", [0.0, 0.2])
def test_tilted_plane_through_the_rim_is_flat(turn):
    """With no dome at all, depth is that of the rim's plane, within it and beside it."""
    material, triangles = flat_sheet()
    flat = np.stack([material[:, 0], np.full(len(material), RIM), material[:, 1]], axis=1)
    R = so3_exp((0.0, turn, 0.0))  # in its own plane
    seen = view("picoflexx", "left", Mesh(flat @ R.T, triangles, material)).rest
    rays = coarse_rays(camera_model("picoflexx"), Hand(), "left")
    assert_allclose(rays.at(seen.depth)[1], RIM, atol=1e-6)

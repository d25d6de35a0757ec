# SPDX-License-Identifier: Apache-2.0
"""The surface of a membrane is told from what a camera gets wrong, and its part on a tool from what hangs free."""

from collections.abc import Callable

import numpy as np
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from seed_core.hand import Hand
from seed_core.spatial import Array
from seed_estimation import EstimatorParameters
from seed_estimation.contact.membrane import membrane_at_rest
from seed_estimation.contact.patch import PatchFinder
from seed_estimation.contact.surface import fitted_parabolas
from seed_estimation.images.tactile_images import Image
from seed_estimation.material.patch import curvature
from seed_estimation.rigid_fit.reference import finger_model
from seed_sim.tactile.cameras import camera_model

SHAPE = (90, 120)
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
DOME = np.asarray(0.09 + 4e-6 * (U - 50) ** 2 + 6e-6 * (V - 40) ** 2, np.float32)
INSIDE = np.asarray((U - 60) ** 2 / 55**2 + (V - 45) ** 2 / 40**2 < 1.0)


def test_a_parabola_is_its_own_surface_up_to_the_rim() -> None:
    assert np.abs(fitted_parabolas(DOME, INSIDE, 20.0) - DOME)[INSIDE].max() < 1e-6


def test_what_a_camera_gets_wrong_over_a_centimetre_is_not_the_membranes_shape() -> None:
    """A blur as narrow as the pixel pattern would leave all of a ripple of 25 px in the surface."""
    ripple = np.asarray(3e-4 * np.sin(2.0 * np.pi * U / 25.0), np.float32)
    middle = slice(30, 60), slice(40, 80)
    left = (fitted_parabolas(DOME + ripple, INSIDE, 20.0) - DOME)[middle]
    assert left.std() < 0.05 * ripple[middle].std()


def test_nothing_is_said_beside_the_membrane() -> None:
    out = fitted_parabolas(DOME, INSIDE, 20.0)
    assert np.isnan(out[~INSIDE]).all()
    assert np.isfinite(out[INSIDE]).all()


def test_curvature_is_that_of_a_sphere_and_of_a_cylinder() -> None:
    """2 / r and 1 / r, bent towards the camera; a plane has none."""
    camera = camera_model("picoflexx")
    rays = camera.rays32
    everywhere = np.ones(camera.shape, bool)
    middle = (slice(60, 110), slice(80, 150))
    for kind, expected in (("sphere", 2.0 / 0.05), ("cylinder", 1.0 / 0.05), ("plane", 0.0)):
        along = rays if kind == "sphere" else rays[..., [0, 2]]
        a, b, c = (along**2).sum(axis=2), 0.13, 0.13**2 - 0.05**2
        depth = (b - np.sqrt(np.maximum(b * b - a * c, 0.0))) / a if kind != "plane" else np.full(camera.shape, 0.08)
        found = curvature(camera, depth.astype(np.float32), everywhere)[middle]
        assert_allclose(np.abs(found), expected, atol=1.0)
        assert kind == "plane" or (np.sign(found) == np.sign(found[0, 0])).all()


BENDS, HALF, FLOOR = 15.0, 0.045, 0.075  # [1/m] of a membrane at rest, [m] from its middle to its rim, [m] to the rim
RADIUS, TOP = 0.03, 0.5 * BENDS * HALF**2 - 0.014  # [m] of a cylinder, and how far over the rim it presses the middle


def tool(x: Array) -> Array:
    return np.asarray(TOP + RADIUS - np.sqrt(RADIUS**2 - np.square(np.minimum(x, 0.02))))


def slope(x: float) -> float:
    return float(x / np.sqrt(RADIUS**2 - x**2))


def beyond(x: Array, edge: float) -> Array:
    """Height of the membrane that leaves the tool at `edge`, under the pressure at rest."""
    return np.asarray(tool(np.array(edge)) + slope(edge) * (x - edge) - 0.5 * BENDS * (x - edge) ** 2)


EDGE = float(brentq(lambda e: float(beyond(np.array(HALF), e)), 0.001, 0.014))  # [m] of contact: it ends at the rim


def seen(height: Callable[[Array], Array]) -> Image:
    """Depth of a membrane of some height over its rim, the same all along z."""
    rays = camera_model("picoflexx").rays
    depth = np.full(rays.shape[:2], 0.085)
    for _ in range(60):
        depth += 0.5 * (FLOOR + height(np.abs(depth * rays[..., 0])) - depth)
    return depth.astype(np.float32)


def test_a_membrane_that_hangs_free_is_not_taken_for_the_tool() -> None:
    """Under a pressure that stays the same an imprint falls evenly up to the rim, far more slowly than `decay`."""
    p, camera = EstimatorParameters(), camera_model("picoflexx")
    rest = seen(lambda x: 0.5 * BENDS * (HALF**2 - x**2))
    pressed = seen(lambda x: np.where(x < EDGE, tool(x), beyond(x, EDGE)))
    finder = PatchFinder(membrane_at_rest("left", camera, Hand().X_CL, [rest, rest], p))
    mask, _ = finder.find(pressed, p)
    dots = np.random.default_rng(5).uniform(400.0, 800.0, camera.shape).astype(np.float32)
    model = finger_model(finder, pressed, dots, mask, p)
    for points in (model.p, model.levels[0].p, model.levels[1].p):
        assert np.abs(points[0]).max() < EDGE + 0.002  # curvature is blurred by as much
        assert np.abs(points[0]).max() > 0.6 * EDGE

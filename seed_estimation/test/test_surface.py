# SPDX-License-Identifier: Apache-2.0
"""The smooth surface of a membrane at rest is told from what a camera gets wrong."""

import numpy as np
from numpy.testing import assert_allclose

from seed_estimation.contact.surface import fitted_parabolas
from seed_estimation.material.patch import curvature
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

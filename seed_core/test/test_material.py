# SPDX-License-Identifier: Apache-2.0
"""Points that are moved by a known rigid motion and a known smooth field give both back."""

import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from seed_core.membrane.material import BAND, around, deformation, patch_of, rigid_motion


def _points(rng: np.random.Generator) -> np.ndarray:
    """Of a bulging patch, off the origin."""
    x, z = rng.uniform(-0.008, 0.012, 400), rng.uniform(-0.03, 0.01, 400)
    return np.stack((x, 0.012 - 20.0 * x * x, z))


def test_a_rigid_motion_is_found_and_nothing_is_left() -> None:
    p = _points(np.random.default_rng(1))
    R, t = Rotation.from_rotvec((0.2, -0.4, 0.1)), np.array(((0.003,), (-0.001,), (0.005,)))
    after = R.as_matrix() @ p + t
    X = rigid_motion(p, after)
    assert_allclose(X[:3, :3], R.as_matrix(), atol=1e-12)
    assert_allclose(X[:3, 3:], t, atol=1e-12)
    assert_allclose(deformation(X, p, after), 0.0, atol=1e-12)


def test_the_band_lies_around_the_patch() -> None:
    x, z = (1e-3 * g.ravel() for g in np.meshgrid(np.arange(-30.0, 31.0), np.arange(-40.0, 41.0)))
    p = np.stack((x, 0.0 * x, z))
    patch = p[:, (np.abs(x) <= 0.010) & (np.abs(z) <= 0.020)]
    band = around(p, patch)
    away = np.hypot(np.maximum(np.abs(x) - 0.010, 0.0), np.maximum(np.abs(z) - 0.020, 0.0))
    clear = (np.abs(away - BAND[0]) > 1e-9) & (np.abs(away - BAND[1]) > 1e-9)  # not on an edge of the band
    assert (band == ((away > BAND[0]) & (away < BAND[1])))[clear].all()


def test_the_rigid_part_is_that_of_a_general_least_squares_fit() -> None:
    """SciPy's own fit of a rotation to centred points; no reflection comes out of a patch that is turned inside out."""
    rng = np.random.default_rng(2)
    p = _points(rng)
    after = p + rng.normal(0.0, 1e-3, p.shape)
    X = rigid_motion(p, after)
    middle, now = p.mean(axis=1, keepdims=True), after.mean(axis=1, keepdims=True)
    assert_allclose(X[:3, :3], Rotation.align_vectors((after - now).T, (p - middle).T)[0].as_matrix(), atol=1e-7)
    assert_allclose(X[:3, :3] @ middle + X[:3, 3:], now, atol=1e-15)
    assert np.linalg.det(rigid_motion(p, np.diag((-1.0, 1.0, 1.0)) @ p)[:3, :3]) > 0.0


def test_every_coefficient_is_told_from_the_others() -> None:
    """Each of the nine fields as the docstring writes it, in metres over u and v."""
    p = _points(np.random.default_rng(3))
    size = np.sqrt(np.square(p[[0, 2]] - p[[0, 2]].mean(axis=1, keepdims=True)).sum(axis=0).mean())
    u, v = (p[[0, 2]] - p[[0, 2]].mean(axis=1, keepdims=True)) / size
    o = np.zeros_like(u)
    fields = [(u, o), (o, v), (v, u), (u * u, o), (u * v, o), (v * v, o), (o, u * u), (o, u * v), (o, v * v)]
    for i, (dx, dz) in enumerate(fields):
        after = p + 1e-3 * np.stack((dx, o, dz))
        assert_allclose(deformation(np.eye(4), p, after), 1e-3 * np.eye(9)[i], atol=1e-12)


def test_powers_are_about_the_middle_and_in_units_of_the_size() -> None:
    p = _points(np.random.default_rng(4))
    powers = patch_of(p).powers(p)
    assert_allclose(powers[1:3].mean(axis=1), 0.0, atol=1e-12)
    assert_allclose(powers[3].mean() + powers[5].mean(), 1.0)
    assert_allclose(powers[4], powers[1] * powers[2])

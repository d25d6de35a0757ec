# SPDX-License-Identifier: Apache-2.0
"""Vectors in tuples against NumPy's."""

import numpy as np
from numpy.testing import assert_allclose

from seed_core.spatial import pose_from_rpy
from seed_core.vector3 import as_vector3, capped, dot, minus, norm, plus, plus_scaled, scaled, transformed

A, B = np.random.default_rng(2).standard_normal((2, 3))
X = pose_from_rpy((0.3, -0.8, 2.0), (1.0, -2.0, 0.5))


def test_each_is_numpys() -> None:
    a, b = as_vector3(A), as_vector3(B)
    for found, expected in (
        (dot(a, b), A @ B),
        (norm(a), np.linalg.norm(A)),
        (plus(a, b), A + B),
        (minus(a, b), A - B),
        (scaled(a, 3.0), 3.0 * A),
        (plus_scaled(a, -2.0, b), A - 2.0 * B),
        (transformed(X.tolist(), a), X[:3, :3] @ A + X[:3, 3]),
    ):
        assert_allclose(found, expected, rtol=1e-15, atol=1e-15)


def test_a_capped_vector_keeps_its_direction_and_a_short_one_itself() -> None:
    assert capped((3.0, 4.0, 0.0), 5.0) == (3.0, 4.0, 0.0)
    assert_allclose(capped((3.0, 4.0, 0.0), 1.0), (0.6, 0.8, 0.0), rtol=1e-15)
    assert capped((0.0, 0.0, 0.0), 0.0) == (0.0, 0.0, 0.0)

# SPDX-License-Identifier: Apache-2.0
"""Force directions go on from the ones before while a frame turns; a new projector starts anew."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_control.law.directions import force_directions
from seed_core.spatial import Array, rotation_from_rpy

RNG = np.random.default_rng(3)


def projector(rank: int) -> Array:
    basis = np.linalg.qr(RNG.normal(size=(3, 3)))[0][:, :rank]
    return np.asarray(basis @ basis.T)


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_directions_span_the_range_of_the_projector(rank: int) -> None:
    for _ in range(50):
        P = projector(rank)
        n, goes_on = force_directions(P, None)
        assert not goes_on
        assert n.shape == (rank, 3)
        assert_allclose(n @ n.T, np.eye(rank), atol=1e-12)
        assert_allclose(n.T @ n, P, atol=1e-12)


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_none_changes_sign_or_place_while_the_frame_turns_all_the_way_round(rank: int) -> None:
    P = np.diag([0.0, 1.0, 1.0]) if rank == 2 else np.diag([0.0, 0.0, 1.0]) if rank == 1 else np.eye(3)
    before, _ = force_directions(P, None)
    for angle in np.arange(0.0, 2.0 * np.pi, 0.05):
        R = rotation_from_rpy((angle, 0.4 * np.sin(angle), 0.3 * np.sin(2.0 * angle)))
        n, goes_on = force_directions(R @ P @ R.T, before)
        assert goes_on
        assert np.abs(n - before).max() < 0.15
        assert_allclose(n.T @ n, R @ P @ R.T, atol=1e-12)
        before = n


def test_a_jump_or_another_number_of_directions_starts_anew() -> None:
    up, side = np.diag([0.0, 0.0, 1.0]), np.diag([1.0, 0.0, 0.0])
    before, _ = force_directions(up, None)
    assert not force_directions(side, before)[1]
    assert not force_directions(up + side, before)[1]
    assert force_directions(up, before)[1]
    assert force_directions(np.zeros((3, 3)), np.zeros((0, 3)))[1]


@pytest.mark.parametrize("rank", [1, 2])
def test_a_new_start_has_the_signs_of_the_task_frame_at_every_angle(rank: int) -> None:
    """In the world's axes a direction at -45 degrees would change its sign from one noisy image to the next."""
    P = np.diag([0.0, 1.0, float(rank > 1)])
    for angle in np.deg2rad(np.arange(-180.0, 180.0, 7.5)):
        for off in (-1e-3, 1e-3):
            R = rotation_from_rpy((0.0, 0.0, angle + off))
            n, _ = force_directions(R @ P @ R.T, None, R)
            assert_allclose(n, R.T[1 : 1 + rank], atol=1e-12)

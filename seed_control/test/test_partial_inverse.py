# SPDX-License-Identifier: Apache-2.0
"""The partial inverses against the map itself, for every selection, and the hybrid of force and position."""

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_control.law.partial_inverse import PartialInverseError, hybrid_force_position, hybrid_torque_orientation
from seed_core.bushing import Bushing, Stiffness
from seed_core.spatial import rotation_from_rpy

K = (4.0, 3.0, 4.0)
MAP = Bushing(Stiffness(K, (800.0, 1200.0, 800.0)), "plain")
SELECTIONS = list(product([False, True], repeat=3))


def triple(values: np.ndarray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


@pytest.mark.parametrize("is_torque", SELECTIONS)
def test_every_selection_finds_the_angles_that_made_the_torques(is_torque: tuple[bool, bool, bool]) -> None:
    rng = np.random.default_rng(4)
    for i in range(500):
        q = np.deg2rad(30.0) * rng.uniform(-1, 1, 3) * (1e-7 if i % 10 == 0 else 1.0)
        found = hybrid_torque_orientation(K, triple(MAP.torque(q)), triple(q), is_torque)
        assert_allclose(found, q, atol=2e-14)  # some roundings of an angle below 0.6


@pytest.mark.parametrize("is_torque", SELECTIONS)
def test_given_angles_and_torques_are_met_exactly(is_torque: tuple[bool, bool, bool]) -> None:
    rng = np.random.default_rng(5)
    for _ in range(300):
        torque, angles = 0.8 * rng.uniform(-1, 1, 3), np.deg2rad(20.0) * rng.uniform(-1, 1, 3)
        q = np.array(hybrid_torque_orientation(K, triple(torque), triple(angles), is_torque))
        reached = MAP.torque(q)
        for i, on in enumerate(is_torque):
            assert_allclose(reached[i] if on else q[i], torque[i] if on else angles[i], atol=2e-14)


def pitches(k: tuple[float, float, float], ty: float, roll: float, yaw: float) -> np.ndarray:
    """Every pitch within 60 degrees at which the map itself gives ty, by its changes of sign on a fine grid."""
    grid = np.deg2rad(np.linspace(-60.0, 60.0, 2401))
    bushing = Bushing(Stiffness(k, (800.0, 1200.0, 800.0)), "plain")
    miss = np.array([bushing.torque(np.array((roll, p, yaw)))[1] for p in grid]) - ty
    i = np.flatnonzero(np.sign(miss[1:]) != np.sign(miss[:-1]))
    return np.asarray(grid[i] - miss[i] * (grid[i + 1] - grid[i]) / (miss[i + 1] - miss[i]))


@pytest.mark.parametrize(
    ("k", "ty", "roll", "yaw"),
    [
        (K, 0.6, 1.5, 0.4),
        ((4.0, 1.2, 4.0), -1.1, 1.3, -0.3),
        ((6.0, 1.0, 2.0), 2.6, 0.8, 0.6),
        ((6.0, 1.0, 2.0), -3.8, 0.8, -0.9),
        ((6.0, 1.0, 2.0), -3.8, -0.8, 0.9),
        ((0.3, 0.05, 0.1), 0.13, 0.8, 0.6),
        ((0.3, 0.05, 0.1), -0.19, 0.8, -0.9),
        ((6.0, 1.0, 2.0), 3.9, 0.8, 1.5707),  # sideways: ty hardly depends on the pitch itself
    ],
)
def test_of_two_pitches_for_one_torque_the_one_next_to_the_measured_is_taken(
    k: tuple[float, float, float], ty: float, roll: float, yaw: float
) -> None:
    """With the roll held and large, ty is not monotone in pitch."""
    expected = pitches(k, ty, roll, yaw)
    assert len(expected) == 2
    torque, angles, which = (0.0, ty, 0.0), (roll, 0.0, yaw), (False, True, False)
    middle = expected.mean()
    for near, root in ((-2.0, 0), (middle - 1e-3, 0), (middle + 1e-3, 1), (2.0, 1)):
        q = hybrid_torque_orientation(k, torque, angles, which, near)
        assert_allclose(q[1], expected[root], atol=1e-4)  # [rad], of the grid
    listed = ", ".join(f"{np.rad2deg(p):.1f}" for p in expected)
    with pytest.raises(
        PartialInverseError, match=rf"ty = {ty:.3g} N m .* pitches of {listed} deg.*give the measured pitch"
    ):
        hybrid_torque_orientation(k, torque, angles, which)


@pytest.mark.parametrize(
    ("torque", "angles", "is_torque", "words"),
    [
        ((0.0, 0.0, 13.0), (0.0, 0.0, 0.0), (False, False, True), "tz = 13 N m needs a yaw of 186 degrees"),
        ((0.0, 5.0, 0.0), (0.0, 0.0, 0.0), (True, True, False), "ty = 5 N m needs a pitch of 95 degrees"),
        ((13.0, 0.0, 0.0), (0.0, 0.0, 0.0), (True, False, False), "tx = 13 N m needs a roll of 186 degrees"),
        ((0.0, 9.0, 0.0), (0.0, 0.0, 0.0), (False, True, False), "cannot be reached with a pitch within 60 degrees"),
        ((1.0, 0.0, 0.0), (0.0, 0.0, np.pi / 2), (True, False, False), "yaw of 90.0 degrees"),
        ((0.0, 0.7, 0.0), (0.0, 2.0, 0.0), (False, False, False), "ty = 0.7 N m needs a pitch of 115 degrees"),
        ((0.0, 0.0, np.nan), (0.0, 0.0, 0.0), (False, False, True), "tz = nan N m"),
    ],
)
def test_what_has_no_solution_is_refused_with_numbers(
    torque: tuple[float, float, float],
    angles: tuple[float, float, float],
    is_torque: tuple[bool, bool, bool],
    words: str,
) -> None:
    with pytest.raises(PartialInverseError, match=words):
        hybrid_torque_orientation(K, torque, angles, is_torque)


def test_a_torque_out_of_reach_is_refused_with_what_can_be_reached() -> None:
    roll, yaw = 1.0, 0.5
    ends = sorted(MAP.torque(np.array((roll, p, yaw)))[1] for p in np.deg2rad((-60.0, 60.0)))
    words = rf"ty = 9 N m .* from {ends[0]:.3g} to {ends[1]:.3g} N m"
    with pytest.raises(PartialInverseError, match=words):
        hybrid_torque_orientation(K, (0.0, 9.0, 0.0), (roll, 0.0, yaw), (False, True, False))


@pytest.mark.parametrize("pitch", np.deg2rad((-60.0, 60.0)))
def test_the_ends_of_the_range_are_reached(pitch: float) -> None:
    q = hybrid_torque_orientation(K, (0.0, K[1] * pitch, 0.0), (0.0, 0.0, 0.0), (False, True, False))
    assert_allclose(q, (0.0, pitch, 0.0), rtol=1e-15)


def test_hybrid_force_position_meets_force_and_position_along_any_directions() -> None:
    rng = np.random.default_rng(6)
    for rank in (0, 1, 2, 3):
        for _ in range(50):
            basis = np.linalg.qr(rng.normal(size=(3, 3)))[0][:, :rank]
            P = basis @ basis.T
            R = rotation_from_rpy(0.5 * rng.uniform(-1, 1, 3))
            stiffness = R @ np.diag([800.0, 1200.0, 700.0]) @ R.T
            wanted, force = 0.01 * rng.normal(size=3), 10.0 * rng.normal(size=3)
            d = hybrid_force_position(P, stiffness, wanted, force)
            assert_allclose(P @ stiffness @ d, P @ force, atol=1e-11)  # [N]
            assert_allclose(d - P @ d, wanted - P @ wanted, atol=1e-15)  # [m]


def test_isotropic_hybrid_is_the_formula_of_the_paper() -> None:
    """p_WC = S p_des + (I - S)(p_WT + K^-1 f), Sec. V-C1."""
    P, k = np.diag([0.0, 0.0, 1.0]), 900.0
    d = hybrid_force_position(P, k * np.eye(3), np.array((0.01, 0.02, 0.5)), np.array((7.0, 7.0, -9.0)))
    assert_allclose(d, (0.01, 0.02, -0.01), atol=1e-16)

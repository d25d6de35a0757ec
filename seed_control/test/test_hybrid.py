# SPDX-License-Identifier: Apache-2.0
"""The partial inverses against the map itself, for every selection, and the hybrid of force and position."""

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_control.law.partial_inverse import PartialInverseError, hybrid_translation, partial_angles
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
        found = partial_angles(K, triple(MAP.torque(q)), triple(q), is_torque)
        assert_allclose(found, q, atol=2e-14)  # some roundings of an angle below 0.6


@pytest.mark.parametrize("is_torque", SELECTIONS)
def test_given_angles_and_torques_are_met_exactly(is_torque: tuple[bool, bool, bool]) -> None:
    rng = np.random.default_rng(5)
    for _ in range(300):
        torque, angles = 0.8 * rng.uniform(-1, 1, 3), np.deg2rad(20.0) * rng.uniform(-1, 1, 3)
        q = np.array(partial_angles(K, triple(torque), triple(angles), is_torque))
        reached = MAP.torque(q)
        for i, on in enumerate(is_torque):
            assert_allclose(reached[i] if on else q[i], torque[i] if on else angles[i], atol=2e-14)


def test_two_pitches_for_one_torque_need_the_measured_one() -> None:
    """Roll held and yaw large: ty is not monotone in pitch, and the nearest root is taken."""
    k, angles = (4.0, 3.0, 4.0), (1.0, 0.0, np.deg2rad(-60.0))
    found = []
    for near in (-1.0, 1.0):
        value = partial_angles(k, (0.0, -5.0, 0.0), angles, (False, True, False), near)
        torque = Bushing(Stiffness(k, (1.0, 1.0, 1.0)), "plain").torque(np.array(value))
        assert_allclose(torque[1], -5.0, atol=1e-12)
        found.append(value[1])
    if abs(found[0] - found[1]) > 1e-6:
        with pytest.raises(PartialInverseError, match="give the measured pitch"):
            partial_angles(k, (0.0, -5.0, 0.0), angles, (False, True, False))


@pytest.mark.parametrize(
    ("torque", "angles", "is_torque", "words"),
    [
        ((0.0, 0.0, 13.0), (0.0, 0.0, 0.0), (False, False, True), "yaw of 186 degrees"),
        ((0.0, 5.0, 0.0), (0.0, 0.0, 0.0), (True, True, False), "pitch of 95 degrees"),
        ((13.0, 0.0, 0.0), (0.0, 0.0, 0.0), (True, False, False), "roll of 186 degrees"),
        ((0.0, 9.0, 0.0), (0.0, 0.0, 0.0), (False, True, False), "cannot be reached with a pitch within 60 degrees"),
        ((1.0, 0.0, 0.0), (0.0, 0.0, np.pi / 2), (True, False, False), "yaw of 90.0 degrees"),
    ],
)
def test_what_has_no_solution_is_refused_with_numbers(
    torque: tuple[float, float, float],
    angles: tuple[float, float, float],
    is_torque: tuple[bool, bool, bool],
    words: str,
) -> None:
    with pytest.raises(PartialInverseError, match=words):
        partial_angles(K, torque, angles, is_torque)


def test_hybrid_translation_meets_force_and_position_along_any_directions() -> None:
    rng = np.random.default_rng(6)
    for rank in (0, 1, 2, 3):
        for _ in range(50):
            basis = np.linalg.qr(rng.normal(size=(3, 3)))[0][:, :rank]
            P = basis @ basis.T
            R = rotation_from_rpy(0.5 * rng.uniform(-1, 1, 3))
            stiffness = R @ np.diag([800.0, 1200.0, 700.0]) @ R.T
            wanted, force = 0.01 * rng.normal(size=3), 10.0 * rng.normal(size=3)
            d = hybrid_translation(P, stiffness, wanted, force)
            assert_allclose(P @ stiffness @ d, P @ force, atol=1e-11)  # [N]
            assert_allclose(d - P @ d, wanted - P @ wanted, atol=1e-15)  # [m]


def test_isotropic_hybrid_is_the_formula_of_the_paper() -> None:
    """p_WC = S p_des + (I - S)(p_WT + K^-1 f), Sec. V-C1."""
    P, k = np.diag([0.0, 0.0, 1.0]), 900.0
    d = hybrid_translation(P, k * np.eye(3), np.array((0.01, 0.02, 0.5)), np.array((7.0, 7.0, -9.0)))
    assert_allclose(d, (0.01, 0.02, -0.01), atol=1e-16)

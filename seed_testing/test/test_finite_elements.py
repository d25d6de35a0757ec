# SPDX-License-Identifier: Apache-2.0
"""Finite elements inverted on seen dots: stress by hand, Laplace's law, no load where nothing touches, symmetry."""

import numpy as np
import pytest

from seed_testing.validation.maps.finite_elements import POISSON, FiniteElements, Sheet

R, HALF = 0.08, 0.03  # [m] of a sphere, and of the square sheet that was printed
PRESSURE = 3000.0  # [Pa]


def grid(n: int = 17) -> np.ndarray:
    x, z = np.meshgrid(*[np.linspace(-HALF, HALF, n)] * 2)
    return np.column_stack((x.ravel(), z.ravel()))


def cap(flat: np.ndarray, side: float) -> np.ndarray:
    """Of a sphere, bulging towards +y or -y."""
    y = np.sqrt(R**2 - (flat**2).sum(axis=1)) - R
    return np.column_stack((flat[:, 0], side * y, flat[:, 1]))


def still(sheet: Sheet, nodes: np.ndarray) -> np.ndarray:
    return sheet.seen(nodes, 0.0, np.random.default_rng(0))


def test_a_stretched_sheet_pulls_as_worked_out_by_hand() -> None:
    flat, stretch = grid(), 0.05
    plane = np.column_stack((flat[:, 0], np.zeros(len(flat)), flat[:, 1]))
    sheet = Sheet(flat, plane, 0.0)
    x = still(sheet, plane * (1.0 + stretch, 1.0, 1.0))
    left = sheet.flat[:, 0] < 0.0
    corners = x[sheet._triangles]
    F = sheet._deformation(corners)
    strain = 0.5 * (np.einsum("mka,mkb->mab", F, F) - np.eye(2))
    trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
    S = ((1.0 - POISSON) * strain + POISSON * trace * np.eye(2)) / (1.0 - POISSON**2)
    pull = sheet._gathered(sheet._at_corners(F, S))[left].sum(axis=0)
    green = stretch + 0.5 * stretch**2
    by_hand = (1.0 + stretch) * green / (1.0 - POISSON**2) * 2.0 * HALF  # P = F S, over the sheet's width
    assert pull == pytest.approx((by_hand, 0.0, 0.0), rel=0.03, abs=0.02 * by_hand)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_bubble_at_rest_bears_laplaces_tension_and_loads_nothing(side: float) -> None:
    flat = grid()
    sheet = Sheet(flat, rest := cap(flat, side), PRESSURE)
    inner = np.linalg.norm(sheet.flat[sheet._triangles].mean(axis=1), axis=1) < 0.5 * HALF
    tension = 0.5 * np.trace(sheet._rest[inner], axis1=1, axis2=2)
    assert float(np.median(tension)) == pytest.approx(0.5 * PRESSURE * R, rel=0.1)
    load = sheet.loads(still(sheet, rest), flat[np.linalg.norm(flat, axis=1) < 0.01], PRESSURE)
    push = PRESSURE * np.pi * 0.015**2
    assert np.abs(load[:, 0, 3:]).max() < 0.03 * push
    assert np.abs(load[:, 1]).max() < 1e-9


def test_bubbles_that_mirror_each_other_load_the_tool_alike() -> None:
    flat = grid()
    touching, loads = flat[np.linalg.norm(flat - (0.004, 0.0), axis=1) < 0.01], []
    for side in (1.0, -1.0):
        sheet = Sheet(flat, rest := cap(flat, side), PRESSURE)
        pressed = rest.copy()
        pressed[:, 1] -= side * 0.002 * np.exp(-((flat - (0.004, 0.0)) ** 2).sum(axis=1) / 0.01**2)
        loads.append(sheet.loads(still(sheet, pressed), touching, PRESSURE))
    mirror = np.array((-1.0, 1.0, -1.0, 1.0, -1.0, 1.0))  # of (torque, force) in the plane y = 0
    np.testing.assert_allclose(loads[0], mirror * loads[1], atol=1e-9)
    pushes = loads[0][:, 0, 4] + 300.0 * loads[0][:, 1, 4]
    assert (pushes > 0.0).all()  # out of the finger


def test_the_stiffness_is_found_again() -> None:
    rng = np.random.default_rng(1)
    changes = rng.normal(size=(20, 2, 2, 6))
    wrench = changes[:, 0, 0] + 400.0 * changes[:, 0, 1]
    fit = FiniteElements.fitted(changes, wrench)
    assert fit.stiffness[0] == pytest.approx(400.0)
    np.testing.assert_allclose(fit.wrench(changes)[0], wrench)

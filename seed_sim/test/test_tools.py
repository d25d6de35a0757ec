# SPDX-License-Identifier: Apache-2.0
"""Tools have proper inertia, and the numerics' check knows their natural frequencies."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.hand import DEFAULT_STIFFNESS, Frame, Tool
from seed_sim.plant.grip import damping_of, fastest_rate
from seed_sim.plant.tools import TOOLS, inertia_of, shape_of


def inertia(kind: str, com=(0.0, 0.0, 0.06), mass=0.2, pad=0.0):
    return inertia_of(shape_of(kind, Tool()), mass, np.array(com), pad, 0.02)


@pytest.mark.parametrize("kind", TOOLS)
def test_inertia_is_that_of_a_body(kind):
    about_T = inertia(kind).about_T
    assert_allclose(about_T, about_T.T)
    principal = np.sort(np.linalg.eigvalsh(about_T))
    assert principal[0] > 0.0
    assert principal[2] <= principal[0] + principal[1] + 1e-12  # triangle inequality


@pytest.mark.parametrize("kind", TOOLS)
def test_every_tool_touches_with_its_tip_first(kind):
    tool = Tool(T_tip=Frame((0.0, 0.0, 0.1)))
    assert_allclose(shape_of(kind, tool).points[:, 2].max(), 0.1)


@pytest.mark.parametrize("width", [0.01, 0.05, 0.5])
def test_a_blade_touches_over_its_width_and_turns_as_a_body_does(width: float) -> None:
    shape = shape_of("squeegee", Tool(), width)
    assert_allclose(np.ptp(shape.points[:, 1]), width)
    x, y, z = shape.gyration**2
    assert x < y + z
    assert y < x + z
    rod = 0.8 * (width**2 - 0.2**2) / 12.0  # a rod of width w: m w^2 / 12
    assert_allclose(x - 0.062**2, rod)
    assert_allclose(z - 0.058**2, rod)


def test_moment_of_inertia_follows_steiner():
    at_T, away = inertia("squeegee", (0.0, 0.0, 0.0)), inertia("squeegee", (0.0, 0.03, 0.04))
    assert_allclose(away.about_T[0, 0] - at_T.about_T[0, 0], 0.2 * 0.05**2)
    assert_allclose(away.about_T[1, 2], -0.2 * 0.03 * 0.04)


def test_fastest_rate_is_the_plain_oscillator_s_without_coupling():
    still = inertia("squeegee", (0.0, 0.0, 0.0))
    k_over_m = np.concatenate(
        [
            np.array(DEFAULT_STIFFNESS.rotation) / np.diag(still.about_T),
            np.array(DEFAULT_STIFFNESS.translation) / still.moving_mass,
        ]
    )
    assert_allclose(fastest_rate(still, DEFAULT_STIFFNESS, 0.0), np.sqrt(k_over_m.max()), rtol=1e-9)


def test_off_centre_mass_makes_it_faster():
    assert fastest_rate(inertia("squeegee"), DEFAULT_STIFFNESS, 0.3) > fastest_rate(
        inertia("squeegee", (0.0, 0.0, 0.0)), DEFAULT_STIFFNESS, 0.3
    )


def test_damping_has_the_ratio_that_was_asked_for():
    tool = inertia("peg", pad=0.05)
    rotation, translation = damping_of(tool, DEFAULT_STIFFNESS, 0.3)
    assert_allclose(translation / (2.0 * np.sqrt(np.array(DEFAULT_STIFFNESS.translation) * tool.moving_mass)), 0.3)
    assert_allclose(rotation / (2.0 * np.sqrt(np.array(DEFAULT_STIFFNESS.rotation) * np.diag(tool.about_T))), 0.3)

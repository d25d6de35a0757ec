# SPDX-License-Identifier: Apache-2.0
"""The stiffness schedule: lines through grips, and trends that are claimed only where the data bear them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import linregress, t
from synthetic_problem import made

from seed_sysid.fit.identification_fit import Solution, fit_stiffness
from seed_sysid.fit.stiffness_schedule import fit_line, fit_schedule

WIDTHS = np.array([0.014, 0.017, 0.020, 0.023, 0.026])
PRESSURES = 1030.0 - 1500.0 * (WIDTHS - 0.020)


def with_stiffness(stiffness: np.ndarray, std: float) -> Solution:
    """A solution of these grips with this relative standard deviation."""
    s = fit_stiffness(made()[0])
    return replace(s, value=s.value._replace(stiffness=stiffness), std=s.std._replace(stiffness=std * stiffness))


def test_a_line_is_the_regression_and_its_interval() -> None:
    rng = np.random.default_rng(3)
    x, y = np.linspace(2.0, 5.0, 9), rng.normal(size=9)
    line, known = fit_line(x, y, np.zeros(9)), linregress(x, y)
    np.testing.assert_allclose(line.slope, known.slope)
    np.testing.assert_allclose(line.at(x), known.intercept + known.slope * x)
    np.testing.assert_allclose(line.slope_interval, t.ppf(0.975, 7) * known.stderr)
    np.testing.assert_allclose(line.scatter, np.sqrt(((y - line.at(x)) ** 2).sum() / 7))


def test_a_line_scatters_at_least_as_its_values_do() -> None:
    x = np.array([1.0, 2.0, 3.0])
    line = fit_line(x, 2.0 * x, np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(line.scatter, np.sqrt(0.14 / 3.0))
    np.testing.assert_allclose(line.slope_interval, t.ppf(0.975, 1) * line.scatter / np.sqrt(2.0))


def test_two_points_claim_no_slope() -> None:
    line = fit_line(np.array([1.0, 2.0]), np.array([1.0, 9.0]), np.array([0.1, 0.1]))
    assert line.slope == pytest.approx(8.0)
    assert line.slope_interval == np.inf


def test_pressure_falls_with_width_and_stiffness_grows_where_it_does() -> None:
    base, grows = np.array([4.0, 3.0, 4.0, 800.0, 1200.0, 600.0]), np.array([1, 0, 0, 1, 1, -1])
    stiffness = base * (1.0 + 0.02 * np.outer(PRESSURES - 1030.0, grows))
    schedule = fit_schedule(WIDTHS, PRESSURES, with_stiffness(stiffness, 0.001))
    assert schedule is not None
    assert schedule.gripper is not None
    assert schedule.gripper.slope == pytest.approx(1500.0)
    np.testing.assert_allclose(schedule.gripper.at_width(WIDTHS), PRESSURES)
    assert schedule.trend == (True, False, False, True, True, False)
    assert len(schedule.warnings) == 1
    assert "no reliable trend with pressure in pitch, yaw, z (" in schedule.warnings[0]


@pytest.mark.parametrize(("slope", "std", "claimed"), [(0.01, 0.001, True), (0.01, 0.2, False), (0.001, 1e-6, False)])
def test_a_trend_must_be_significant_and_worth_mentioning(slope: float, std: float, claimed: bool) -> None:
    """18 hPa: 18 % are one, unless the values are uncertain by 20 %; 1.8 % are none however certain."""
    stiffness = np.outer(1.0 + slope * (PRESSURES - 1030.0), np.ones(6))
    schedule = fit_schedule(WIDTHS, PRESSURES, with_stiffness(stiffness, std))
    assert schedule is not None
    assert schedule.trend == (claimed,) * 6


def test_a_pressure_that_is_no_line_over_width_is_told() -> None:
    bent = PRESSURES + np.array([0.0, 6.0, 0.0, -6.0, 0.0])
    schedule = fit_schedule(WIDTHS, bent, with_stiffness(np.ones((5, 6)), 0.01))
    assert schedule is not None
    assert "pressure is not linear in width: it scatters by" in schedule.warnings[-1]


@pytest.mark.parametrize("pressures", [[1030.0] * 5, [np.nan] * 5, [1030.0, np.nan, 1020.0, 1010.0, 1000.0]])
def test_without_two_pressures_there_is_no_schedule(pressures: list[float]) -> None:
    assert fit_schedule(WIDTHS, np.array(pressures), with_stiffness(np.ones((5, 6)), 0.01)) is None


def test_grips_of_one_width_have_their_lines_over_pressure() -> None:
    stiffness = np.outer(1.0 + 0.01 * (PRESSURES - 1030.0), np.ones(6))
    schedule = fit_schedule(np.full(5, 0.02), PRESSURES, with_stiffness(stiffness, 0.001))
    assert schedule is not None
    assert schedule.gripper is None
    assert schedule.trend == (True,) * 6
    assert schedule.stiffness[0].slope == pytest.approx(0.01)
    assert "every grip has the width 0.02 m" in schedule.warnings[-1]

# SPDX-License-Identifier: Apache-2.0
"""Deadlines are exact while nothing is late and catch nothing up; periods are counted without being kept."""

import pytest

from seed_driver.process.cycle_timing import CLOSEST, Deadlines, PeriodHistogram

PERIOD = 0.002  # [s]


def test_the_deadlines_are_exact_while_nothing_is_late() -> None:
    deadlines, due = Deadlines(PERIOD, 0.0), 0.0
    for i in range(1000):
        assert due == pytest.approx(i * PERIOD, abs=1e-9)
        due = deadlines.next(due + (i % 3) * 1e-4)


def test_a_late_cycle_moves_all_that_follow() -> None:
    deadlines = Deadlines(PERIOD, 0.0)
    assert deadlines.next(0.0) == pytest.approx(PERIOD)
    late = deadlines.next(0.010)
    assert late == pytest.approx(0.010 + CLOSEST * PERIOD)  # no closer to the last command
    assert deadlines.next(late) == pytest.approx(late + PERIOD)  # at the rate again, and nothing is caught up


def test_periods_are_counted_in_bins_and_summed_up_every_500() -> None:
    periods, now = PeriodHistogram(), 100.0
    periods.tick(now)
    for i in range(500):
        now += 0.008 if i == 250 else PERIOD + 1e-5
        periods.tick(now)
    counted = periods.counts()
    assert counted["counts"][int((PERIOD + 1e-5) / counted["bin_s"])] == 499
    assert counted["max_s"] == pytest.approx(0.008)
    assert (periods.p50, periods.p99, periods.largest) == pytest.approx((PERIOD + 1e-5, PERIOD + 1e-5, 0.008))
    periods.tick(now + 1.0)  # a pause is no period
    assert sum(periods.counts()["counts"]) == 500
    now += 1.3  # nor does one of 0.3 s stop the cycles
    periods.tick(now)
    assert periods.counts()["counts"][-1] == 1
    assert periods.largest == pytest.approx(0.008)
    for i in range(999):
        now += PERIOD
        periods.tick(now)
        assert periods.largest == pytest.approx(0.008 if i < 498 else 0.3 if i < 998 else PERIOD)

# SPDX-License-Identifier: Apache-2.0
"""The clock of the cameras is set back while the tool presses."""

from dataclasses import replace
from math import inf, nan

import pytest
from quasi_static import Bench

from seed_control.monitor.stamp_step import StampStep
from seed_control.setpoint.setpoints import SetpointError
from seed_core.estimate import RelativePoseEstimate


def pressing() -> Bench:
    bench = Bench().enabled()
    bench.press(8.0)
    bench.run(2.0)
    return bench


def dated_early(estimate: RelativePoseEstimate) -> RelativePoseEstimate:
    return replace(estimate, stamp=estimate.stamp - 0.15)


def test_a_clock_that_was_set_back_holds_and_lets_no_force_until_it_is_right() -> None:
    bench = pressing()
    bench.told = dated_early
    state = bench.run(0.2)
    assert state.mode == "holding"
    assert "dated 15" in state.reason
    assert "set back" in state.reason
    bench.run(1.0)
    bench.controller.enable(bench.t)
    with pytest.raises(SetpointError, match=r"SP18.*set back"):
        bench.press(8.0)
    bench.told = lambda estimate: estimate
    bench.run(1.0)
    bench.press(8.0)
    assert bench.run(1.0).mode == "contact"


def test_images_that_come_late_are_no_clock_that_was_set_back() -> None:
    bench = pressing()
    for delay in (0.1, 0.15, 0.2):
        bench.delay = delay
        bench.run(0.3)
        assert not bench.controller.supervisor.stamps.reason
    assert bench.state.mode == "contact"


def test_one_image_that_another_has_overtaken_does_not_hold() -> None:
    bench, count = pressing(), iter(range(1000))
    bench.told = lambda estimate: dated_early(estimate) if next(count) % 10 < 2 else estimate
    assert bench.run(1.0).mode == "contact"
    assert not bench.controller.supervisor.stamps.reason


class Images:
    """At 45 a second, which a check of at most 0.1 s sees."""

    def __init__(self) -> None:
        self.check, self._now = StampStep(0.1), 1.0

    def come(self, count: int, delay: float = 0.05) -> bool:
        """Of stamps this far back [s]; whether it holds then."""
        for _ in range(count):
            self._now += 1.0 / 45.0
            self.check.update(self._now - delay, self._now)
        return bool(self.check.reason)


def test_stamps_that_are_no_number_do_not_blind_it() -> None:
    images = Images()
    images.come(10)
    for stamp, now in ((nan, 1.3), (inf, 1.3), (1.25, nan)):
        images.check.update(stamp, now)
    assert images.come(3, 0.2)


def test_images_as_late_as_they_came_to_be_are_right_again_after_25_in_a_row() -> None:
    """The usual delay has grown to 0.25 s, more than what a clock may be set back by at once."""
    images = Images()
    for i in range(200):
        assert not images.come(1, 0.05 + 1e-3 * i)
    images.come(40, 0.25)
    assert not images.come(2, 0.4)
    assert images.come(1, 0.4)
    assert "dated 15" in images.check.reason
    images.come(20, 0.4)
    assert images.come(24, 0.25)
    images.come(3, 0.4)
    assert images.come(24, 0.25)
    assert not images.come(1, 0.25)

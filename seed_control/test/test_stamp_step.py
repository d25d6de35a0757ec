# SPDX-License-Identifier: Apache-2.0
"""The clock of the cameras is set back while the tool presses."""

from dataclasses import replace

import pytest
from quasi_static import Bench

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

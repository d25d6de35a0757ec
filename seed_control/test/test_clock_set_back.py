# SPDX-License-Identifier: Apache-2.0
"""Stamps of a time still to come: they would pass for fresh, and nothing that comes afterwards for newer."""

import numpy as np
import pytest
from quasi_static import Bench

from seed_control import Controller, ControllerParameters
from seed_control.controller import ControlRefusedError
from seed_control.monitor.contradiction import WindowTest
from seed_control.monitor.correction import Correction
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Hand, Tool
from seed_core.spatial import make_pose, pose_from_rpy
from seed_core.wrench_settings import ReferenceSettings

X_WE = pose_from_rpy((np.pi, 0.0, 0.0), (0.4, 0.0, 0.3))
HANGING = make_pose(None, (0.0, 0.0, 0.2 * 9.81 / 800.0))


def run(controller: Controller, start: float, steps: int = 50) -> float:
    """Steps with good inputs; the time after them [s]."""
    for i in range(steps):
        t = start + 0.004 * i
        controller.add_kinematics(t, X_WE)
        if i % 5 == 0:
            controller.add_estimate(RelativePoseEstimate(t, HANGING, 1e-8 * np.eye(6)))
        controller.step(t)
    return start + 0.004 * steps


def made() -> Controller:
    return Controller(ControllerParameters(), Hand(), Tool(), DEFAULT_STIFFNESS)


def test_a_clock_that_is_set_back_holds_and_then_goes_on() -> None:
    controller = made()
    t = run(controller, 1000.0)
    controller.enable(t)
    assert controller.step(t).state.mode == "idle"
    t = run(controller, 980.0, steps=1)
    assert controller.state.mode == "holding"
    assert "the clock was set back by 20.196 s" in controller.state.reason
    t = run(controller, t)
    controller.enable(t)
    assert controller.step(t).state.mode == "idle"


def test_a_silent_arm_is_seen_after_the_clock_was_set_back() -> None:
    controller = made()
    t = run(controller, 1000.0)
    controller.enable(t)
    controller.step(990.0)
    with pytest.raises(ControlRefusedError):  # nothing has come since
        controller.enable(990.1)


@pytest.mark.parametrize("place", [(1e308, 0.0, 0.3), (450.0, 0.0, 300.0)])
def test_a_pose_further_than_any_arm_reaches_is_refused(place: tuple[float, float, float]) -> None:
    controller = made()
    t = run(controller, 1000.0)
    assert not controller.add_kinematics(t, make_pose(X_WE[:3, :3], place))
    assert not controller.add_estimate(RelativePoseEstimate(t, make_pose(None, place), 1e-8 * np.eye(6)))
    controller.step(t)
    assert "metres" in controller.state.reason or controller.state.mode == "disabled"


def later(bench: Bench, by: float) -> Bench:
    """The bench after all clocks were set back by so much [s]."""
    bench.t -= by
    bench._next_image = bench.t
    bench._queue.clear()
    return bench


def pressing_again(by: float) -> Bench:
    """It pressed with 5 N, the clocks were set back by so much [s], and it was enabled and told to press anew."""
    bench = Bench(noise=3e-4)
    bench.t = bench._next_image = 100.0
    bench.enabled()
    bench.press(5.0)
    assert bench.run(2.0).mode == "contact"
    assert later(bench, by).run(1.0).mode == "holding"
    bench.controller.enable(bench.t)
    bench.press(5.0)
    assert bench.run(2.0).mode == "contact", bench.state.reason
    return bench


@pytest.mark.parametrize("by", [5.0, 50.0])
def test_a_force_that_grows_holds_after_the_clock_was_set_back(by: float) -> None:
    bench = pressing_again(by)
    covariance = bench.controller.supervisor.known.covariance
    for _ in range(250):  # the table comes up by 40 mm in a second
        bench.table += 1.6e-4
        bench.step()
    assert bench.state.mode == "holding"
    assert "max_excess_force" in bench.state.reason
    assert bench.controller.supervisor.known.covariance is not covariance


def test_a_contradiction_is_seen_after_the_clock_was_set_back() -> None:
    test = WindowTest(0.3, 0.05)
    off = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 2.0))
    for i in range(30):
        test.add(100.0 + 0.1 * i, np.zeros(6), 1e-4 * np.eye(6), 1e-4 * np.eye(6))
    for i in range(30):
        test.add(0.1 * i, off, 1e-4 * np.eye(6), 1e-4 * np.eye(6))
    assert test.significant
    assert test.to_be_told(2.9)
    assert test.told().startswith("along the tool's z by +2.00")


def test_a_correction_goes_on_to_learn_after_the_clock_was_set_back() -> None:
    small = 1e-4 * np.eye(6)

    def learnt(shift: float) -> np.ndarray:
        correction = Correction(ReferenceSettings())
        for i in range(300):
            told = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 3.0))
            reference = told + np.eye(6)[5] * (0.5 if i < 100 else -0.5)
            correction.learn(0.1 * i - (shift if i >= 100 else 0.0), told, reference, small, small)
        return correction.mismatch(told)[0]

    np.testing.assert_allclose(learnt(500.0), learnt(0.0), atol=0.02)

# SPDX-License-Identifier: Apache-2.0
"""Stamps of a time still to come: they would pass for fresh, and nothing that comes afterwards for newer."""

import numpy as np
import pytest
from quasi_static import DOWN, Bench

from seed_control import Controller, ControllerParameters
from seed_control.controller import ControlRefusedError
from seed_control.grip import GripControl, GripSettings, Margin
from seed_control.monitor.arm_check import ArmCheck
from seed_control.monitor.contact.force_watch import ForceWatch
from seed_control.monitor.contradiction import WindowTest
from seed_control.monitor.correction import Correction
from seed_control.monitor.pressure_check import PressureCheck
from seed_control.monitor.weight_check import FreeSpaceSample
from seed_control.parameters import LAWS
from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.wrench.filters import WantedTurn
from seed_core.estimate import MembraneMotion, RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Hand, Tool
from seed_core.spatial import Wrench, make_pose, pose_from_rpy
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


def made(law: str = "seed") -> Controller:
    return Controller(ControllerParameters(law=law), Hand(), Tool(), DEFAULT_STIFFNESS)


@pytest.mark.parametrize("law", LAWS)
def test_a_clock_that_is_set_back_holds_and_then_goes_on(law: str) -> None:
    controller = made(law)
    t = run(controller, 1000.0)
    controller.enable(t)
    assert controller.step(t).state.mode == "idle"
    t = run(controller, 980.0, steps=1)
    assert controller.state.mode == "holding"
    assert "the clock was set back by 20.196 s" in controller.state.reason
    t = run(controller, t)
    controller.enable(t)
    assert controller.step(t).state.mode == "idle"


@pytest.mark.parametrize("law", LAWS)
def test_an_image_that_comes_before_the_first_pose_after_the_clock_was_set_back_is_borne(law: str) -> None:
    controller = made(law)
    t = run(controller, 1000.0)
    controller.enable(t)
    controller.step(990.0)
    controller.add_estimate(RelativePoseEstimate(990.0, HANGING, 1e-8 * np.eye(6)))
    assert controller.step(990.004).state.mode == "holding"
    t = run(controller, 990.008)
    controller.enable(t)
    assert controller.step(t).state.mode == "idle"


def test_a_clock_that_is_set_back_a_little_on_the_way_holds_at_once() -> None:
    """Or else what falls silent then would pass for fresh: no age is too old that is negative."""
    bench = later(moving(), 0.25)
    bench.estimates = bench.kinematics = False
    bench.step()
    assert "the clock was set back by 0.246 s (at most 0.005 s)" in bench.state.reason
    bench.estimates = bench.kinematics = True
    bench.run(0.5)
    bench.controller.enable(bench.t)
    bench.controller.set_setpoint(HybridSetpoint(DOWN), bench.t)
    assert bench.run(0.2).mode == "position"


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


def moving() -> Bench:
    """At full speed on its way down."""
    bench = Bench(start=make_pose(p=(0.0, 0.0, 0.4)) @ DOWN).enabled()
    bench.controller.set_setpoint(HybridSetpoint(DOWN), bench.t)
    bench.run(0.6)
    return bench


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
    covariance = bench.controller.supervisor.uncertainty.covariance
    for _ in range(250):  # the table comes up by 40 mm in a second
        bench.table += 1.6e-4
        bench.step()
    assert bench.state.mode == "holding"
    assert "max_excess_force" in bench.state.reason
    assert bench.controller.supervisor.uncertainty.covariance is not covariance


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


def test_an_excess_of_force_is_told_from_the_first_images_of_an_earlier_time() -> None:
    watch = ForceWatch(5.0)
    for i in range(60):
        watch.update(1000.0 + 0.02 * i, [10.0], [10.0], 0.01, settled=True)
    watch.clear()
    for i in range(5):
        watch.update(900.0 + 0.02 * i, [700.0 if i else 10.0], [10.0], 0.01, settled=True)
    assert "690.0 N above" in watch.reason


def test_an_arm_that_falls_silent_is_told_after_its_clock_was_set_back() -> None:
    check = ArmCheck(ReferenceSettings(), Hand().X_EC, Tool())
    check.add(1000.0, Wrench.zero())
    estimator = made().wrench_estimator
    for t in (900.0, 900.0 + 2.0 * ReferenceSettings().arm_timeout):
        m = estimator.measure(RelativePoseEstimate(t, HANGING, 1e-8 * np.eye(6)), X_WE)
        check.update(m, m.spring, m.spring, 1e-4 * np.eye(6), [], t)
    assert "arm_wrench is silent" in check.reason


@pytest.mark.parametrize("first", ["reading", "image"])
def test_a_reading_whose_offset_has_changed_is_of_use_again_after_the_clock_was_set_back(first: str) -> None:
    check, estimator, C = ArmCheck(ReferenceSettings(), Hand().X_EC, Tool()), made().wrench_estimator, 1e-4 * np.eye(6)
    seen = []
    for start, count, force in ((1000.0, 12, 5.0), (1002.0, 3, 25.0), (900.0, 12, 25.0)):
        for i in range(count):
            t = start + 0.1 * i
            m = estimator.measure(RelativePoseEstimate(t, HANGING, 1e-8 * np.eye(6)), X_WE)
            weight = estimator.true_weight(m.X_WT[:3, :3])
            free = FreeSpaceSample(m, m.spring.vector(), -weight.vector(), C, C, verified=True)
            if first == "reading" or i:
                for stamp in (t - 0.01, t, t + 0.01):
                    check.add(stamp, Wrench(np.zeros(3), np.array((0.0, 0.0, force))))
            check.update(m, m.spring, weight, C, [free], t + 0.01)
        seen.append(check.reading is not None)
    assert seen == [True, False, True]


def test_a_pressure_that_falls_silent_is_told_after_the_clock_was_set_back() -> None:
    check = PressureCheck((1100.0,), needed=True)

    def told(stamp: float, pressure: float) -> RelativePoseEstimate:
        motion = MembraneMotion("left", np.zeros(6), np.zeros((6, 6)), pressure=pressure)
        return RelativePoseEstimate(stamp, HANGING, membrane=(motion,))

    for stamp, pressure in ((1000.0, 1100.0), (900.0, np.nan), (902.0, np.nan)):
        check.update(told(stamp, pressure))
    assert "silent" in check.reason


def test_what_a_correction_has_learnt_ages_by_the_clock_that_was_set_back() -> None:
    deviations = []
    for start in (0.0, -1000.0):
        correction = Correction(ReferenceSettings())
        for i in range(400):
            t = 0.5 * i + (start if i >= 200 else 0.0)
            random = 1e-4 * np.eye(6) if i < 200 else 1e4 * np.eye(6)  # then nothing is learnt any more
            correction.learn(t, np.ones(6), np.ones(6), random, 1e-6 * np.eye(6))
        deviations.append(np.sqrt(correction.mismatch(np.ones(6))[1].diagonal()))
    np.testing.assert_allclose(deviations[1], deviations[0], rtol=0.02)


def test_a_stiffness_is_taken_over_though_the_clock_is_set_back_meanwhile() -> None:
    estimator = made().wrench_estimator
    estimator.set_stiffness(DEFAULT_STIFFNESS.scaled(2.0), 1000.0, 0.2)
    estimator.advance(1000.1)
    half = estimator.mean_stiffness
    estimator.advance(900.0)
    assert estimator.mean_stiffness == pytest.approx(half)
    estimator.advance(900.2)
    assert estimator.bushing.stiffness == DEFAULT_STIFFNESS.scaled(2.0)


def test_a_turn_is_counted_once() -> None:
    """Not again with an image that is answered no later, and anew after the clock was set back."""
    turn = WantedTurn()
    for stamp, angle in ((0.0, 0.0), (0.05, 0.01)):
        turn.update(pose_from_rpy((angle, 0.0, 0.0), (0.0, 0.0, 0.0))[:3, :3], (True,) * 3, stamp, 0.05, 1.0)
    assert not np.allclose(turn.step, np.eye(3))
    turn.update(pose_from_rpy((0.02, 0.0, 0.0), (0.0, 0.0, 0.0))[:3, :3], (True,) * 3, 0.06, 0.03, 1.0)
    np.testing.assert_array_equal(turn.step, np.eye(3))
    for stamp, angle in ((-1000.0, 0.02), (-999.95, 0.03)):
        turn.update(pose_from_rpy((angle, 0.0, 0.0), (0.0, 0.0, 0.0))[:3, :3], (True,) * 3, stamp, 0.05, 1.0)
    assert not np.allclose(turn.step, np.eye(3))


def loaded(load: float, stamp: float) -> Margin:
    return Margin(stamp, 0.5, 0.05, load, 0.0, 0.8, 0.5 / 0.8, 0.0)


def gripping(start: float) -> GripControl:
    """A load that falls from 8 N to 1 N as the clock is set to `start` [s], and stays for 30 s."""
    grip, settings = GripControl(GripSettings(friction=0.8)), GripSettings(friction=0.8)
    for i in range(60):
        grip.heard(1000.0 + i / 45.0, 0.03, grip.wanted if i else settings.least_force)
        grip.image(loaded(min(0.5 * i, 8.0), 1000.0 + i / 45.0), 1000.0 + i / 45.0)
    for i in range(30 * 45):
        t = start + i / 45.0
        grip.heard(t, 0.03, grip.wanted)
        grip.image(loaded(1.0, t), t)
    return grip


def test_a_grip_answers_its_load_after_the_clock_was_set_back() -> None:
    assert gripping(900.0).wanted == pytest.approx(gripping(1002.0).wanted, rel=0.05)


def test_a_gripper_that_falls_silent_is_told_after_the_clock_was_set_back() -> None:
    grip = gripping(1002.0)
    assert not grip.command(900.0).hold
    assert "the gripper does not answer" in grip.command(902.0).hold


def test_enable_names_the_age_that_is_allowed() -> None:
    controller = Controller(ControllerParameters(kinematics_timeout=0.03), Hand(), Tool(), DEFAULT_STIFFNESS)
    t = run(controller, 1000.0)
    with pytest.raises(ControlRefusedError, match=r"within the last 0\.03 s"):
        controller.enable(t + 0.05)

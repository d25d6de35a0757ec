# SPDX-License-Identifier: Apache-2.0
"""Weight and arm reading against the wrench: what is wrong is told with numbers, mended, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from quasi_static import DOWN, DT, Bench

from seed_control.monitor.arm_check import ArmCheck
from seed_control.monitor.contradiction import WindowTest
from seed_control.monitor.correction import Correction
from seed_control.monitor.weight_check import FreeSpaceSample, WeightCheck
from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.wrench.estimate import Measurement, WrenchEstimator
from seed_core.bushing import Bushing, Stiffness
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, GRAVITY, Hand, Tool
from seed_core.spatial import Wrench, inverse_pose, make_pose, rotation_from_rpy
from seed_core.wrench_settings import ReferenceSettings

SENSOR = ReferenceSettings(
    arm_force_noise=0.1, arm_torque_noise=0.01, arm_force_offset=0.05, arm_torque_offset=0.02, arm_gain=0.005
)
HOLDING = replace(SENSOR, on_contradiction="hold")
HIGH = make_pose(p=(0.0, 0.0, 0.03))  # so much free travel before the table


def softer(share: float) -> Stiffness:
    """Than the controller believes, along z alone."""
    x, y, z = DEFAULT_STIFFNESS.translation
    return Stiffness(DEFAULT_STIFFNESS.rotation, (x, y, share * z))


def pressing(bench: Bench, force: float = 10.0, seconds: float = 2.0) -> float:
    """Press, and go on for so long after the first contact; returns when contact was told [s]."""
    bench.enabled()
    bench.press(force)
    while not bench.state.in_contact:
        bench.step()
        assert bench.t < 5.0, bench.state.reason
    began = bench.t
    bench.run(seconds)
    return began


def in_free_air(bench: Bench) -> None:
    """Up and down, which shows the offset of the arm's reading."""
    for i in range(8):
        place = bench.start.copy()
        place[:3, 3] += (0.01 * (i % 2), 0.0, 0.02 * (i % 2))
        bench.controller.set_setpoint(HybridSetpoint(place), bench.t)
        bench.run(2.0)


def pressed(bench: Bench, seconds: float) -> float:
    """Press with 8 N for so long; the force of the last second [N]."""
    bench.press(8.0)
    bench.run(seconds)
    return float(np.mean(bench.forces[-round(1.0 / DT) :]))


def start() -> np.ndarray:
    return np.asarray(HIGH @ Bench().start)


def test_a_stiffness_that_is_20_per_cent_off_is_told_and_mended_by_the_arms_reading() -> None:
    bench = Bench(stiffness=softer(0.8), believed=DEFAULT_STIFFNESS, arm_noise=0.1, references=SENSOR, start=start())
    pressing(bench, seconds=2.0)
    assert "arm_wrench" in " ".join(bench.state.contradictions)
    assert "along the tool's z" in " ".join(bench.state.contradictions)
    bench.run(2.0)
    assert_allclose(bench.forces[-round(1.0 / DT) :], 10.0, atol=0.2)  # 8.4 N without the reading


def test_without_a_reading_nothing_tells_it() -> None:
    """Of the weight alone, 2 N, so much is not enough for its uncertainty: the force stays what the stiffness makes."""
    bench = Bench(stiffness=softer(0.95), believed=DEFAULT_STIFFNESS, start=start())
    pressing(bench, seconds=3.0)
    assert bench.state.contradictions == ()
    assert 9.4 < bench.forces[-1] < 9.8


def test_a_wrench_that_agrees_is_left_alone() -> None:
    """With an arm's reading or without: the very same commands."""
    commands = []
    for noise in (None, 0.1):
        bench = Bench(arm_noise=noise, references=SENSOR, start=start())
        pressing(bench, seconds=3.0)
        assert bench.state.contradictions == ()
        commands.append(np.array(bench.commands))
    assert np.array_equal(*commands)


@pytest.mark.parametrize(("share", "reference"), [(0.85, "arm_wrench"), (0.7, "weight")])
def test_hold_stops_the_arm_at_a_contradiction(share: float, reference: str) -> None:
    """The larger one shows in the air already: the weight of 2 N seems to be 2.8."""
    bench = Bench(stiffness=softer(share), believed=DEFAULT_STIFFNESS, arm_noise=0.1, references=HOLDING, start=start())
    bench.enabled()
    bench.press(10.0)
    bench.run(4.0)
    assert bench.state.mode == "holding"
    assert reference in bench.state.reason
    assert bench.state.in_contact == (reference == "arm_wrench")
    references = bench.controller.supervisor.references
    assert reference in references.why_hold
    references.new_grasp()
    assert references.why_hold == ""
    assert not references.correction.active


def test_a_grasp_taken_while_the_tool_hung_is_told_in_free_space_and_tared() -> None:
    """A press at once is refused before the weight can tell for certain; enabled again, it presses what is asked."""
    bench = Bench(start=start())
    bench.X_TT_new = np.linalg.inv(bench.grasp())  # T := C under the weight
    bench.enabled()
    bench.press(8.0)
    bench.run(2.0)
    assert bench.state.mode == "holding"
    assert "the tool hung (2.0 N)" in bench.state.reason
    assert max(bench.forces) == 0.0
    assert bench.controller.supervisor.references.correction.active
    pressing(bench, force=8.0, seconds=3.0)
    assert bench.state.mode == "contact"
    assert "tool's weight of 1.96 N along the tool's z" in bench.state.contradictions[0]
    assert_allclose(bench.forces[-round(1.0 / DT) :], 8.0, atol=0.25)  # 2 N off without


@pytest.mark.parametrize("still", [0.5, 2.0])
@pytest.mark.parametrize("lets_go", [0.02, 0.4])
def test_a_tool_that_was_carried_until_the_arm_moved_off_is_not_tared(still: float, lets_go: float) -> None:
    """It stands in a holder, whose load its spring does not feel: 2 N are missing until it hangs, and none then."""
    bench = Bench(start=start())
    carried, given, began = np.linalg.inv(bench.grasp()), 0.0, bench.X_WE.copy()
    bench.X_TT_new = carried
    bench.enabled()
    bench.run(still)
    bench.controller.set_setpoint(HybridSetpoint(DOWN), bench.t)
    seen = False
    while not bench.state.in_contact:
        if bench.t > 2.5 + still and bench.state.mode == "position":
            bench.press(10.0)
        if np.abs(bench.X_WE - began).max() > 5e-4:
            given = min(given + DT / lets_go, 1.0)
        bench.X_TT_new = make_pose(p=(1.0 - given) * carried[:3, 3])
        bench.step()
        seen |= bench.controller.supervisor.references.correction.active
        assert bench.t < 8.0, bench.state.reason
    bench.run(3.0)
    assert not seen
    assert not bench.controller.supervisor.references.correction.active
    assert not bench.state.contradictions  # what was told while it stood in the holder is taken back
    assert_allclose(bench.forces[-round(0.5 / DT) :], 10.0, atol=0.1)  # 8 N if it was tared


def test_a_touch_is_not_tared() -> None:
    """Enabled while the tip presses on the table with some newtons: told once the arm has moved, but believed."""
    bench = Bench(start=make_pose(p=(0.0, 0.0, -0.024)) @ Bench().start)
    bench.enabled()
    bench.run(3.0)
    assert bench.force > 2.0
    assert not bench.state.contradictions  # a holder would be felt the same
    bench.controller.set_setpoint(HybridSetpoint(make_pose(p=(0.02, 0.0, 0.0)) @ bench.start), bench.t)
    bench.run(3.0)
    assert bench.force > 2.0
    assert "hangs free or is still carried" in " ".join(bench.state.contradictions)
    assert not bench.controller.supervisor.references.correction.active


def test_a_tool_that_stands_in_its_holder_is_no_contradiction_until_the_arm_has_moved() -> None:
    bench = Bench(start=start())
    bench.X_TT_new = np.linalg.inv(bench.grasp())  # its weight is carried
    bench.enabled()
    bench.run(3.0)
    assert not bench.state.contradictions
    bench.controller.set_setpoint(HybridSetpoint(make_pose(p=(0.0, 0.0, 0.02)) @ bench.start), bench.t)
    bench.run(3.0)
    assert "hangs free or is still carried" in " ".join(bench.state.contradictions)


@pytest.mark.parametrize(("seconds", "what"), [(0.3, "is silent: none for"), (0.0, "is stuck: the very same reading")])
def test_a_reading_that_stops_is_named(seconds: float, what: str) -> None:
    bench = Bench(arm_noise=0.1, references=SENSOR, start=start())
    bench.enabled()
    bench.arm_noise = None if seconds else 0.0
    reading = bench.arm_reading(np.eye(4))
    for _ in range(200):
        if not seconds:
            bench.controller.add_arm_wrench(bench.t, reading)
            bench.arm_noise = None
        bench.step()
    assert what in " ".join(bench.state.contradictions)


@pytest.mark.parametrize(
    ("stamp", "force", "words"),
    [
        (1.0, np.nan, "not finite"),
        (np.inf, 0.0, "not finite"),
        (-1.0, 0.0, "comes after one of"),
        (1.0, 3e4, "3e+04 N, 0 N m; at most 2000 N"),
    ],
)
def test_bad_readings_are_refused_by_name_and_value(stamp: float, force: float, words: str) -> None:
    controller = Bench().controller
    controller.add_arm_wrench(0.0, Wrench.zero())
    with pytest.raises(SeedError, match="arm_wrench") as refusal:
        controller.add_arm_wrench(stamp, Wrench(np.zeros(3), np.array((0.0, 0.0, force))))
    assert words in str(refusal.value)


def test_the_window_test_is_as_strict_as_its_covariances() -> None:
    """Agreeing series are called so, whatever the seed; two deviations of the systematic part are no contradiction."""
    random, systematic = np.diag([1e-4] * 3 + [0.04] * 3), np.diag([1e-4] * 3 + [0.01] * 3)
    rng, called = np.random.default_rng(0), 0
    for _ in range(100):
        test = WindowTest(0.05, 0.01)
        offset = np.sqrt(systematic.diagonal()) * rng.standard_normal(6)
        for i in range(60):
            noise = np.sqrt(random.diagonal()) * rng.standard_normal(6)
            test.add(0.1 * i, offset + noise, random, systematic)
        called += test.significant
    assert called <= 3
    test = WindowTest(0.05, 0.01)
    for i in range(20):
        test.add(0.1 * i, np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.6)), random, systematic)
    assert test.significant
    assert "along the tool's z by +0.60 +- 0.1" in test.told()


@pytest.mark.parametrize("i", range(6))
def test_each_component_that_is_off_by_more_than_is_worth_telling_is_told_once_a_second(i: int) -> None:
    worth, C, one = (0.02, 0.5)[i // 3], 1e-6 * np.eye(6), np.eye(6)[i]  # [N m], [N]
    for size, share, is_told in ((0.9, 0.0, False), (1.1, 0.6, i < 3), (1.1, 0.0, True)):
        test = WindowTest(0.5, 0.02)
        for k in range(20):
            test.add(0.1 * k, size * worth * one, C, C, share)
        assert test.significant is is_told
        assert [test.to_be_told(t) for t in (2.0, 2.5, 3.1)] == [is_told, False, is_told]
    assert f"{('about', 'along')[i // 3]} the tool's {'xyz'[i % 3]} by +" in test.told()


def test_the_correction_finds_offset_and_scale_once_both_are_excited() -> None:
    """From made-up comparisons: reference = 1.2 f_z + 0.3 N along z."""
    rng, correction = np.random.default_rng(1), Correction(ReferenceSettings())
    C = np.diag([1e-4] * 3 + [0.01] * 3)
    for i in range(200):
        told = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 2.0 if i % 40 < 20 else -8.0))
        noise = np.sqrt(C.diagonal()) * rng.standard_normal(6)
        correction.learn(0.1 * i, told, told * 1.2 + 0.3 * np.eye(6)[5] + noise, C, 0.01 * C)
        correction.advance(0.1 * i, told)
    more = correction.wrench(Wrench(np.zeros(3), np.array((0.0, 0.0, -8.0))))
    assert more is not None
    assert_allclose(more.force, (0.0, 0.0, -1.6 + 0.3), atol=0.15)
    more = correction.wrench(Wrench(np.zeros(3), np.array((0.0, 0.0, 2.0))))
    assert more is not None
    assert_allclose(more.force, (0.0, 0.0, 0.4 + 0.3), atol=0.15)


def test_noise_of_a_light_tool_is_not_taken_for_a_scale() -> None:
    """0.2 N of weight under 0.24 N of noise for a minute: both agree on the mean, and nothing is mended."""
    rng, correction = np.random.default_rng(5), Correction(ReferenceSettings())
    C, D = np.diag([1e-3] * 3 + [0.0576] * 3), np.diag([1e-4] * 3 + [2.5e-3] * 3)
    for i in range(600):
        reference = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.2 if i % 100 < 50 else -1.8))
        told = reference + np.sqrt(C.diagonal()) * rng.standard_normal(6)
        correction.learn(0.1 * i, told, reference, C, D)
        correction.advance(0.1 * i, told)
        assert not correction.active


def test_the_correction_is_bounded() -> None:
    settings = ReferenceSettings(correction_offset=1.0, correction_share=0.1)
    correction = Correction(settings)
    told = np.array((0.0, 0.0, 0.0, 0.0, 0.0, -10.0))
    for i in range(100):
        correction.learn(0.1 * i, told, 3.0 * told, 1e-4 * np.eye(6), 1e-4 * np.eye(6))
        correction.advance(0.1 * i, told)
    more = correction.wrench(Wrench.from_vector(told))
    assert more is not None
    assert_allclose(np.linalg.norm(more.force), 2.0, atol=1e-6)


def offset_learnt(settings: ReferenceSettings, off: np.ndarray, known_to: float = 0.1) -> Correction:
    """Of a wrench that is off by so much (6,), about which nothing is known better than this [N, a tenth in N m]."""
    correction, systematic = Correction(settings), known_to**2 * np.diag((0.01,) * 3 + (1.0,) * 3)
    for i in range(100):
        correction.learn(0.1 * i, np.zeros(6), off, 1e-6 * np.eye(6), systematic)
    return correction


def added(correction: Correction, since: float, count: int) -> np.ndarray:
    """To no wrench (6,), after so many steps of 0.1 s."""
    for i in range(count):
        correction.advance(since + 0.1 * i, np.zeros(6))
    more = correction.wrench(Wrench.zero())
    return np.zeros(6) if more is None else more.vector()


def test_a_correction_comes_in_and_goes_slowly_and_between_begins_less_easily_than_it_ends() -> None:
    """0.5 N off: five deviations, then two and a half, then one and a half. It comes in within 0.6 s."""
    settings, off = ReferenceSettings(correction_offset=2.0), 0.5 * np.eye(6)[5]
    correction = offset_learnt(settings, off)
    added(correction, 10.0, 1)
    assert added(correction, 10.1, 4)[5] == pytest.approx(0.5 * (1.0 - np.exp(-1.0)), rel=0.1)
    whole = added(correction, 10.5, 40)[5]
    assert whole == pytest.approx(0.5, rel=0.05)
    for known_to, stays in ((0.2, True), (0.33, False)):
        correction.learn(15.0, np.zeros(6), off, 1e-6 * np.eye(6), known_to**2 * np.eye(6))
        then = added(correction, 15.0, 7)[5]
        assert correction.active is stays
        assert then == pytest.approx(whole if stays else whole * np.exp(-1.0), rel=0.25)
    assert not added(correction, 15.7, 60).any()
    assert not added(offset_learnt(settings, off, 0.2), 10.0, 20).any()  # it would not have begun
    assert not added(offset_learnt(replace(settings, correct=False), off), 10.0, 20).any()


def test_the_correction_of_a_torque_is_bounded_by_a_lever() -> None:
    correction = offset_learnt(ReferenceSettings(correction_offset=0.3, correction_share=0.0), 0.09 * np.eye(6)[1])
    assert_allclose(added(correction, 10.0, 50), 0.1 * 0.3 * np.eye(6)[1], atol=1e-6)


def test_a_tool_without_mass_is_no_reference() -> None:
    bench = Bench(tool=Tool(mass=0.0), start=start())
    pressing(bench, force=5.0)
    assert bench.state.contradictions == ()


@pytest.mark.parametrize("uncertain", [0.01, 0.5])
def test_a_tool_that_is_let_down_is_not_weighed(uncertain: float) -> None:
    """However little is known of the force along y [N], which a firm grasp hardly tells; along z it changes."""
    tool, X_WT = Tool(), DOWN @ inverse_pose(Tool().X_Ttip)
    check, weight = WeightCheck(ReferenceSettings(), tool), tool.mass * GRAVITY * (DOWN[:3, :3].T @ (0.0, 0.0, -1.0))
    random = np.diag(np.array((0.01, 0.01, 0.01, 0.05, uncertain, 0.05)) ** 2)
    measure = WrenchEstimator(tool, Bushing(DEFAULT_STIFFNESS), True, 3e-4).measure
    seen = []
    for t in 0.1 * np.arange(30):
        m = measure(RelativePoseEstimate(t, np.eye(4), 1e-8 * np.eye(6)), X_WT)
        borne = Wrench(np.zeros(3), -min(t / 0.4, 1.0) * weight)
        check.update(m, borne, Wrench(np.zeros(3), weight), random, in_contact=False)
        seen += [float(np.linalg.norm((s.spring - s.load)[3:])) for s in check.passed]
    assert len(seen) > 10
    assert max(seen) < 0.01
    assert check.reason == ""


def hung(off: float, place: tuple[float, float, float], t: float = 0.0) -> tuple[Measurement, Wrench, Wrench]:
    """A tool of 0.2 kg whose spring tells so many newtons too much, at a place; its spring's wrench, and its weight."""
    weight = Wrench(np.zeros(3), 0.2 * GRAVITY * (DOWN[:3, :3].T @ (0.0, 0.0, -1.0)))
    measure = WrenchEstimator(Tool(mass=0.2), Bushing(DEFAULT_STIFFNESS), True, 3e-4).measure
    m = measure(RelativePoseEstimate(t, np.eye(4), 1e-8 * np.eye(6)), make_pose(DOWN[:3, :3], place))
    return m, Wrench(np.zeros(3), (off, 0.0, 0.0) - weight.force), weight


@pytest.mark.parametrize(
    ("away", "free"), [((0.0, 0.0, 0.0), False), ((0.0, 0.0, 4e-3), False), ((0.02, 0.02, 0.0), False),
                       ((0.0, 0.0, -0.02), False), ((0.0, 0.0, 6e-3), True)]
)  # fmt: skip
def test_a_tool_hangs_free_again_where_it_has_come_away_from_what_it_touched(away, free: bool) -> None:
    check = WeightCheck(ReferenceSettings(), Tool())
    m = hung(0.0, (0.5, 0.0, 0.1))[0]._replace(on_environment=Wrench(np.zeros(3), np.array((0.0, 0.0, -4.0))))
    assert not check.free(m, True)
    assert check.free(m._replace(tip=m.tip + away), False) is free
    assert check.free(m, False) is free


def test_a_sample_of_free_air_states_what_mass_and_centre_of_mass_are_known_to() -> None:
    """2 N, known to a part of that along it; a centre that is off by a lever turns it about both axes across."""
    settings = ReferenceSettings(mass_deviation=0.1, centre_deviation=20.0)
    check = WeightCheck(settings, Tool(mass=0.2))
    for i in range(10):
        check.update(*hung(0.0, (0.5, 0.0, 0.1), 0.1 * i), 1e-6 * np.eye(6), in_contact=False)
    of = np.sqrt(check.passed[0].systematic.diagonal())
    weight = 0.2 * GRAVITY
    assert_allclose(of[:3], (*(np.hypot(0.02 * weight, 0.01),) * 2, 0.01), rtol=1e-6)
    assert_allclose(of[3:], (0.05, 0.05, np.hypot(0.1 * weight, 0.05)), rtol=1e-6)


@pytest.mark.parametrize(
    ("off", "moves", "verified"),
    [
        (0.5, 0.0, False),  # nothing tells it from a touch
        (0.5, 3e-3, False),
        (0.5, 6e-3, True),  # along it, as far as would have changed a touch
        (0.5, -6e-3, True),
    ],
)
def test_a_difference_counts_that_is_the_same_elsewhere_along_it(off: float, moves: float, verified: bool) -> None:
    check, seen = WeightCheck(ReferenceSettings(), Tool(mass=0.2)), []
    for i in range(30):
        m, spring, weight = hung(off, (0.5 + (moves if i > 10 else 0.0), 0.02 * (i > 10), 0.1), 0.1 * i)
        check.update(m, spring, weight, 1e-6 * np.eye(6), in_contact=False)
        seen += [s.verified for s in check.passed]
    assert len(seen) > 20
    assert seen[-1] is verified
    assert not seen[0]
    check.update(*hung(off, (0.5, 0.0, 0.1), 3.0), 1e-6 * np.eye(6), in_contact=True)  # it touches: all is seen anew
    assert check.passed == []
    check.update(*hung(off, (0.5, 0.0, 0.2), 3.1), 1e-6 * np.eye(6), in_contact=False)
    for i in range(3):
        check.update(*hung(off, (0.5, 0.0, 0.2), 3.2 + 0.1 * i), 1e-6 * np.eye(6), in_contact=False)
        assert check.passed == []


@pytest.mark.parametrize("weighs", [True, False])
def test_an_arms_reading_tells_the_springs_wrench_in_any_attitude_whether_it_weighs_the_tool_or_not(weighs) -> None:
    """By hand: the load on the flange is the reaction of what the spring bears, less the weight of a payload."""
    settings = ReferenceSettings(arm_weighs_tool=weighs)
    tool, X_EC, C = Tool(), Hand().X_EC, 1e-6 * np.eye(6)
    check, bushing = ArmCheck(settings, X_EC, tool), Bushing(DEFAULT_STIFFNESS)
    estimator = WrenchEstimator(tool, bushing, True, 3e-4)
    offset = Wrench(np.array((0.3, -0.1, 0.2)), np.array((4.0, -3.0, 5.0)))
    for i in range(12):
        pressed = i == 11
        R_WT = rotation_from_rpy((np.pi - 0.5, 0.6 if pressed else 0.0, 0.4 if pressed else 0.0))
        weight = estimator.true_weight(R_WT)
        more = (0.1, -0.2, 0.05, 1.0, 2.0, -6.0) if pressed else (0.0,) * 6
        spring = Wrench.from_vector(-weight.vector() + more)
        X_CT = inverse_pose(bushing.pose(spring))
        m = estimator.measure(
            RelativePoseEstimate(0.1 * i, X_CT, 1e-10 * np.eye(6)), make_pose(R_WT) @ inverse_pose(X_CT)
        )
        on_hand, X_ET = spring if weighs else spring.plus(weight), X_EC @ X_CT
        force = -X_ET[:3, :3] @ on_hand.force
        torque = -X_ET[:3, :3] @ on_hand.torque + np.cross(X_ET[:3, 3], force)
        for stamp in (0.1 * i - 0.01, 0.1 * i, 0.1 * i + 0.01):
            check.add(stamp, Wrench(torque, force).plus(offset))
        free = [] if pressed else [FreeSpaceSample(m, spring.vector(), -weight.vector(), C, C, verified=True)]
        check.update(m, spring, weight, C, free, 0.1 * i + 0.01)
    assert check.reading is not None
    assert_allclose(check.reading.wrench, spring.vector(), atol=1e-9)


@pytest.mark.parametrize("jump", [8.0, -8.0, 3.0])
def test_a_reading_that_is_zeroed_while_running_is_no_reference_until_its_offset_is_found_anew(jump: float) -> None:
    bench = Bench(arm_noise=0.3, noise=1e-4).enabled()
    in_free_air(bench)
    arm, reading = bench.controller.supervisor.references.arm, bench.arm_reading
    assert arm.reading is not None
    shift = np.array((0.0, 0.0, jump))
    bench.arm_reading = lambda X: Wrench(reading(X).torque, reading(X).force + shift)  # type: ignore[method-assign]
    assert pressed(bench, 7.0) == pytest.approx(8.0, abs=0.15)
    assert bench.state.contradictions == ()
    assert arm.reading is None
    in_free_air(bench)
    assert arm.reading is not None
    assert pressed(bench, 5.0) == pytest.approx(8.0, abs=0.2)


def test_what_was_learnt_of_one_stiffness_is_not_added_to_another() -> None:
    bench = Bench(arm_noise=0.3, noise=1e-4, believed=softer(0.7)).enabled()
    in_free_air(bench)
    assert pressed(bench, 11.0) == pytest.approx(8.0, abs=0.2)  # what is missing is added
    bench.controller.set_stiffness(DEFAULT_STIFFNESS, bench.t)
    for i in range(12):
        bench.run(0.5)
        assert bench.force == pytest.approx(8.0, abs=0.2 if i else 0.5), bench.t  # while the stiffness changes
    assert bench.state.contradictions == ()


def test_another_stiffness_rescales_what_was_learnt_and_nothing_else() -> None:
    correction, random = Correction(ReferenceSettings()), np.eye(6) * 1e-4
    correction.rescale(np.full(3, 1.4))
    assert_allclose(correction.mismatch(np.array((0, 0, 0, 1.0, 2.0, 3.0)))[0], 0.0)
    for i in range(400):
        told = np.array((0.0, 0.0, 0.0, 5.0, 10.0 * np.sin(0.3 * i), 4.0))
        correction.learn(0.1 * i, told, told * (1, 1, 1, 1, 1.3, 1), random, 0.0 * random)
    before = correction.mismatch(np.array((0, 0, 0, 0, 10.0, 0)))[0][4]
    assert before == pytest.approx(3.0, abs=0.2)
    correction.rescale(np.array((1.0, 1.3, 1.0)))
    assert correction.mismatch(np.array((0, 0, 0, 0, 13.0, 0)))[0][4] == pytest.approx(0.0, abs=0.3)


def test_what_a_tool_is_lowered_onto_is_no_wrong_zero() -> None:
    bench = Bench(noise=1e-4).enabled()
    touching = DOWN.copy()
    touching[2, 3] = -1.5e-3  # into the table
    bench.controller.set_setpoint(HybridSetpoint(touching), bench.t)
    state = bench.run(5.0)
    assert max(bench.forces) > 5.0
    assert bench.force > 2.0  # it holds, and has gone back the way that it came
    assert_allclose(state.filtered.force[2], -bench.force, atol=0.2)

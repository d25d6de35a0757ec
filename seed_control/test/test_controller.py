# SPDX-License-Identifier: Apache-2.0
"""The controller on the bench: it presses with the force asked for, and stops when it must."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from quasi_static import DOWN, DT, PRESS_Z, Bench

from seed_control.controller import LAW_CLASSES, ControllerParameters, ControlRefusedError
from seed_control.parameters import LAWS
from seed_control.setpoint.setpoints import HybridSetpoint, RelativePoseSetpoint, SetpointError, WrenchSetpoint
from seed_core.bushing import Stiffness
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Frame, Tool
from seed_core.spatial import (
    Wrench,
    make_pose,
    pose_from_rpy,
    rotation_error,
    rotation_from_rpy,
    so3_exp,
    so3_log,
)
from seed_testing.bench.control import growth

TIGHT = 0.02  # [N]: what the servo's lag and the filter leave after three seconds


@pytest.mark.parametrize("force", [3.0, 10.0, 15.0])
def test_presses_with_the_force_asked_for(force: float) -> None:
    bench = Bench().enabled()
    bench.press(force)
    state = bench.run(3.0)
    assert state.mode == "contact"
    assert state.settled
    assert_allclose(bench.force, force, atol=TIGHT)
    assert_allclose(state.estimated.force, (0.0, 0.0, -force), atol=TIGHT)


def test_without_gravity_the_error_is_the_weight_of_the_tool() -> None:
    bench = Bench(law="published", delay=0.0).enabled()
    bench.press(10.0)
    bench.run(4.0)
    assert_allclose(bench.force - 10.0, 0.2 * 9.81, atol=TIGHT)  # the weight presses as well


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.1, 0.2])
@pytest.mark.parametrize("k_table", [500.0, 4e4])
def test_delay_does_not_make_it_swing(delay: float, k_table: float) -> None:
    bench = Bench(delay=delay, k_table=k_table).enabled()
    bench.press(10.0)
    bench.run(6.0)
    assert np.ptp(bench.forces[-250:]) < TIGHT
    assert_allclose(bench.force, 10.0, atol=0.05)


def test_unsynchronised_kinematics_swing_where_synchronised_ones_do_not() -> None:
    bench = Bench(law="published", delay=0.1).enabled()
    bench.press(10.0)
    while not bench.state.reason and bench.t < 6.0:
        bench.step()
    assert np.ptp(bench.forces[-250:]) > 1.0
    assert "swings" in bench.state.reason


@pytest.mark.parametrize("stiffness", [DEFAULT_STIFFNESS, DEFAULT_STIFFNESS.scaled(4.0)])
def test_impact_overshoots_by_less_than_a_fifth_and_settles_soon(stiffness: Stiffness) -> None:
    bench = Bench(stiffness=stiffness).enabled()
    bench.press(10.0)
    bench.run(4.0)
    forces = np.array(bench.forces)
    touch = int(np.argmax(forces > 0.2))
    near = int(np.argmax(np.abs(forces - 10.0) < 1.0))
    assert forces.max() < 12.0
    assert (near - touch) * DT < 0.6


def test_force_is_held_on_a_slope_that_was_never_told() -> None:
    bench = Bench(slope=np.tan(np.deg2rad(2.0))).enabled()
    setpoint = bench.press(10.0)
    bench.run(2.0)
    errors = []
    for i in range(round(4.0 / DT)):
        x = 0.05 * i * DT
        X = DOWN.copy()
        X[0, 3] += x
        bench.controller.set_setpoint(setpoint.moved(X, np.array((0.05, 0.0, 0.0))), bench.t)
        bench.step()
        errors.append(bench.force - 10.0)
    assert np.abs(errors[250:]).max() < 0.1  # a follower 100 ms late would be 0.14 N off, and more at the start
    assert_allclose(bench.X_WE[0, 3] - DOWN[0, 3], 0.2, atol=1e-3)


def test_wrong_stiffness_gives_force_wrong_in_proportion() -> None:
    bench = Bench(believed=DEFAULT_STIFFNESS.scaled(1.3)).enabled()
    bench.press(10.0)
    bench.run(4.0)
    weight = 0.2 * 9.81
    assert_allclose(bench.force - weight, (10.0 - weight) / 1.3, atol=0.05)


def test_every_law_that_has_a_name_has_its_class() -> None:
    assert tuple(LAW_CLASSES) == LAWS


def test_nothing_moves_before_enable_and_setpoints_are_refused() -> None:
    bench = Bench()
    bench.run(0.2)
    with pytest.raises(SetpointError, match=r"SP17.*enable it first"):
        bench.press(10.0)
    state = bench.run(0.5)
    assert state.mode == "disabled"
    assert state.counters.setpoints_refused == 1
    assert_allclose(bench.commands[-1], bench.commands[0], atol=1e-12)


def test_enable_needs_fresh_inputs() -> None:
    bench = Bench()
    with pytest.raises(ControlRefusedError, match=r"current_pose"):
        bench.controller.enable(0.0)
    bench.estimates = False
    bench.run(0.3)
    with pytest.raises(ControlRefusedError, match=r"relative pose"):
        bench.controller.enable(bench.t)


@pytest.mark.parametrize("lost", ["estimates", "kinematics"])
def test_lost_input_decelerates_to_a_latched_hold(lost: str) -> None:
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(0.5)
    setattr(bench, lost, False)
    state = bench.run(1.0)
    assert state.mode == "holding"
    assert "stale" in state.reason
    setattr(bench, lost, True)
    resting = bench.commands[-1]
    state = bench.run(0.5)
    assert state.mode == "holding"  # latched
    assert_allclose(bench.commands[-1], resting, atol=1e-9)
    with pytest.raises(SetpointError, match=r"SP17.*holding.*stale"):
        bench.press(10.0)
    bench.controller.enable(bench.t)
    bench.press(10.0)
    bench.run(3.0)
    assert_allclose(bench.force, 10.0, atol=TIGHT)


def test_lost_estimate_is_noticed_within_a_quarter_second() -> None:
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(0.5)
    bench.estimates = False
    lost = bench.t
    while bench.state.mode != "holding":
        bench.step()
        assert bench.t - lost < 0.25


def test_single_invalid_estimates_are_bridged_and_counted_but_three_hold() -> None:
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(0.5)
    for i in range(3):
        assert bench.state.mode != "holding"
        bad = RelativePoseEstimate(bench.t + 1e-4 * i, np.eye(4), valid=False, reason="too few points")
        assert not bench.controller.add_estimate(bad)
    state = bench.step()
    assert state.mode == "holding"
    assert "too few points" in state.reason
    assert state.counters.estimates_invalid == 3


def bad(stamp: float) -> RelativePoseEstimate:
    return RelativePoseEstimate(stamp, np.eye(4), valid=False, reason="a new grasp is taken")


def test_invalid_estimates_of_before_the_enabling_that_are_read_after_it_do_not_count() -> None:
    bench = Bench().enabled()
    enabled = bench.t - DT
    for i in range(10):
        assert not bench.controller.add_estimate(bad(enabled - 1e-3 * i))
    bench.press(10.0)
    state = bench.run(3.0)
    assert state.mode == "contact"
    assert state.counters.estimates_invalid + state.counters.estimates_out_of_order == 10
    for i in range(3):
        assert bench.state.mode != "holding"
        bench.controller.add_estimate(bad(bench.t + 1e-4 * i))
    assert bench.step().mode == "holding"


@pytest.mark.parametrize("stamp", [-np.inf, np.inf, np.nan])
def test_estimates_without_a_usable_stamp_count_whenever_it_was_enabled(stamp: float) -> None:
    bench = Bench().enabled()
    for _ in range(3):
        bench.controller.add_estimate(bad(stamp))
    assert bench.step().mode == "holding"


def test_invalid_estimates_of_before_the_enabling_do_not_keep_it_from_holding_by_staleness() -> None:
    bench = Bench().enabled()
    enabled, bench.estimates = bench.t - DT, False
    while bench.state.mode != "holding":
        bench.controller.add_estimate(bad(enabled))
        bench.step()
        assert bench.t - enabled < 0.25
    assert "relative_pose is stale" in bench.state.reason
    assert "a new grasp is taken" in bench.state.reason


def test_bad_inputs_are_counted_and_never_used() -> None:
    bench = Bench().enabled()
    controller = bench.controller
    assert not controller.add_kinematics(bench.t, np.full((4, 4), np.nan))
    assert not controller.add_kinematics(-1.0, np.eye(4))
    assert not controller.add_estimate(RelativePoseEstimate(float("nan"), np.eye(4)))
    assert not controller.add_estimate(RelativePoseEstimate(bench.t, np.full((4, 4), np.nan)))
    assert not controller.add_estimate(RelativePoseEstimate(0.0, np.eye(4)))  # older than the last
    counters = bench.step().counters
    assert counters.kinematics_refused == 2
    assert counters.estimates_invalid == 2
    assert counters.estimates_out_of_order == 1
    assert np.isfinite(bench.commands[-1]).all()


def test_travel_without_contact_is_bounded() -> None:
    bench = Bench(table=-0.5).enabled()
    bench.press(10.0)
    state = bench.run(4.0)
    assert state.mode == "holding"
    assert "no contact within" in state.reason
    travel = bench.commands[0][2, 3] - bench.commands[-1][2, 3]
    assert 0.05 < travel < 0.065


@pytest.mark.parametrize("delay", [0.1, 0.2])
def test_an_approach_is_so_slow_that_the_grasp_is_not_deflected_too_far_before_contact_is_seen(delay: float) -> None:
    bench = Bench(delay=delay, table=-0.2).enabled()
    bench.press(2.0, approach_speed=0.1)
    bench.run(1.0)
    speed = -np.diff([X[2, 3] for X in bench.commands]) / DT
    wanted = 2.0 / (sum(DEFAULT_STIFFNESS.translation) / 3.0)  # [m] of deflection
    assert 0.3 * wanted < speed[-100:].mean() * delay
    assert speed.max() * delay < 0.7 * wanted


def test_lost_contact_is_found_again_at_approach_speed() -> None:
    bench = Bench().enabled()
    bench.press(3.0)
    bench.run(3.0)
    bench.table = -0.045  # the surface drops away
    bench.run(0.5)
    assert bench.state.mode == "approach"
    assert bench.state.counters.contacts_lost == 1
    first = len(bench.commands)
    bench.run(3.0)
    speeds = np.abs(np.diff([X[2, 3] for X in bench.commands[first:]])) / DT
    free = np.array(bench.forces[first + 1 :]) == 0.0
    assert speeds[free].max() < 0.031  # approach
    assert speeds.max() < 0.046  # building up the force
    assert_allclose(bench.force, 3.0, atol=TIGHT)


def test_a_large_force_that_is_gone_at_once_makes_it_hold() -> None:
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(3.0)
    height = bench.commands[-1][2, 3]
    bench.table = -0.045
    state = bench.run(2.0)
    assert state.mode == "holding"
    assert "jumped" in state.reason
    assert_allclose(bench.commands[-1][2, 3], height, atol=2e-3)


@pytest.mark.parametrize("what", ["place", "rotation"])
def test_a_law_that_comes_to_no_number_makes_it_hold_where_it_is(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(2.0)
    there = bench.commands[-1]
    if what == "place":
        monkeypatch.setattr(bench.controller.law.reference, "target", lambda *_: (np.nan, 0.0, 0.0))
    else:
        command = bench.controller._command
        command.turn_to(np.full((3, 3), np.nan))
        monkeypatch.setattr(command, "turn_to", lambda _: None)
    bench.step()
    monkeypatch.undo()
    state = bench.run(1.0)
    assert state.mode == "holding"
    assert "no number" in state.reason
    assert_allclose(np.array(bench.commands[-250:]), np.broadcast_to(there, (250, 4, 4)), atol=1e-3)


def test_command_keeps_its_limits_through_everything() -> None:
    """Approach, impact, another force, another stiffness, retreat, hold: speed, acceleration, jerk stay bounded."""
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(2.0)
    bench.press(4.0)
    bench.run(1.0)
    bench.controller.set_stiffness(DEFAULT_STIFFNESS.scaled(0.7), bench.t)
    bench.run(1.0)
    bench.controller.set_setpoint(HybridSetpoint(pose_from_rpy((np.pi, 0.1, 0.2), (0.6, 0.1, 0.1))), bench.t)
    bench.run(0.6)
    bench.kinematics = False
    bench.run(0.5)
    p = ControllerParameters()
    C = np.array([(X @ bench.hand.X_EC)[:3, 3] for X in bench.commands])
    v = np.diff(C, axis=0) / DT
    a = np.diff(v, axis=0) / DT
    j = np.diff(a, axis=0) / DT
    assert np.linalg.norm(v, axis=1).max() <= 1.001 * p.max_speed
    assert np.linalg.norm(a, axis=1).max() <= 1.01 * p.max_acceleration
    assert np.linalg.norm(j, axis=1).max() <= 1.01 * p.max_jerk


def test_changing_setpoint_and_stiffness_is_bumpless() -> None:
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(3.0)
    bench.press(10.0)  # the same again
    before = bench.commands[-1].copy()
    bench.run(0.3)
    assert_allclose(bench.commands[-1], before, atol=2e-5)
    bench.controller.set_stiffness(DEFAULT_STIFFNESS, bench.t)
    bench.run(1.0)
    assert_allclose(bench.commands[-1], before, atol=2e-5)
    bench.controller.disable(bench.t, "by the user")
    state = bench.run(0.3)
    assert (state.mode, state.reason) == ("disabled", "by the user")
    assert_allclose(bench.commands[-1], before, atol=2e-5)
    bench.controller.enable(bench.t)
    bench.run(0.3)
    assert_allclose(bench.commands[-1], before, atol=2e-5)


def test_another_stiffness_takes_over_without_a_jump() -> None:
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(3.0)
    bench.stiffness = DEFAULT_STIFFNESS.scaled(1.5)  # a firmer grip, known to the controller
    bench.controller.set_stiffness(bench.stiffness, bench.t)
    bench.run(3.0)
    assert_allclose(bench.force, 10.0, atol=TIGHT)


def test_a_tool_that_has_slid_on_its_membranes_is_pressed_by_what_loads_them() -> None:
    """By 2 mm along the force, which a spring would take for 1.6 N."""
    slid = make_pose(p=(0.0, 0.0, 0.002))
    bench = Bench().enabled()
    bench.told = lambda estimate: replace(estimate, X_CT=estimate.X_CT @ slid, X_PT=slid)
    bench.press(10.0)
    bench.run(3.0)
    assert_allclose(bench.force, 10.0, atol=TIGHT)


def test_relative_pose_setpoint_deflects_the_grasp_as_told() -> None:
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(2.0)
    bench.controller.set_setpoint(RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.008))), bench.t)
    bench.run(3.0)
    assert bench.state.mode == "position"
    assert_allclose(np.linalg.inv(bench.state.measured_X_CT)[2, 3], 0.008, atol=1e-4)
    assert_allclose(bench.force, 800.0 * 0.008 + 0.2 * 9.81, atol=0.1)


BENDS = {
    "aside": make_pose(p=(0.006, 0.0, 0.0)),
    "down": make_pose(p=(0.0, 0.0, 0.006)),
    "yaw": pose_from_rpy((0.0, 0.0, 0.14), (0.0, 0.0, 0.0)),
    "none, while the tool hangs": np.eye(4),
}


@pytest.mark.parametrize("name", BENDS)
def test_a_displacement_that_nothing_resists_ends_in_a_hold(name: str) -> None:
    """A free tool goes with the gripper, which would follow it for ever."""
    bench = Bench(table=-0.5).enabled()
    start, p_C = bench.X_WE.copy(), (bench.X_WE @ bench.hand.X_EC)[:3, 3]
    for _ in range(400):  # sent again and again, as a program does
        bench.controller.set_setpoint(RelativePoseSetpoint(BENDS[name]), bench.t)
        if bench.run(0.1).mode == "holding":
            break
    assert "nothing resists the tool there" in bench.state.reason
    bench.run(0.5)
    assert np.linalg.norm((bench.X_WE @ bench.hand.X_EC)[:3, 3] - p_C) <= 0.06  # the way to rest is part of it
    assert np.rad2deg(np.linalg.norm(so3_log(start[:3, :3].T @ bench.X_WE[:3, :3]))) <= 20.0


def test_a_displacement_that_is_reached_may_go_on_with_what_moves() -> None:
    bench = Bench().enabled()
    bench.controller.set_setpoint(RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.008))), bench.t)
    bench.run(2.0)
    for _ in range(2000):  # up by 120 mm, at 15 mm/s
        bench.table += 0.00006
        bench.step()
    assert bench.state.mode == "position"
    assert bench.force == pytest.approx(800.0 * 0.008 + 0.2 * 9.81, abs=2.5)


def test_a_displacement_asks_for_no_more_than_a_set_point_with_force_may() -> None:
    stiff = Bench(stiffness=DEFAULT_STIFFNESS.scaled(10.0)).enabled()
    refused(stiff, "SP11", RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.0045))))  # 36 N
    bench = Bench().enabled()
    bench.controller.set_setpoint(RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.008))), bench.t)
    bench.run(2.0)
    bench.controller.set_limits(replace(bench.controller.parameters, max_force=3.0), bench.t)
    assert "the limits were lowered: SP11" in bench.run(0.1).reason
    late = Bench().enabled()
    late.controller.checks.clock_problem = "0 comparisons"
    refused(late, "SP18", RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.004))))


def test_a_displacement_that_is_not_known_well_holds() -> None:
    bench = Bench().enabled()
    bench.controller.set_setpoint(RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.008))), bench.t)
    assert bench.run(1.0).mode == "position"
    bench.told = lambda estimate: replace(estimate, covariance=np.diag([1e-4] * 3 + [1e-4] * 3))  # 10 mm
    state = bench.run(0.3)
    assert state.mode == "holding"
    assert "the force is known to" in state.reason


@pytest.mark.parametrize("displaces", [True, False])
def test_clocks_that_come_to_be_in_doubt_end_what_loads_the_grasp_alone(displaces: bool) -> None:
    bench = Bench().enabled()
    bench.controller.set_setpoint(HybridSetpoint(DOWN), bench.t)
    bench.run(1.0)
    bench.controller.checks.clock_problem = "the estimator takes 80 ms off the images' stamps"
    assert bench.run(0.1).mode == "position"
    bench.controller.checks.clock_problem = ""
    if displaces:
        bench.controller.set_setpoint(RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.008))), bench.t)
    else:
        bench.press(5.0)
    bench.run(2.0)
    bench.controller.checks.clock_problem = "the estimator takes 80 ms off the images' stamps"
    state = bench.run(0.1)
    assert state.mode == "holding"
    assert "wait for the clocks: the estimator takes 80 ms" in state.reason


def test_a_set_point_whose_axes_turn_is_judged_anew() -> None:
    """Along C's y nothing is observed: a force that turns there must be refused, though its place alone is said."""
    bench = Bench()
    bench.observed = (True, False, True, True, True, True)
    bench.enabled()
    press = HybridSetpoint(
        DOWN, Wrench(np.zeros(3), np.array((0.0, 0.0, -5.0))), np.diag([0.0, 0.0, 1.0]), task_frame="surface"
    )
    bench.controller.set_setpoint(press, bench.t)
    bench.controller.set_setpoint(press.moved(DOWN, np.zeros(3), rotation_from_rpy((0.1, 0.0, 0.0))), bench.t)
    with pytest.raises(SetpointError, match="SP15"):
        bench.controller.set_setpoint(press.moved(DOWN, np.zeros(3), rotation_from_rpy((0.5, 0.0, 0.0))), bench.t)


def test_a_pose_that_jumps_while_a_displacement_presses_holds() -> None:
    bench = Bench().enabled()
    bench.controller.set_setpoint(RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.008))), bench.t)
    bench.run(2.0)
    force = bench.force
    bench.told = lambda e: replace(e, X_CT=e.X_CT @ make_pose(p=(0.0, 0.0, 0.008)))
    state = bench.run(1.0)
    assert state.mode == "holding"
    assert bench.force < force + 2.0


def test_a_stiffness_with_which_the_set_point_cannot_be_followed_holds() -> None:
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(2.0)
    bench.controller.set_stiffness(Stiffness(DEFAULT_STIFFNESS.rotation, (0.8, 1.2, 0.8)), bench.t)  # N/mm
    assert "the stiffness was changed: SP13" in bench.run(3.0).reason
    assert bench.force < 10.5


def test_a_stream_of_wrenches_holds_the_orientation_that_it_began_with() -> None:
    bench = Bench(noise=1e-4).enabled()
    rng = np.random.default_rng(1)

    def told(e: RelativePoseEstimate) -> RelativePoseEstimate:
        noise = so3_exp(np.deg2rad(0.2) * rng.standard_normal(3))
        covariance = np.diag([np.deg2rad(0.2) ** 2] * 3 + [1e-8] * 3)
        return replace(e, X_CT=e.X_CT @ make_pose(noise), covariance=covariance)

    bench.told = told
    before = bench.commands[-1][:3, :3]
    for _ in range(600):
        bench.controller.set_setpoint(WrenchSetpoint(force_down(6.0)), bench.t)
        bench.run(0.02)
    assert bench.state.mode == "contact"
    assert np.linalg.norm(rotation_error(bench.commands[-1][:3, :3], before)) < np.deg2rad(0.5)


def test_wrench_setpoint_is_algorithm_two_along_all_directions() -> None:
    bench = Bench().enabled()
    bench.controller.set_setpoint(WrenchSetpoint(Wrench(np.zeros(3), np.array((0.0, 0.0, -8.0)))), bench.t)
    bench.run(3.0)
    assert_allclose(bench.force, 8.0, atol=TIGHT)


def test_tool_frame_and_surface_frame_mean_the_same_force() -> None:
    for frame, sign in (("tool", 1.0), ("surface", -1.0)):
        bench = Bench().enabled()
        setpoint = HybridSetpoint(
            bench.start,
            Wrench(np.zeros(3), np.array((0.0, 0.0, sign * 6.0))),
            PRESS_Z,
            task_frame=frame,  # type: ignore[arg-type]
        )
        bench.controller.set_setpoint(setpoint, bench.t)
        bench.run(3.0)
        assert_allclose(bench.force, 6.0, atol=TIGHT)


def surface(angle: float, force: float) -> HybridSetpoint:
    """Press along the z of a surface that is turned by an angle [rad] about y."""
    wrench = Wrench(np.zeros(3), np.array((0.0, 0.0, -force)))
    R = pose_from_rpy((0.0, angle, 0.0), (0.0, 0.0, 0.0))[:3, :3]
    return HybridSetpoint(DOWN, wrench, PRESS_Z, task_frame="surface", R_W_task=R)


def test_a_surface_that_turns_a_little_keeps_contact_and_one_that_turns_far_is_sought_anew() -> None:
    """The direction pressed along goes on through 45 degrees, where another row of its projector is the largest."""
    bench = Bench().enabled()
    bench.controller.set_setpoint(surface(0.0, 5.0), bench.t)
    bench.run(2.0)
    normal = bench.controller.law.plan.normals[0]
    for angle in np.linspace(0.0, -1.0, 21)[1:]:
        bench.controller.set_setpoint(surface(angle, 5.0), bench.t)
        assert bench.step().mode == "contact"
        assert normal @ bench.controller.law.plan.normals[0] > 0.9
        normal = bench.controller.law.plan.normals[0]
    bench.controller.set_setpoint(surface(0.2, 5.0), bench.t)
    assert bench.step().mode == "approach"


def test_a_direction_that_an_image_turns_far_at_once_is_not_followed() -> None:
    """A tool frame turns with the tool; one that has jumped tells nothing of where to press."""
    bench = Bench(parameters=ControllerParameters(rotation_filter=0.0)).enabled()
    force = Wrench(np.zeros(3), np.array((0.0, 0.0, 6.0)))
    bench.controller.set_setpoint(HybridSetpoint(bench.start, force, PRESS_Z, task_frame="tool"), bench.t)
    for angle, keeps in ((0.0, True), (4.0, True), (-25.0, False)):
        bench.run(2.0)
        assert bench.state.mode == "contact"
        bench.X_TT_new = pose_from_rpy((np.deg2rad(angle), 0.0, 0.0), np.zeros(3))
        state = bench.run(bench.delay + 4.0 / bench.image_rate)
        assert state.mode == ("contact" if keeps else "holding")
    assert "jumped" in bench.state.reason


def test_regulated_error_counts_the_torque_axes_of_T_not_of_the_tip() -> None:
    """The tip's axes are turned by 90 degrees about z: T's x is minus the tip's y."""
    tool = Tool(T_tip=Frame((0.0, 0.0, 0.12), (0.0, 0.0, 90.0)))
    bench = Bench(tool=tool, start=pose_from_rpy((np.pi, 0.0, 0.0), (0.5, 0.0, 0.02)) @ tool.X_Ttip).enabled()
    axes = (True, False, False)
    wrench = Wrench(np.zeros(3), np.array((0.0, 0.0, 5.0)))
    setpoint = HybridSetpoint(bench.start, wrench, PRESS_Z, axes, task_frame="tool", contact_resists=axes)
    bench.controller.set_setpoint(setpoint, bench.t)
    bench.run(0.5)
    law = bench.controller.law
    law.filtered_task = Wrench(np.array((0.3, 0.4, 0.5)), np.array((1.0, 2.0, 7.0)))  # in the tip's axes
    error = law.regulated_error()
    assert error is not None
    assert_allclose(error.torque, (0.0, 0.4, 0.0), atol=1e-9)
    assert_allclose(error.force, (0.0, 0.0, 2.0), atol=1e-9)


def refused(bench: Bench, code: str, setpoint: object) -> None:
    before = bench.state
    with pytest.raises(SetpointError) as caught:
        bench.controller.set_setpoint(setpoint, bench.t)  # type: ignore[arg-type]
    assert caught.value.code == code
    assert any(c.isdigit() for c in str(caught.value)[4:])  # a refusal carries numbers
    after = bench.step()
    assert after.mode == before.mode
    assert after.counters.setpoints_refused == before.counters.setpoints_refused + 1


def force_down(size: float) -> Wrench:
    return Wrench(np.zeros(3), np.array((0.0, 0.0, -size)))


def test_beyond_force_deflection_tipping_and_workspace_is_refused() -> None:
    bench = Bench().enabled()
    refused(bench, "SP11", HybridSetpoint(DOWN, force_down(15.1), PRESS_Z))
    far = DOWN.copy()
    far[0, 3] = 3.0
    refused(bench, "SP16", HybridSetpoint(far))
    refused(bench, "SP10", HybridSetpoint(DOWN, stamp=bench.t - 2.0))
    refused(bench, "SP13", RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.05))))
    weak = Bench(stiffness=Stiffness((4.0, 1.2, 4.0), (800.0, 1200.0, 800.0))).enabled()
    refused(weak, "SP14", HybridSetpoint(DOWN, force_down(10.0), PRESS_Z))
    soft = Bench(stiffness=Stiffness((4.0, 3.0, 4.0), (200.0, 200.0, 200.0))).enabled()
    refused(soft, "SP13", HybridSetpoint(DOWN, force_down(10.0), PRESS_Z))


def test_mispaired_torque_and_unobserved_force_are_refused() -> None:
    bench = Bench().enabled()
    load = Wrench(np.array((0.0, 0.1, 0.0)), np.array((0.0, 0.0, -5.0)))
    axes = (True, False, False)
    refused(bench, "SP12", HybridSetpoint(DOWN, load, PRESS_Z, axes, contact_resists=axes))
    blind = Bench()
    blind.observed = (True, True, False, True, True, True)
    blind.enabled()
    with pytest.raises(SetpointError, match=r"SP15.*C's z.*does not observe"):
        blind.press(5.0)


def test_force_that_is_refused_while_running_for_what_is_not_observed_is_refused_at_once() -> None:
    """A quarter of an oblique force lies along C's x: none of the projector's rows has as much of it."""
    bench = Bench()
    bench.observed = (False, True, True, True, True, True)
    bench.enabled()
    n = np.array((0.26, 0.68, 0.69)) / np.linalg.norm((0.26, 0.68, 0.69))
    with pytest.raises(SetpointError, match=r"SP15.*C's x.*does not observe"):
        bench.controller.set_setpoint(HybridSetpoint(DOWN, Wrench(np.zeros(3), -3.0 * n), np.outer(n, n)), bench.t)


@pytest.mark.parametrize("axis", [0, 1, 3, 4, 5])
def test_an_axis_that_is_not_observed_and_not_asked_for_does_not_change_the_force(axis: int) -> None:
    bench = Bench()
    bench.observed = tuple(i != axis for i in range(6))  # type: ignore[assignment]
    bench.enabled().press(10.0)
    bench.run(3.0)
    assert_allclose(bench.force, 10.0, atol=TIGHT)
    assert max(bench.forces) < 12.0


def lose(bench: Bench, *axes: int) -> None:
    """From now on the estimate does not observe these of x, y, z, roll, pitch, yaw."""
    bench.observed = tuple(i not in axes for i in range(6))  # type: ignore[assignment]


@pytest.mark.parametrize("image_rate", [45.0, 12.0])
@pytest.mark.parametrize("task_frame", ["world", "tool"])
def test_a_force_direction_that_is_lost_while_pressing_makes_it_hold(image_rate: float, task_frame: str) -> None:
    parameters = ControllerParameters(estimate_timeout=0.5 if image_rate > 40.0 else 0.14)
    bench = Bench(image_rate=image_rate, parameters=parameters).enabled()
    sign = -1.0 if task_frame == "world" else 1.0
    wrench = Wrench(np.zeros(3), np.array((0.0, 0.0, sign * 10.0)))
    bench.controller.set_setpoint(HybridSetpoint(DOWN, wrench, PRESS_Z, task_frame=task_frame), bench.t)  # type: ignore[arg-type]
    bench.run(3.0)
    lose(bench, 2)
    state = bench.run(3.0)
    assert state.mode == "holding"
    assert "force along C's z, which the estimator does not observe" in state.reason
    assert max(bench.forces[-700:]) < 10.5
    lose(bench)
    assert bench.run(0.3).mode == "holding"  # latched
    bench.controller.enable(bench.t)
    bench.press(10.0)
    bench.run(3.0)
    assert_allclose(bench.force, 10.0, atol=TIGHT)


def test_one_image_that_does_not_observe_a_force_direction_is_bridged() -> None:
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(3.0)
    lose(bench, 2)
    bench.run(0.024)
    lose(bench)
    state = bench.run(1.0)
    assert state.mode == "contact"
    assert state.counters.estimates_invalid in (1, 2)
    assert np.abs(np.array(bench.forces[-250:]) - 10.0).max() < 0.1


@pytest.mark.parametrize(("axis", "name"), [(3, "roll"), (4, "pitch"), (5, "yaw")])
def test_a_torque_axis_that_is_lost_makes_it_hold(axis: int, name: str) -> None:
    bench = Bench().enabled()
    bench.controller.set_setpoint(WrenchSetpoint(force_down(8.0), contact_resists=(True, True, True)), bench.t)
    assert bench.run(1.0).mode == "contact"
    lose(bench, axis)
    state = bench.run(0.3)
    assert state.mode == "holding"
    assert f"the estimator does not observe {name}" in state.reason


def test_a_displacement_that_is_not_observed_is_refused_or_held_since_it_would_be_followed_for_ever() -> None:
    bench = Bench(table=-0.5).enabled()
    setpoint = RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.008)))
    bench.controller.set_setpoint(setpoint, bench.t)
    assert bench.run(0.5).mode == "position"
    lose(bench, 0, 3)  # where nothing is asked for
    assert bench.run(0.5).mode == "position"
    lose(bench, 2)
    state = bench.run(0.5)
    assert state.mode == "holding"
    assert "in z, which the estimator does not observe" in state.reason
    bench.controller.enable(bench.t)
    bench.step()
    refused(bench, "SP15", setpoint)


def test_axes_that_carry_nothing_may_be_lost() -> None:
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(2.0)
    lose(bench, 0, 1, 3, 4, 5)
    assert bench.run(2.0).mode == "contact"
    assert_allclose(bench.force, 10.0, atol=TIGHT)


LOST = {
    "none": lambda _: False,
    "every second": lambda told: round(told.stamp * 45.0) % 2 == 0,
    "all that are invalid": lambda told: not told.valid,
}


@pytest.mark.parametrize("lost", list(LOST))
@pytest.mark.parametrize("images", [1, 8])
@pytest.mark.parametrize("image_rate", [45.0, 10.0])
def test_a_grasp_initialized_while_pressing_makes_it_hold(lost: str, images: int, image_rate: float) -> None:
    bench = Bench(image_rate=image_rate).enabled()
    bench.press(10.0)
    bench.run(3.0)
    bench.lost = LOST[lost]
    bench.initialize_grasp(images)
    state = bench.run(3.0)
    assert state.mode == "holding"
    assert "a new grasp is taken" in state.reason or "relative_pose is stale" in state.reason
    if lost == "none":
        assert "a new grasp is taken, deflections count from it" in state.reason
    assert max(bench.forces) < 12.0


def test_a_grasp_initialized_unnoticed_shows_as_a_jump() -> None:
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(3.0)
    bench.initialize_grasp(announced=False)
    state = bench.run(3.0)
    assert state.mode == "holding"
    assert "jumped" in state.reason
    bench.controller.enable(bench.t)  # the arm is where it was: what is gone would be pressed once more
    bench.press(10.0)
    assert "initialize the grasp free of load" in bench.run(1.0).reason
    assert max(bench.forces) < 12.0


@pytest.mark.parametrize("enabled", [False, True])
def test_a_grasp_initialized_in_free_air_is_pressed_with_once_enabled(enabled: bool) -> None:
    bench = Bench(tool=Tool(mass=0.02))  # something else carries a heavier one
    bench.run(0.3)
    if enabled:
        bench.enabled()
    bench.initialize_grasp()
    bench.run(0.5)
    bench.controller.enable(bench.t)
    bench.press(10.0)
    assert bench.run(3.0).mode == "contact"


@pytest.mark.parametrize("then", ["disable", "relative pose", "another frame"])
def test_the_estimated_wrench_is_written_in_the_task_frame_that_is_told_with_it(then: str) -> None:
    """Also before the next image, which may never come."""
    bench = Bench().enabled()
    bench.controller.set_setpoint(HybridSetpoint(DOWN, force_down(-6.0), PRESS_Z, task_frame="tool"), bench.t)
    before = bench.run(3.0)
    assert_allclose(before.estimated.force, (0.0, 0.0, 6.0), atol=TIGHT)
    if then == "disable":
        bench.controller.disable(bench.t, "asked")
    elif then == "relative pose":
        bench.controller.set_setpoint(RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.005))), bench.t)
    else:
        bench.press(6.0)
    bench.estimates = False
    state = bench.step()
    assert_allclose(state.R_W_task, np.eye(3))
    assert_allclose(state.estimated.force, (0.0, 0.0, -6.0), atol=TIGHT)
    assert_allclose(state.filtered.force, (0.0, 0.0, -6.0), atol=TIGHT)


def test_no_growth_of_memory_over_steps() -> None:
    import tracemalloc

    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(2.5)  # every ring has gone round
    bench.commands.clear()
    bench.forces.clear()
    tracemalloc.start()
    bench.run(0.5)
    first = tracemalloc.get_traced_memory()[0]
    bench.commands.clear()
    bench.forces.clear()
    bench.run(4.0)
    bench.commands.clear()
    bench.forces.clear()
    grown = tracemalloc.get_traced_memory()[0] - first
    tracemalloc.stop()
    assert grown < 100_000  # bytes over a thousand steps: noise of the interpreter, no growth per step


def test_memory_does_not_grow_with_steps() -> None:
    """An hour is 900 000 steps: a list or reference kept per step would show as tens of bytes each or more."""
    assert growth(3000) < 1500.0  # bytes per 1000 steps; an array kept per step would make 100 000


def test_the_state_says_enabled_before_the_next_step() -> None:
    """Where simulated time stands still, a task is asked for before there is one; the old state told an old reason."""
    bench = Bench().enabled()
    bench.controller.disable(bench.t, "an old reason")
    assert bench.controller.state.mode == "disabled"
    bench.controller.enable(bench.t)
    assert (bench.controller.state.mode, bench.controller.state.reason) == ("idle", "")


@pytest.mark.parametrize("deviation", [0.0, 3e-4, 0.01])
def test_a_force_that_is_hardly_known_is_not_controlled(deviation: float) -> None:
    """However large the deviation that an estimate states: no check of its pose could tell anything."""
    bench = Bench()
    covariance = np.diag([1e-6] * 3 + [deviation**2] * 3)
    bench.told = lambda e: replace(e, covariance=covariance)
    bench.enabled().press(10.0)
    reason = bench.run(2.0).reason
    if deviation < 0.003:
        assert reason == ""
        assert bench.force == pytest.approx(10.0, abs=0.5)
    else:
        assert "known to 8.0 N only" in reason
        assert max(bench.forces) == 0.0


def test_a_variance_below_zero_is_no_estimate() -> None:
    bench = Bench().enabled()
    bench.told = lambda e: replace(e, covariance=-1e-8 * np.eye(6))
    bench.run(0.5)
    assert "a variance of its covariance is -1e-08, not at least 0" in bench.state.reason


@pytest.mark.parametrize("ahead", [0.06, 0.25])
def test_estimates_of_a_clock_that_is_ahead_are_named(ahead: float) -> None:
    """None ever meets kinematics of its moment: the next one is there first."""
    bench = Bench(stamp_error=ahead + 0.05, image_rate=30.0)
    bench.run(1.0)
    with pytest.raises(ControlRefusedError, match="after the newest current_pose: compare the clocks"):
        bench.controller.enable(bench.t)
    assert bench.state.counters.estimates_unmatched > 10


def test_a_displacement_goes_on_with_a_stiffness_that_loads_it_no_more_than_is_allowed() -> None:
    bench = Bench().enabled()
    bench.controller.set_setpoint(RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.014))), bench.t)
    bench.run(0.5)
    bench.controller.set_stiffness(DEFAULT_STIFFNESS.scaled(1.05), bench.t)  # 11.8 N and the weight: 13.7 N of 15
    assert bench.run(0.1).mode == "position"
    bench.controller.set_stiffness(DEFAULT_STIFFNESS.scaled(1.6), bench.t)
    assert "the stiffness was changed: SP11" in bench.run(0.1).reason


def test_a_stream_of_torques_turns_a_free_tool_no_further_than_one_set_point_does() -> None:
    bench = Bench(k_table=500.0).enabled()
    torque = WrenchSetpoint(Wrench(np.array((0.5, 0.0, 0.0)), np.array((0.0, 0.0, -5.0))), contact_resists=(True,) * 3)
    limits, R_start = set[str](), bench.X_WE[:3, :3]
    while bench.state.mode != "holding" and bench.t < 6.0:
        bench.controller.set_setpoint(torque, bench.t)
        limits |= set(bench.run(0.05).limits_hit)
    assert "max_drift" in limits
    assert np.rad2deg(np.linalg.norm(so3_log(R_start.T @ bench.commands[-1][:3, :3]))) < 50.1


def test_a_tool_that_its_contact_does_not_hold_upright_is_not_turned_on_for_ever() -> None:
    """A contact that is said to resist: the tool stayed 50 degrees aslant, and no reason was told."""
    bench = Bench().enabled()
    x = (True, False, False)
    wanted = Wrench(np.array((0.5, 0.0, 0.0)), np.array((0.0, 0.0, -5.0)))
    s = HybridSetpoint(bench.start, wanted, PRESS_Z, torque_axes=x, contact_resists=x)
    bench.controller.set_setpoint(s, bench.t)
    bench.run(4.5)
    assert bench.state.mode == "holding"
    assert "the contact does not resist about the torque axes" in bench.state.reason


@pytest.mark.parametrize("x", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0)])
def test_another_surface_is_found_where_it_is_expected_after_a_lift(x: tuple[float, float, float]) -> None:
    bench = Bench().enabled()
    bench.press(5.0, task_frame="found")
    assert bench.run(2.0).mode == "contact"
    lifted = DOWN.copy()
    lifted[2, 3] += 0.05
    bench.controller.set_setpoint(HybridSetpoint(lifted, task_frame="found"), bench.t)
    bench.run(3.0)
    before = bench.commands[-1][:3, 3]
    z = np.array((-1.0, 0.0, 0.0))  # of a wall
    wall = np.column_stack((x, np.cross(z, x), z))
    press = HybridSetpoint(lifted, force_down(5.0), PRESS_Z, task_frame="found", R_W_task=wall)
    bench.controller.set_setpoint(press, bench.t)
    assert bench.run(1.0).mode == "approach"
    way = bench.commands[-1][:3, 3] - before
    assert way[0] > 0.02
    assert_allclose(way[1:], 0.0, atol=1e-3)

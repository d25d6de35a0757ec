# SPDX-License-Identifier: Apache-2.0
"""What the contact tells while force is controlled: how images are dated, and whether the force swings by itself."""

from types import SimpleNamespace

import numpy as np
import pytest
from quasi_static import DT, Bench

from seed_control.monitor.contact.contact_motion import ContactMotion, FollowedMotion
from seed_control.monitor.contact.force_watch import ForceWatch
from seed_control.monitor.contact.late_stamps import LateStamps
from seed_control.monitor.contact.swing import LEGS, Swing
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.wrench.history import PoseHistory
from seed_core.hand import DEFAULT_STIFFNESS
from seed_core.spatial import Wrench, make_pose

NOISE = 3e-4  # [m]


def wiping(bench: Bench, seconds: float, speed: float = 0.05) -> Bench:
    """Pressed for a second with 10 N, then moved along x."""
    setpoint = bench.press(10.0)
    bench.run(1.5)
    for i in range(round(seconds / DT)):
        X = bench.start.copy()
        X[0, 3] += speed * i * DT
        if bench.state.mode == "holding":
            break
        bench.controller.set_setpoint(setpoint.moved(X, np.array((speed, 0.0, 0.0))), bench.t)
        bench.step()
    return bench


@pytest.mark.parametrize("error", [-0.05, -0.02, 0.0, 0.02, 0.05])
def test_stamp_error_is_measured_while_the_force_is_built_up(error: float) -> None:
    bench = Bench(stamp_error=error, noise=NOISE, delay=0.06).enabled()
    bench.press(10.0)
    bench.run(1.8)
    late = bench.controller.supervisor.watch.late
    assert late.error is not None
    assert abs(late.error - error) < max(3.0 * late.deviation, 0.003)
    assert late.deviation < 0.012
    assert not late.reason
    assert bool(late.warning) == (abs(error) > 0.03)
    assert bench.state.mode == "contact"


@pytest.mark.parametrize("k_table", [500.0, 4e4])
def test_soft_environment_is_not_taken_for_a_wrong_clock(k_table: float) -> None:
    bench = Bench(k_table=k_table, noise=NOISE).enabled()
    bench.press(10.0)
    bench.run(2.0)
    late = bench.controller.supervisor.watch.late
    assert late.error is None or abs(late.error) < 0.015  # None: contact came too gradually to tell
    assert not late.reason


@pytest.mark.parametrize("error", [0.085, -0.085])
def test_stamps_that_the_loop_cannot_bear_make_it_hold_within_a_second_of_contact(error: float) -> None:
    bench = Bench(stamp_error=error, noise=NOISE).enabled()
    bench.press(10.0)
    touched = np.inf
    while bench.state.mode != "holding" and bench.t < 6.0:
        touched = min(touched, bench.t if bench.force > 0.0 else np.inf)
        bench.step()
    assert bench.state.mode == "holding"
    assert "images are dated" in bench.state.reason
    assert ("late" if error > 0.0 else "early") in bench.state.reason
    assert bench.t - touched < 1.0


@pytest.mark.parametrize("late", [0.0, 0.085])
def test_a_grasp_that_slides_does_not_hold_as_if_stamps_were_late(late: float) -> None:
    """Pressed and let go: the deflection stays behind the way by a play of +-2 mm, and by the clock besides."""
    stamps = np.arange(0.0, 2.0, DT)
    way = 0.004 * (1.0 - np.cos(2.0 * np.pi * np.clip(stamps - 0.4, 0.0, 0.8) / 0.8))
    behind, play = np.zeros_like(way), 2e-3
    for i in range(1, len(way)):
        behind[i] = np.clip(behind[i - 1], way[i] - play, way[i] + play)
    history, motion, rng = PoseHistory(), ContactMotion(np.zeros(3)), np.random.default_rng(1)
    for t, z in zip(stamps, way, strict=True):
        history.add(float(t), make_pose(p=(0.0, 0.0, z)))
    watch, n, seen = LateStamps(ControllerParameters()), np.array((0.0, 0.0, 1.0)), []
    for k, t in enumerate(np.arange(0.35, 1.55, 1.0 / 45.0).tolist()):
        X_WC, X_WT = np.eye(4), np.eye(4)
        X_WC[2, 3] = np.interp(t - late, stamps, behind) + 1e-4 * rng.standard_normal()
        motion.add(SimpleNamespace(stamp=t, X_WC=X_WC, X_WT=X_WT, tip=np.zeros(3), variance=1e-8))  # type: ignore[arg-type]
        if k % 4 == 3:
            followed = motion.followed(n, history)
            seen += [followed.shift] if followed is not None else []
            watch.update(followed, lambda: motion.sure(n, history))
    assert max(seen) > 0.07  # the lag alone would hold
    assert bool(watch.reason) == bool(late)


def look(shift: float, deviation=0.006, share=0.9, explained=0.97, steepness=0.1) -> FollowedMotion:
    return FollowedMotion(shift, deviation, share, explained, steepness)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("shifts", "sure", "holds"),
    [
        ([0.069] * 4, 20.0, [False] * 4),
        ([0.08, 0.08], 20.0, [False, True]),  # by less than two deviations beyond the bound of 70 ms
        ([0.083], 20.0, [True]),
        ([0.08, 0.06, 0.08, 0.08], 20.0, [False, False, False, True]),
        ([0.1, 0.1], 5.0, [False, False]),  # a grasp that slides might look like this
    ],
)
def test_stamps_hold_that_are_wrong_twice_in_a_row_or_beyond_doubt(shifts, sure, holds, sign: float) -> None:
    watch, held = LateStamps(ControllerParameters()), []
    for shift in shifts:
        watch.update(look(sign * shift), lambda: sure)
        assert f"too {'late' if sign > 0.0 else 'early'}, as" in watch.warning
        assert watch.warning.endswith("or the grasp slides") is (sure < 9.0)
        held.append(bool(watch.reason))
    assert held == holds
    watch.restart()
    assert not watch.reason
    watch.update(look(0.05), lambda: 0.0)
    assert not watch.reason
    assert watch.warning.endswith("as the motion in contact shows")
    watch.update(look(0.035), lambda: 0.0)
    assert not watch.warning


@pytest.mark.parametrize(
    "seen",
    [
        None,
        look(0.1, deviation=0.013),
        look(0.1, share=0.09),
        look(0.1, share=1.5),
        look(0.1, explained=0.89),
        look(0.1, steepness=0.029),
    ],
)
def test_a_motion_that_the_gripper_explains_badly_says_nothing_of_stamps(seen: FollowedMotion | None) -> None:
    watch = LateStamps(ControllerParameters())
    watch.update(look(0.01), lambda: 20.0)
    watch.update(seen, lambda: 20.0)
    assert (watch.error, watch.deviation, watch.warning, watch.reason) == (0.01, 0.006, "", "")


@pytest.mark.parametrize("foretold", [False, True])
def test_bumps_say_nothing_about_clocks_and_are_no_swing(foretold: bool) -> None:
    p = ControllerParameters() if foretold else ControllerParameters(moving_surface=0.0)
    for wavelength in (0.012, 0.025, 0.05):  # 4, 2 and 1 a second
        bench = wiping(Bench(bumps=(1e-3, wavelength), noise=NOISE, parameters=p).enabled(), 4.0)
        assert foretold or np.ptp(bench.forces[-500:]) > 0.5  # they are felt
        assert bench.state.mode == "contact", bench.state.reason
        assert not bench.controller.supervisor.watch.late.warning


def test_force_that_swings_by_itself_makes_it_hold() -> None:
    bench = Bench(law="published", delay=0.1, noise=NOISE).enabled()
    bench.press(10.0)
    while bench.state.mode != "holding" and bench.t < 6.0:
        bench.step()
    assert "the force swings" in bench.state.reason


@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_steps_of_the_wanted_force_are_no_swing(scale: float) -> None:
    bench = Bench(stiffness=DEFAULT_STIFFNESS.scaled(scale), noise=NOISE).enabled()
    for force in (8.0, 4.0, 8.0, 4.0, 8.0, 4.0, 8.0, 4.0):
        bench.press(force)
        bench.run(0.4)
    assert bench.state.mode == "contact", bench.state.reason


def legs(period: float, sizes: list[float]) -> Swing:
    """A triangle of these legs [N], one per half of a period [s]."""
    swing, t, force, up = Swing(), 0.0, 0.0, 1.0
    for size in sizes:
        for _ in range(10):
            t, force = t + 0.05 * period, force + 0.1 * up * size
            swing.update(t, force, 0.5)
        up = -up
    return swing


@pytest.mark.parametrize(
    ("period", "sizes", "swings"),
    [
        (0.4, [2.0] * (LEGS + 2), True),
        (0.4, [4.0 * 0.6**i for i in range(LEGS + 2)], False),  # fades
        (0.4, [0.4] * (LEGS + 2), False),  # noise
        (2.0, [2.0] * (LEGS + 2), False),  # slower than any loop
        (0.4, [2.0] * LEGS, False),  # not for long yet
    ],
)
def test_legs_that_are_large_regular_and_do_not_fade_are_suspected(
    period: float, sizes: list[float], swings: bool
) -> None:
    assert legs(period, sizes).suspected == swings


def test_a_force_that_is_off_by_turns_stays_told_until_it_is_well_within() -> None:
    """A table that moves at 0.6 Hz: over a second the error is a little more, and a little less, than a fifth."""
    watch, told = ForceWatch(3.0), []
    for k in range(45 * 8):
        t = k / 45.0
        error = (2.0 + 0.25 * np.sin(2.0 * np.pi * 0.6 * t)) if t < 6.0 else 0.5
        watch.update(t, [-10.0 + error], [-10.0], 0.05, True)
        told.append("the force is off" in watch.warning)
    since = told.index(True)
    assert since < 2 * 45
    assert all(told[since : 6 * 45])
    assert not told[-1]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("along", "deviation", "holds"),
    [
        ([10.0, 5.0], 0.05, False),
        ([12.9, 5.0], 0.05, False),
        ([13.1, 5.0], 0.05, True),  # of either direction
        ([10.0, 8.1], 0.05, True),
        ([13.9, 5.0], 1.0, False),  # four deviations
        ([14.1, 5.0], 1.0, True),
        ([2.0, 0.0], 0.05, False),  # too little presses on nothing
    ],
)
def test_a_force_that_is_too_large_in_three_images_in_a_row_holds(along, deviation, holds, sign: float) -> None:
    watch, right, held = ForceWatch(3.0), [sign * 10.0, -5.0], []
    force = [sign * along[0], -along[1]]
    for i, told in enumerate([right] * 20 + [force] * 2 + [right] + [force] * 3):
        watch.update(0.02 * i, told, right, deviation, True)
        held.append(bool(watch.reason))
    assert held == [False] * 25 + [holds]


@pytest.mark.parametrize(("deviation", "told"), [(0.05, True), (1.0, False)])
def test_what_a_force_is_off_by_is_told_of_the_worst_direction_without_the_noise(deviation: float, told: bool) -> None:
    watch = ForceWatch(3.0)
    for i in range(100):
        watch.update(0.02 * i, [-7.9, 5.1], [-10.0, 5.0], deviation, i > 20)
        assert not (watch.warning and i <= 60)  # a second of it, once the force is built up
    assert watch.warning[:46] == ("the force is off by 2.1 N (wanted 10.0 N): the" if told else "")


@pytest.mark.parametrize(("short_by", "told"), [(0.0, False), (4.0, True)])
def test_a_force_is_watched_though_another_one_is_wanted_all_the_time(short_by: float, told: bool) -> None:
    """Streamed set-points change more often than a force is built up."""
    watch = ForceWatch(3.0)
    for k in range(45 * 4):
        t = k / 45.0
        wanted = 10.0 if t % 0.6 < 0.3 else 8.0
        lagging = 10.0 if (t - 0.15) % 0.6 < 0.3 else 8.0
        watch.update(t, [short_by - lagging], [-wanted], 0.05, False)
    assert ("the force is off" in watch.warning) == told


def test_a_direction_that_touches_is_watched_while_another_is_sought() -> None:
    """Pressed on a table and towards a wall that is not there, with a table that moves as nobody foretells."""
    bench = Bench(noise=NOISE).enabled()
    force, along = Wrench(np.zeros(3), np.array((0.0, -4.0, -3.0))), np.diag((0.0, 1.0, 1.0))
    bench.controller.set_setpoint(HybridSetpoint(bench.start, force, along, approach_speed=0.02), bench.t)
    bench.run(1.35)
    told = False
    while bench.t < 3.1 and not told:
        bench.table = 1.2e-3 * sum(np.sin(2.0 * np.pi * f * (bench.t - 1.6)) for f in (1.7, 2.9))
        bench.step()
        told = "the force is off" in bench.controller.supervisor.watch.warning
    assert bench.state.mode == "approach", bench.state.reason
    assert told

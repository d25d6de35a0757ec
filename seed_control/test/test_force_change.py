# SPDX-License-Identifier: Apache-2.0
"""A change of the wanted force is followed as fast as the limits allow, and no further."""

import numpy as np
import pytest
from quasi_static import DT, PRESS_Z, Bench

from seed_control.law.force_change import ForceChange
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint
from seed_core.bushing import Stiffness
from seed_core.spatial import make_pose


def settled_at(force: float, **more: object) -> Bench:
    """A bench that has pressed for long with this force."""
    bench = Bench(**more).enabled()  # type: ignore[arg-type]
    bench.press(force)
    bench.run(3.0)
    return bench


def rise(forces: np.ndarray) -> float:
    """From 10 to 90 % of the way from the first to the last [s]."""
    share = (forces - forces[0]) / (forces[-1] - forces[0])
    return DT * float(np.flatnonzero(share > 0.9)[0] - np.flatnonzero(share > 0.1)[0])


@pytest.mark.parametrize("way", [5e-4, -2e-3, 6.5e-3, -0.02])
def test_a_change_arrives_within_its_bounds_without_going_too_far(way: float) -> None:
    """At rest at its end whatever its length: it brakes as soon as the jerk needs to turn the acceleration."""
    change, path = ForceChange(2.0, 200.0), [0.0]
    change.left = way
    for _ in range(250):
        path.append(path[-1] + change.advance(DT, 0.1))
    v = np.diff(path) / DT
    a = np.diff(v) / DT
    assert path[-1] == pytest.approx(way, abs=2e-7)
    assert max(np.array(path) / way) < 1.07
    assert abs(v).max() <= 0.1 + 1e-9
    assert abs(a).max() <= 2.0 + 1e-9
    assert abs(np.diff(a) / DT).max() <= 200.0 + 1e-6
    assert change.left == change.v == change.a == 0.0


def test_an_arm_that_trails_goes_no_further_than_any_change() -> None:
    """With 15 ms of lag, 0.1 to 15 mm: where the jerk makes the command go too far, it is back before the arm comes."""
    share = 1.0 - np.exp(-DT / 0.015)
    for way in (*np.arange(1e-4, 2e-3, 1e-4), *np.arange(2e-3, 0.015, 4e-4)):
        change, place, arm, furthest = ForceChange(2.0, 200.0), 0.0, 0.0, 0.0
        change.left = way
        for _ in range(100):
            place += change.advance(DT, 0.135)
            arm += share * (place - arm)
            furthest = max(furthest, arm)
        assert furthest < 1.001 * way


@pytest.mark.parametrize(("before", "after"), [(5.0, 10.0), (10.0, 5.0)])
def test_the_force_follows_a_step_within_80_ms_and_does_not_overshoot(before: float, after: float) -> None:
    """5 N are 6.3 mm of a grasp of 800 N/m: 2 m/s^2 alone need 60 ms from 10 to 90 %, and `press_speed` 111 ms."""
    bench = settled_at(before)
    start = len(bench.forces)
    bench.press(after)
    bench.run(1.0)
    forces, way = np.array(bench.forces[start:]), after - before
    assert rise(forces) <= 0.08
    assert max((forces - forces[-1]) / way) < 0.02
    assert forces[-1] == pytest.approx(after, abs=0.05)


def test_a_step_keeps_the_limits_of_the_command() -> None:
    p, bench = ControllerParameters(), settled_at(3.0)
    start = len(bench.commands)
    bench.press(12.0)
    bench.run(0.5)
    v = np.diff([X[:3, 3] for X in bench.commands[start - 1 :]], axis=0) / DT
    a = np.diff(v, axis=0) / DT
    assert np.linalg.norm(v, axis=1).max() <= 3.0 * p.press_speed + 1e-3
    assert np.linalg.norm(a, axis=1).max() <= p.max_acceleration + 1e-6
    assert np.linalg.norm(np.diff(a, axis=0) / DT, axis=1).max() <= p.max_jerk + 1e-3


def test_a_set_points_own_press_speed_bounds_a_change_of_its_force() -> None:
    bench = settled_at(4.0)
    bench.press(9.0, press_speed=0.01)
    bench.run(0.3)
    start = len(bench.commands)
    v = np.diff([X[2, 3] for X in bench.commands[start - 70 :]]) / DT
    assert abs(v).max() <= 0.0105


def test_soft_ground_whose_share_is_believed_wrong_takes_no_more_force_than_wanted() -> None:
    """What goes fast is the deflection that a hard surface needs. The ground's share of the way is pressed slowly."""
    bench = settled_at(5.0, k_table=800.0)
    start = len(bench.forces)
    for observer in bench.controller.law.observers:  # type: ignore[attr-defined]
        observer._x[:, 4] = 0.8  # the truth is 0.5
    bench.press(9.0)
    bench.run(0.1)
    assert max(bench.forces[start:]) < 9.0


def test_a_first_contact_is_built_up_at_press_speed() -> None:
    """Before the force has been there once nothing is known of the surface that would bear a faster press."""
    p, bench = ControllerParameters(), Bench().enabled()
    bench.press(10.0)
    bench.run(2.0)
    v = np.diff([X[2, 3] for X in bench.commands]) / DT
    assert abs(v).max() <= p.press_speed + 2e-3


@pytest.mark.parametrize(("frequency", "amplitude"), [(5.0, 1.0), (7.0, 1.0), (8.0, 0.5)])
def test_the_force_follows_small_sines(frequency: float, amplitude: float) -> None:
    """Gain above 0.71. At 8 Hz 1 N would take 3.2 m/s^2 of the gripper, and more of a command that the arm trails."""
    bench = settled_at(10.0)
    start, wanted = len(bench.forces), []
    for i in range(500):
        wanted.append(np.exp(2j * np.pi * frequency * i * DT))
        bench.press(10.0 + amplitude * wanted[-1].imag)
        bench.step()
    forces = np.array(bench.forces[start:])[125:]
    gain = 2.0 * abs(np.mean((forces - forces.mean()) * np.array(wanted[125:]))) / amplitude
    assert gain > 0.71
    assert bench.state.mode == "contact"


def test_an_image_from_before_a_smaller_force_was_wanted_takes_no_force_back() -> None:
    """Images are late, and what they show above the newest wanted force was wanted then: no force is too large."""
    bench = settled_at(10.0, noise=3e-4, delay=0.1)
    pressed = list[float]()
    for i in range(750):
        bench.press(10.0 + 1.8 * np.sin(2.0 * np.pi * 4.0 * i * DT))
        bench.step()
        references = bench.controller.law.reference._references  # type: ignore[attr-defined]
        pressed += [r.speed for r in references]
    assert min(pressed) > 0.0


@pytest.mark.parametrize("law", ["seed", "plain"])
def test_a_force_of_zero_lets_go_of_what_was_pressed_and_presses_again(law: str) -> None:
    """Its path lies 9 mm below the table: it used to be followed at 1 mm/s, by 9 N and more, and no reason told."""
    bench = settled_at(5.0, law=law, table=0.009)
    bench.press(0.0)
    bench.run(0.5)
    assert bench.force < 0.3
    bench.run(10.0)
    assert max(bench.forces[-2500:]) < 0.3
    assert (bench.state.mode, bench.state.settled, bench.state.reason) == ("contact", True, "")
    assert bench.controller.law.tool.on_environment.force[2] == pytest.approx(0.0, abs=0.3)
    bench.press(5.0)
    bench.run(1.5)
    assert bench.force == pytest.approx(5.0, abs=0.1)


@pytest.mark.parametrize("table", [-0.05, 0.004])
def test_a_tip_that_has_let_go_stays_where_it_is_until_something_presses_it(table: float) -> None:
    """Though the weight is off by 0.15 N: an observer of a surface that has gone would follow it, by 12 mm/s and on."""
    bench = Bench(believed=Stiffness((4.0, 3.0, 4.0), (800.0, 1300.0, 800.0))).enabled()
    bench.press(5.0)
    bench.run(3.0)
    bench.press(0.0)
    bench.run(1.0)
    before = bench.tip_height()
    for _ in range(1000):
        bench.table += (table - bench.table) * 0.01
        bench.step()
    assert bench.tip_height() == pytest.approx(max(before, table), abs=5e-4)
    assert bench.force < 1.1
    assert bench.state.mode == "contact"


def test_a_tip_that_was_lifted_is_not_sent_back_to_where_it_once_let_go() -> None:
    bench = settled_at(5.0)
    bench.press(0.0)
    bench.run(1.0)
    lifted = make_pose(bench.start[:3, :3], bench.start[:3, 3] + (0.0, 0.0, 0.03))
    bench.controller.set_setpoint(HybridSetpoint(lifted), bench.t)
    bench.run(3.0)
    height = bench.tip_height()
    bench.controller.set_setpoint(HybridSetpoint(lifted, force_projector=PRESS_Z, touches=True), bench.t)
    bench.run(3.0)
    assert bench.tip_height() == pytest.approx(height, abs=1e-3)

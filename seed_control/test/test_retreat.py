# SPDX-License-Identifier: Apache-2.0
"""A force is taken back faster than it is built up, and a hold gives way by the gripper's place of each image."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from quasi_static import DOWN, DT, PRESS_Z, Bench

from seed_control.command.relief import Relief
from seed_control.law.surface_observer import SurfaceObserver
from seed_control.law.tip_reference import HeightReference, TipReference
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint
from seed_core.spatial import Wrench, make_pose, rotation_from_rpy
from seed_core.vector3 import ZERO, Vector3

PRESS = np.array((0.0, 0.0, -10.0))  # N, of the tool on the environment


@pytest.mark.parametrize(("height", "step"), [(0.1, 0.25), (-0.1, -0.045)])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_retreat_has_the_grippers_speed_a_press_its_own(height: float, step: float, sign: int) -> None:
    reference = TipReference()
    reference.lead(np.eye(4), np.zeros(3))
    n = (0.0, 0.0, float(sign))
    reference.follow([HeightReference(n, sign * height, ZERO, 0.045, back=0.25, pushes=-sign)], ZERO, ZERO)
    x, y, z = reference.target(0.004, 0.0, 0.06, ZERO)
    assert (x, y) == (0.0, 0.0)
    assert z == pytest.approx(0.004 * step)


def test_relief_counts_from_where_the_gripper_was_at_the_image() -> None:
    relief, held_at, doubtful = Relief(2.0, 0.03), (0.0, 0.0, 0.5), False

    def image(force: float, place: float, held: bool = True) -> None:
        relief.image(np.array((0.0, 0.0, force)), PRESS, 0.1)
        if held:
            relief.give_way(1000.0, np.array((0.0, 0.0, place)), held_at, doubtful)

    for _ in range(2):
        image(-14.0, 0.5, held=False)  # while it still moves
    assert relief.way == 0.0
    image(-14.0, 0.5)  # the third, and it has come to hold
    assert relief.way == pytest.approx(4e-3)
    # late images of the same press ask for no more than the same way
    image(-13.0, 0.501)
    assert relief.way == pytest.approx(4e-3)
    # a surface that goes on rising asks for more at once
    image(-14.0, 0.504)
    assert relief.way == pytest.approx(8e-3)
    assert relief.target(held_at) == pytest.approx((0.0, 0.0, 0.508))
    # a force that may be wrong lets go of what is pressed with, 10 N, and no more
    relief.restart()
    doubtful = True
    for _ in range(3):
        image(-40.0, 0.5)
    assert relief.way == pytest.approx(0.01)


def test_a_retreat_that_the_limits_did_not_allow_is_not_made_good_at_press_speed() -> None:
    """A bump of 20 mm for 40 ms: the command has hardly begun to give way, so it need not come back."""
    n, dt = (0.0, 0.0, 1.0), 0.004
    reference = TipReference()
    reference.lead(np.eye(4), np.zeros(3))

    def ask(height: float, commanded: float) -> float:
        reference.follow([HeightReference(n, height, ZERO, 0.045, back=0.25, pushes=-1)], ZERO, ZERO)
        return reference.target(dt, 0.0, 0.06, (0.0, 0.0, commanded))[2]

    for _ in range(10):
        away = ask(0.02, 0.001)
    assert away == pytest.approx(0.01)
    assert ask(0.0, 0.001) == pytest.approx(0.001 - 0.045 * dt)
    assert ask(0.02, 0.001) == pytest.approx(0.001 + (0.25 - 0.045) * dt)  # and it gives way as fast as before


def test_a_force_that_is_too_large_is_taken_back_whatever_is_foretold(monkeypatch: pytest.MonkeyPatch) -> None:
    """A table has risen; the law believes that it sinks by 5 mm at once."""
    bench = Bench(noise=3e-4).enabled()
    bench.press(8.0)
    bench.run(2.0)
    since, foretold = bench.t, SurfaceObserver.wanted_height

    def sinks(self: SurfaceObserver, n: Vector3, deflection: float, ahead: float = 0.0) -> tuple[float, Vector3, float]:
        offset, gradient, rate = foretold(self, n, deflection, ahead)
        return offset - 5e-3, gradient, rate

    while bench.state.estimated is None or bench.state.estimated.force[2] > -10.0:
        bench.table = min(0.06 * (bench.t - since), 2.7e-3)
        bench.step()
    now = bench.commands[-1][2, 3]
    monkeypatch.setattr(SurfaceObserver, "wanted_height", sinks)
    bench.run(4.5 / bench.image_rate)
    assert bench.state.mode == "contact"
    assert bench.commands[-1][2, 3] > now + 1.5e-3


def test_a_hold_that_gives_way_turns_no_further() -> None:
    """Whatever the law would like to turn to: a tool that is pressed leans, and uprighting goes on for as long."""
    bench = Bench(noise=1e-5).enabled()
    bench.press(5.0)
    bench.run(1.5)
    bench.table = 6e-3  # at once, under a gripper that stands
    while bench.state.mode != "holding":
        bench.step()
    X_WE, turn = bench.commands[-1], rotation_from_rpy((0.0, 0.3, 0.0))
    bench.controller._command.turn_to(X_WE[:3, :3] @ turn)
    bench.run(0.5)
    assert bench.commands[-1][2, 3] > X_WE[2, 3] + 2e-3
    assert_allclose(bench.commands[-1][:3, :3], X_WE[:3, :3], atol=1e-6)


@pytest.mark.parametrize("jump", [0.012, 0.02, -0.012, -0.02])
def test_a_pose_that_jumps_is_followed_slowly_and_no_further_than_lets_go(jump: float) -> None:
    """Nothing has moved: the estimator tells that the tool is pressed much more, or pulled."""
    bench = Bench().enabled()
    bench.press(8.0)
    bench.run(4.0)
    before = bench.commands[-1][2, 3]
    bench.told = lambda e: replace(e, X_CT=e.X_CT @ make_pose(None, (0.0, 0.0, jump)))
    bench.run(2.0)
    assert bench.state.mode == "holding"
    assert "has jumped" in bench.state.reason
    gone = np.array([X[2, 3] for X in bench.commands[-500:]]) - before
    assert gone.min() > -1e-4
    assert gone.max() < 1.05 * 8.0 / np.mean(bench.stiffness.translation)
    assert np.abs(np.diff(gone)).max() < 1.1 * bench.controller.parameters.approach_speed * DT
    assert bench.force > 0.5


def test_a_hold_between_two_steps_gives_way_from_where_the_gripper_is() -> None:
    bench = Bench().enabled()
    higher = DOWN.copy()
    higher[:3, 3] += (0.2, 0.0, 0.1)
    bench.controller.set_setpoint(HybridSetpoint(higher), bench.t)
    bench.run(3.0)
    bench.table = 0.1
    press = Wrench(np.zeros(3), np.array((0.0, 0.0, -5.0)))
    bench.controller.set_setpoint(HybridSetpoint(higher, press, PRESS_Z), bench.t)
    bench.run(3.0)
    pressed, age = 0, 0.0
    while pressed < 2 or bench._queue[0][0] > bench.t + 1e-9:  # the third such image comes right after the hold
        bench.table += 0.05 * DT
        state = bench.step()
        pressed += state.image_age < age and state.estimated.force[2] < -5.0 - 2.1
        age = state.image_age
    held_at = bench.commands[-1][:3, 3]
    bench.controller.hold(bench.t, "the arm holds")
    assert bench.run(2.0).mode == "holding"
    off = np.array(bench.commands[-500:])[:, :3, 3] - held_at
    assert_allclose(off[:, :2], 0.0, atol=1e-3)
    assert off[:, 2].min() > -1e-3
    assert off[-1, 2] > 2e-3  # it gives way


@pytest.mark.parametrize("speed", [0.05, 0.1, 0.25])
def test_a_tool_that_ran_into_something_goes_back_the_way_it_came(speed: float) -> None:
    bench = Bench(start=make_pose(p=(0.0, 0.0, 0.1)) @ DOWN, parameters=ControllerParameters(max_speed=speed)).enabled()
    bench.controller.set_setpoint(HybridSetpoint(make_pose(p=(0.0, 0.0, -0.08)) @ DOWN), bench.t)
    while not bench.force:
        bench.step()
    touches = bench.commands[-1][2, 3]
    assert bench.run(4.0).mode == "holding"
    assert "something is in its way" in bench.state.reason
    assert bench.force < 3.0 < 10.0 < max(bench.forces)  # half of max_unexpected_force and of the tool's weight
    assert bench.commands[-1][2, 3] == pytest.approx(bench.commands[-50][2, 3], abs=1e-5)
    assert bench.commands[-1][2, 3] < touches + speed / bench.image_rate + 1e-3


def test_an_arm_whose_tool_is_pushed_comes_back_to_where_it_stood() -> None:
    bench = Bench(noise=1e-5).enabled()
    bench.controller.set_setpoint(HybridSetpoint(DOWN), bench.t)
    bench.run(1.0)
    before = bench.commands[-1]
    bench.table = bench.tip_height() + 0.015
    while bench.state.mode != "holding":
        bench.step()
    bench.run(1.0)
    assert_allclose(bench.commands[-1], before, atol=2e-4)

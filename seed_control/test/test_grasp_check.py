# SPDX-License-Identifier: Apache-2.0
"""A grasp that was taken under load, told by a controller that sees no image of it."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from quasi_static import Bench

from seed_control.monitor.grasp_check import GraspCheck
from seed_control.setpoint.setpoints import HybridSetpoint, SetpointError
from seed_control.wrench.estimate import WrenchEstimator
from seed_core.bushing import Bushing
from seed_core.estimate import EMPTY, NEW_GRASP, RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Tool
from seed_core.spatial import Wrench, inverse_pose, make_pose, so3_exp

NOISE = 3e-4  # [m]
K = np.array(DEFAULT_STIFFNESS.translation)


def taken_under(force: float) -> Bench:
    """The grasp was taken while something pulled at the tool with so many newtons, upwards."""
    bench = Bench(noise=NOISE)
    down = bench.X_WE[:3, :3].T @ np.array((0.0, 0.0, force))  # C is turned as the flange is
    bench.X_TT_new = inverse_pose(make_pose(None, down / K))
    return bench


def until_contact(bench: Bench) -> Bench:
    while bench.force == 0.0 and bench.state.mode != "holding" and bench.t < 5.0:
        bench.step()
    return bench


@pytest.mark.parametrize("mass", [0.15, 0.2, 0.4])
def test_a_tool_that_hung_is_told_before_it_touches(mass: float) -> None:
    bench = Bench(tool=Tool(mass=mass), noise=NOISE)
    bench.X_TT_new = inverse_pose(bench.grasp())
    bench.enabled()
    bench.press(8.0)
    until_contact(bench)
    assert bench.state.mode == "holding"
    assert f"the tool hung ({mass * 9.81:.1f} N)" in bench.state.reason
    assert bench.force == 0.0


@pytest.mark.parametrize("force", [2.0, 5.0, -6.0])
def test_a_tool_that_was_pressed_is_told_before_it_touches(force: float) -> None:
    bench = taken_under(force).enabled()
    bench.press(10.0)
    until_contact(bench)
    assert bench.state.mode == "holding"
    assert f"with {abs(force):.0f}" in bench.state.reason or "in free air" in bench.state.reason
    assert bench.force == 0.0


@pytest.mark.parametrize("k_table", [500.0, 4e4])
@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_a_grasp_free_of_load_presses(k_table: float, scale: float) -> None:
    bench = Bench(k_table=k_table, noise=NOISE / scale, stiffness=DEFAULT_STIFFNESS.scaled(scale)).enabled()
    for force in (4.0, 8.0, 4.0):  # from contact, too
        bench.press(force)
        bench.run(2.0)
        bench.controller.disable(bench.t, "asked")
        bench.run(0.2)
        bench.controller.enable(bench.t)
        bench.press(force)
        state = bench.run(1.5)
        assert state.mode != "holding", state.reason  # a stiff grasp approaches slowly
        assert not bench.controller.supervisor.grasp_check.reason


@pytest.mark.parametrize(("force", "noise"), [(10.0, 1e-9), (3.5, NOISE)])
def test_a_grasp_taken_anew_while_pressed_must_not_press_again(force: float, noise: float) -> None:
    bench = Bench(noise=noise).enabled()
    bench.press(force)
    bench.run(3.0)
    bench.initialize_grasp()
    bench.run(1.0)
    bench.controller.enable(bench.t)
    bench.press(force)
    state = bench.run(3.0)
    assert state.mode == "holding"
    assert "taken anew while the tool was loaded" in state.reason
    assert max(bench.forces) < force + 2.0


def shifted(along: tuple[float, float, float], force: float = 5.0) -> Bench:
    """A bench that presses as all poses become wrong by so many metres."""
    bench = Bench(noise=NOISE).enabled()
    bench.press(force)
    bench.run(2.0)

    def told(estimate: RelativePoseEstimate) -> RelativePoseEstimate:
        X = estimate.X_CT
        return replace(estimate, X_CT=make_pose(X[:3, :3], X[:3, 3] + np.array(along)))

    bench.told = told
    bench.run(1.0)
    return bench


def test_a_jump_is_not_forgotten_by_enable_until_free_air_shows_the_zero() -> None:
    bench = shifted((0.0, 0.0, -3.6e-3))
    assert bench.state.mode == "holding"
    for _ in range(2):
        bench.controller.enable(bench.t)
        bench.press(5.0)
        assert bench.run(0.5).mode == "holding"
        assert "has not hung free since" in bench.state.reason
    bench.told = lambda estimate: estimate
    bench.controller.enable(bench.t)
    above = HybridSetpoint(bench.start, Wrench.zero(), np.zeros((3, 3)))
    bench.controller.set_setpoint(above, bench.t)
    bench.run(2.0)
    assert bench.force == 0.0
    bench.controller.enable(bench.t)
    bench.press(5.0)
    assert bench.run(2.0).mode == "contact", bench.state.reason


def test_a_jump_that_leaves_most_of_the_force_is_not_forgotten_by_enable() -> None:
    """5.3 mm across of a grasp that is pressed with 15 N: a quarter of the force is wrong from then on."""
    bench = shifted((5.3e-3, 0.0, 0.0), 15.0)
    assert bench.state.mode == "holding"
    bench.run(1.0)
    bench.controller.enable(bench.t)
    bench.press(15.0)
    assert bench.run(0.5).mode == "holding"
    assert re.search(r"has jumped, and \d\.\d of 1\d\.\d N are gone since.* has not hung free", bench.state.reason)


def pressed_again(step=(0.0, 0.0, 0.0), turn: float = 0.0, force: float = 0.0, angle: float = 0.0, why="") -> str:
    """What speaks against a grasp after a jump, or a new grasp, that was pressed with 5 N, and has such a force then.

    step, turn: the arm's since [m], [rad]. angle: [rad] by which the pose has turned as it jumped.
    """
    check, rng = GraspCheck(Tool(mass=0.0), 1.0), np.random.default_rng(2)
    measure = WrenchEstimator(Tool(mass=0.0), Bushing(DEFAULT_STIFFNESS), True, 3e-4).measure
    k, stated = K[2], np.diag([np.deg2rad(0.5) ** 2] * 3 + [1e-8] * 3)
    for i in range(30):
        if i == 15:
            check.new_grasp(why)
        new = i >= 15
        lifted = (5.0 if not new else force) / k + 1e-4 * rng.standard_normal()
        X_CT = make_pose(so3_exp((angle * new, 0.0, 0.0)), (0.0, 0.0, lifted))
        X_WC = make_pose(so3_exp((turn * new, 0.0, 0.0)), np.array(step) * new)
        check.update(measure(RelativePoseEstimate(0.02 * i, X_CT, stated), X_WC), None, k)
    return check.reason


@pytest.mark.parametrize(
    ("after", "words"),
    [
        ({}, r"jumped: [45]\.\d of 5\.0 N are gone"),
        ({"why": NEW_GRASP}, r"was loaded: [45]\.\d of 5\.0 N are gone"),
        ({"force": 5.0}, ""),
        ({"force": 5.0, "angle": 0.1}, "jumped by 5.7 degrees"),
        ({"force": 5.0, "angle": 0.1, "why": NEW_GRASP}, ""),  # T is another then
        ({"step": (0.0, 0.0, 5.0 / K[2])}, ""),  # it was let go by the arm's way
        ({"step": (0.0, 0.0, -5.0 / K[2])}, r"(9\.9|10\.\d) of 10\.0 N are gone"),  # it was pressed on
        ({"step": (0.0, 0.0, -5.0 / K[2]), "force": 10.0}, ""),
        ({"step": (0.029, 0.0, 0.0)}, "are gone"),
        ({"step": (0.031, 0.0, 0.0)}, ""),  # far off it may have left what it pressed
        ({"turn": 0.09}, "are gone"),
        ({"turn": 0.11}, ""),
    ],
)
def test_a_force_that_is_gone_though_the_arm_has_not_let_go_speaks_against_the_grasp(after, words: str) -> None:
    found = pressed_again(**after)
    assert bool(found) is bool(words)
    assert re.search(words, found)


def test_time_does_not_make_a_jump_likelier() -> None:
    bench = shifted((5.5e-3, 0.0, 0.0))
    assert bench.state.mode == "holding"
    assert "jumped" in bench.state.reason


def test_a_zero_that_is_kept_by_a_new_grasp_presses_on() -> None:
    """As of an estimator that sees from the dots how far the membranes are dragged."""
    bench = Bench().enabled()
    bench.press(10.0)
    bench.run(3.0)
    bench.regrasp.begin("grasp")
    bench.run(0.2)
    bench.regrasp.end()
    bench.run(1.0)
    bench.controller.enable(bench.t)
    bench.press(10.0)
    assert bench.run(3.0).mode == "contact"
    assert abs(bench.force - 10.0) < 0.1


def test_a_table_that_is_followed_is_no_free_air() -> None:
    """Enabled on a table that swings slowly: the gripper goes to and fro at the same force."""
    bench = Bench(noise=NOISE).enabled()
    bench.press(8.0)
    bench.run(2.0)
    bench.controller.hold(bench.t, "asked")
    bench.run(0.1)
    bench.controller.enable(bench.t)
    bench.press(8.0)
    since = bench.t
    while bench.t < since + 3.0:
        bench.table = 6e-3 * np.sin(2.0 * np.pi * 0.5 * (bench.t - since))
        assert not bench.controller.supervisor.grasp_check.reason
        assert bench.step().mode != "holding", bench.state.reason


@pytest.mark.parametrize("empty", EMPTY)
def test_a_tool_that_was_let_go_and_taken_anew_presses(empty: str) -> None:
    """It hung before; who hands it over carries its weight while it is taken, so the same arm feels another load."""
    bench = Bench(noise=1e-9).enabled()
    bench.run(1.0)
    bench.controller.disable(bench.t, "asked")
    bench.told = lambda estimate: replace(estimate, valid=False, reason=f"{empty}; as the estimator tells it")
    bench.run(0.5)
    bench.told = lambda estimate: replace(estimate, X_CT=np.eye(4))
    bench.initialize_grasp()
    bench.X_TT_new = np.eye(4)
    bench.run(0.6)
    bench.controller.enable(bench.t)
    bench.press(5.0)
    bench.run(0.1)
    bench.told = lambda estimate: estimate
    assert bench.run(3.0).mode == "contact", bench.state.reason
    assert abs(bench.force - 5.0) < 0.2


@pytest.mark.parametrize("rate", [30.0, 45.0, 90.0])
@pytest.mark.parametrize("lost", [{"reason": "track lost"}, {"reason": "it has slid", "gross_slip": True}])
def test_a_new_grasp_is_announced_whatever_was_told_before(rate: float, lost: dict[str, Any]) -> None:
    """Else a controller that presses takes the deflection for gone, and presses once more."""
    bench = Bench(image_rate=rate).enabled()
    bench.press(8.0)
    bench.run(3.0)
    bench.told = lambda e: replace(e, valid=False, **lost)
    bench.run(0.5)
    bench.regrasp.begin("grasp")
    bench.run(15.5 / rate)
    bench.X_TT_new, bench.told = inverse_pose(bench.grasp()), lambda e: e
    bench.regrasp.end()
    bench.run(1.0)
    bench.controller.enable(bench.t)
    with pytest.raises(SetpointError, match="initialize the grasp free of load"):
        _pressed(bench)
    assert max(bench.forces[-500:]) < 8.5


def _pressed(bench: Bench) -> None:
    """Press once more; where that is not refused, the reason for which it then holds."""
    bench.press(8.0)
    bench.run(2.0)
    raise SetpointError("", bench.state.reason)

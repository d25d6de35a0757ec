# SPDX-License-Identifier: Apache-2.0
"""A grasp at rest, worked out from the balance of forces alone: what is measured, asked for and accepted agrees.

The tool leans, and neither its tip nor its centre of mass lies on an axis, so that every lever and every sign counts.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_control.command.guard import Guard
from seed_control.law.hybrid import HybridLaw
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.checks import SetpointChecks
from seed_control.setpoint.setpoints import HybridSetpoint, SetpointError
from seed_control.state import EventLog
from seed_control.wrench.estimate import Measurement, WrenchEstimator
from seed_core.bushing import Bushing
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Frame, Hand, Tool
from seed_core.spatial import (
    Array,
    Wrench,
    inverse_pose,
    make_pose,
    rotation_error,
    rotation_from_rpy,
    rpy_from_rotation,
    so3_log,
)

TOOL = Tool(T_tip=Frame((0.01, 0.02, 0.06)), mass=0.4, center_of_mass=(0.015, -0.02, 0.04))
BUSHING = Bushing(DEFAULT_STIFFNESS)
R_WT = rotation_from_rpy((np.pi - 0.3, 0.2, 0.5))
EVERY = (True, True, True)
PARAMETERS = ControllerParameters(max_lean_share=0.0)  # as Algorithm 2 has it
UNMOVED = RelativePoseEstimate(1.0, np.eye(4))  # which observes every axis


@dataclass(frozen=True)
class AtRest:
    """A grasp that presses on its surroundings with `load` (about the tip, in W)."""

    load: Wrench
    X_WT: Array
    X_TC: Array
    measured: Measurement

    @property
    def setpoint(self) -> HybridSetpoint:
        return HybridSetpoint(self.X_WT @ TOOL.X_Ttip, self.load, np.eye(3), EVERY, contact_resists=EVERY)


def estimator() -> WrenchEstimator:
    return WrenchEstimator(TOOL, BUSHING, gravity=True, default_deviation=1e-4)


def at_rest(force: tuple[float, float, float], torque: tuple[float, float, float]) -> AtRest:
    """Spring + weight = load on the surroundings, moments about T's origin, all in W."""
    f, t, weight = np.array(force), np.array(torque), np.array((0.0, 0.0, -9.81 * TOOL.mass))
    tip, com = R_WT @ np.array(TOOL.T_tip.position), R_WT @ np.array(TOOL.center_of_mass)
    spring_force = f - weight
    spring_torque = t + np.cross(tip, f) - np.cross(com, weight)
    X_TC = BUSHING.pose(Wrench(R_WT.T @ spring_torque, R_WT.T @ spring_force))
    X_WT = make_pose(R_WT, (0.5, 0.1, 0.2))
    estimate = RelativePoseEstimate(1.0, inverse_pose(X_TC))
    return AtRest(Wrench(t, f), X_WT, X_TC, estimator().measure(estimate, X_WT @ X_TC))


CASES = [
    ((0.0, 0.0, -3.0), (0.0, 0.0, 0.0)),
    ((1.0, -0.5, -4.0), (0.05, -0.08, 0.04)),
    ((-0.5, 2.0, 1.0), (0.1, 0.1, 0.1)),
]


@pytest.mark.parametrize(("force", "torque"), CASES)
def test_the_load_on_the_surroundings_is_measured_about_the_tip(force: tuple, torque: tuple) -> None:
    rest = at_rest(force, torque)
    assert_allclose(rest.measured.on_environment.force, force, atol=1e-9)  # [N]
    assert_allclose(rest.measured.on_environment.torque, torque, atol=1e-9)  # [N m]
    assert_allclose(rest.measured.tip, (rest.X_WT @ TOOL.X_Ttip)[:3, 3], atol=1e-12)


@pytest.mark.parametrize("torque_axes", list(product((False, True), repeat=3)))
@pytest.mark.parametrize(("force", "torque"), CASES)
def test_a_grasp_that_already_bears_what_is_asked_is_asked_for_no_change(
    force: tuple, torque: tuple, torque_axes: tuple
) -> None:
    rest = at_rest(force, torque)
    law = HybridLaw(PARAMETERS, estimator())
    law.image(rest.measured, loop_time=0.1)
    setpoint = HybridSetpoint(rest.X_WT @ TOOL.X_Ttip, rest.load, np.eye(3), torque_axes, contact_resists=EVERY)
    law.adopt(setpoint, (0.0, 0.0, 0.0))
    for i in range(PARAMETERS.contact_images + 1):
        law.image(rest.measured._replace(stamp=1.0 + 0.02 * (i + 1)), loop_time=0.1)
    assert law.contact.made
    assert law.plan.limits == ()
    X_WC = rest.X_WT @ rest.X_TC
    assert np.abs(rotation_error(law.plan.X_WC[:3, :3], X_WC[:3, :3])).max() < 1e-8  # [rad]
    assert_allclose(law.plan.X_TC, rest.X_TC, atol=1e-8)


@pytest.mark.parametrize(("force", "torque"), CASES)
@pytest.mark.parametrize("what", ["deflection", "rotation"])
def test_a_load_is_accepted_exactly_up_to_what_the_grasp_may_be_deflected(
    what: str, force: tuple, torque: tuple
) -> None:
    rest = at_rest(force, torque)
    most = {
        "deflection": float(np.linalg.norm(rest.X_TC[:3, 3])),
        "rotation": float(np.rad2deg(np.abs(rpy_from_rotation(rest.X_TC[:3, :3])).max())),
    }[what]

    def ask(share: float) -> None:
        wide = replace(PARAMETERS, max_deflection=0.03, max_rotation=40.0, friction=0.0)
        parameters = replace(wide, **{f"max_{what}": share * most})
        SetpointChecks(parameters, estimator(), Hand()).check_load(rest.setpoint, UNMOVED, rest.measured.X_WC[:3, :3])

    ask(1.001)
    with pytest.raises(SetpointError, match=rf"SP13.*needs a {what}"):
        ask(0.999)


def test_the_cases_turn_and_shift_the_grasp_enough_to_tell() -> None:
    for force, torque in CASES:
        X = at_rest(force, torque).X_TC
        assert np.linalg.norm(so3_log(X[:3, :3])) > 0.02  # [rad]
        assert np.linalg.norm(X[:3, 3]) > 1e-3  # [m]


def test_the_law_never_asks_for_more_deflection_than_the_grasp_endures() -> None:
    rest = at_rest(*CASES[0])
    bound = 0.8 * float(np.linalg.norm(rest.X_TC[:3, 3]))
    law = HybridLaw(replace(PARAMETERS, max_deflection=bound), estimator())
    law.image(rest.measured, loop_time=0.1)
    law.adopt(rest.setpoint, (0.0, 0.0, 0.0))
    assert "max_deflection" in law.plan.limits
    assert_allclose(np.linalg.norm(law.plan.X_TC[:3, 3]), bound, rtol=1e-12)


def test_a_tip_that_sticks_beside_its_path_is_pressed_by_the_surface_under_it() -> None:
    rest, slope = at_rest(*CASES[0]), np.array((0.2, -0.1, 0.0))

    def height(aside: Array, velocity: Array, age: float) -> float:
        """[m] that is wanted, with the path by `aside` from the tip when the image is taken."""
        path = rest.X_WT @ TOOL.X_Ttip
        path[:3, 3] += aside + age * velocity
        law, z = HybridLaw(PARAMETERS, estimator()), np.diag((0.0, 0.0, 1.0))
        setpoint = HybridSetpoint(path, rest.load, z, (False,) * 3, velocity=velocity, contact_resists=EVERY)
        law.image(rest.measured, loop_time=0.1)
        law.adopt(setpoint, (0.0, 0.0, 0.0))
        for i in range(PARAMETERS.contact_images + 1):
            law.image(rest.measured._replace(stamp=1.0 + 0.02 * (i + 1)), loop_time=0.1, age=age)
        law.observers[0].tilt(slope, 0.3)
        reference = law._height_reference(setpoint, 0)
        assert_allclose(reference.gradient, slope, atol=1e-9)
        return reference.offset + float(np.dot(reference.gradient, path[:3, 3] - age * velocity))

    still, going = np.zeros(3), np.array((0.05, 0.02, 0.0))
    on_path = height(still, still, 0.0)
    for velocity, age in ((still, 0.0), (going, 0.06)):
        assert_allclose(height(np.array((5e-3, -3e-3, 0.0)), velocity, age), on_path, atol=1e-9)


@pytest.mark.parametrize(("share", "trips"), [(0.999, False), (1.001, True)])
@pytest.mark.parametrize("what", ["force", "deflection", "rotation"])
def test_an_overload_trips_at_its_bound_after_three_images_in_a_row(what: str, share: float, trips: bool) -> None:
    rest = at_rest((1.0, -0.5, -4.0), (0.1, -0.1, 0.1))
    size = {
        "force": float(np.linalg.norm(rest.load.force)),
        "deflection": float(np.linalg.norm(rest.X_TC[:3, 3])) / 1.2,
        "rotation": float(np.rad2deg(np.abs(rpy_from_rotation(rest.X_TC[:3, :3])).max())) / 1.2,
    }[what]
    bound = {f"max_{'measured_force' if what == 'force' else what}": size / share}
    guard = moving(replace(PARAMETERS, **bound))
    told = []
    for _ in range(3):
        guard.check_overload(rest.measured)
        told.append(guard.held)
    assert told[:2] == ["", ""]
    assert (what in told[2]) == trips
    assert guard.following != trips


def moving(parameters: ControllerParameters) -> Guard:
    guard = Guard(parameters, EventLog(""), lambda _: 0.0, lambda _: 0.0)
    guard.enable(True)
    return guard

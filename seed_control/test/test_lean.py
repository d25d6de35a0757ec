# SPDX-License-Identifier: Apache-2.0
"""What a tool that leans changes: the path waits for it, and its place does not wind up."""

from types import SimpleNamespace

import numpy as np
import pytest

from seed_control.law.hybrid import HybridLaw
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState
from seed_control.tasks.pace import Pace
from seed_control.wrench.estimate import WrenchEstimator
from seed_control.wrench.filters import DeflectionFilter, RotationNoise
from seed_core.bushing import Bushing
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Tool
from seed_core.spatial import inverse_pose, make_pose, rotation_from_rpy, so3_exp

DT, FRAME = 0.004, 0.02  # [s]
RISE = 4.0  # [1/s]: 0.2 m/s^2 to 0.05 m/s


def paced(lean_deg, seconds=1.0, in_contact=True):
    """The pace's values as the tool leans by lean_deg(t) [degrees], with images that are 60 ms late."""
    pace, values = Pace(RISE), []
    for i in range(round(seconds / DT)):
        t = i * DT
        taken = np.floor(t / FRAME + 1e-9) * FRAME
        lean = lean_deg(taken)
        state = ControllerState(
            t,
            "contact",
            True,
            trailing=None if lean is None else np.deg2rad(lean),
            in_contact=in_contact,
            image_age=t - taken + 0.06,
        )
        values.append(pace.update(DT, state))
    return np.array(values)


def about_y(angle):
    return np.array((0.0, angle, 0.0))


def test_a_path_goes_at_full_pace_under_an_upright_tool_and_slower_the_more_it_leans() -> None:
    paces = [paced(lambda _, a=a: a)[-1] for a in (0.0, 2.0, 3.5, 5.0, 20.0)]
    assert paces == pytest.approx([1.0, 1.0, 0.5, 0.1, 0.1], abs=1e-6)


def test_a_lean_that_grows_slows_the_path_before_it_is_large() -> None:
    growing = paced(lambda t: 15.0 * t, 0.4)  # degrees: 2 after 0.13 s
    assert growing[round(0.13 / DT)] < 0.97
    assert growing[round(0.26 / DT)] == pytest.approx(0.1)


def test_the_path_takes_up_speed_no_faster_than_its_acceleration() -> None:
    freed = paced(lambda t: 8.0 if t < 0.5 else 0.0, 1.5)
    assert freed[-1] == 1.0
    assert np.diff(freed).max() <= RISE * DT + 1e-12


@pytest.mark.parametrize(("lean", "in_contact"), [(None, True), (10.0, False)])
def test_nothing_waits_in_free_air_or_where_the_law_does_not_bring_a_tool_upright(lean, in_contact: bool) -> None:
    assert paced(lambda _: lean, in_contact=in_contact).min() == 1.0


def test_noise_of_images_costs_no_time() -> None:
    rng = np.random.default_rng(7)
    noise = {round(t / FRAME): 0.7 * rng.standard_normal() for t in np.arange(0.0, 10.0, FRAME)}
    values = paced(lambda t: noise[round(t / FRAME)] + 0.5, 9.0)
    assert values.mean() > 0.995


@pytest.mark.parametrize(
    ("turn_deg", "velocity", "trails_deg"),
    [
        ((0.0, 3.0, 0.0), (0.05, 0.0, 0.0), 3.0),
        ((0.0, 3.0, 0.0), (-0.05, 0.0, 0.0), -3.0),  # ahead
        ((0.0, 3.0, 0.0), (0.0, 0.05, 0.0), 0.0),  # aside
        ((0.0, 0.0, 9.0), (0.05, 0.0, 0.0), 0.0),  # about the tool's own axis
        ((0.0, 3.0, 0.0), (0.05, 0.0, -0.05), 3.0),  # pressed on beside
        ((0.0, 3.0, 0.0), (0.0, 0.0, -0.05), 0.0),
        ((0.0, 3.0, 0.0), (0.0, 0.0, 0.0), 0.0),
    ],
)
def test_what_a_path_waits_for_is_a_tip_that_trails(turn_deg, velocity, trails_deg: float) -> None:
    """The tool points down, its y with that of the world: a turn about y takes the tip towards minus x."""
    tool = Tool()
    estimator = WrenchEstimator(tool, Bushing(DEFAULT_STIFFNESS, "midpoint"), True, 3e-4)
    down = rotation_from_rpy((0.0, np.pi, 0.0))
    law = HybridLaw(ControllerParameters(), estimator)
    law.adopt(HybridSetpoint(make_pose(down) @ tool.X_Ttip, velocity=np.array(velocity)), (0.0, 0.0, 0.0))
    X_WT = make_pose(rotation_from_rpy(np.deg2rad(turn_deg)) @ down)
    law.image(estimator.measure(RelativePoseEstimate(0.0, np.eye(4)), X_WT), loop_time=0.1)
    assert np.rad2deg(law.trailing) == pytest.approx(trails_deg, abs=0.1)


def shifted(lean_deg: float, seconds: float = 0.3) -> float:
    """[m] along x that is fed forward of a deflection of 10 mm; leaning by more than is answered."""
    tool = Tool()
    estimator = WrenchEstimator(tool, Bushing(DEFAULT_STIFFNESS, "midpoint"), True, 3e-4)
    deflection, X_WC = DeflectionFilter(ControllerParameters()), make_pose(rotation_from_rpy((np.pi, 0.0, 0.0)))
    first = None
    for i in range(round(seconds / FRAME)):
        turn = deflection.q + np.deg2rad(about_y(lean_deg))
        X_WT = make_pose(X_WC[:3, :3] @ rotation_from_rpy(turn).T)
        tip = X_WT[:3, :3] @ tool.X_Ttip[:3, 3]
        X_WT[:3, 3] = np.array((0.01 if i else 0.0, 0.0, -0.12)) - tip
        estimate = RelativePoseEstimate(i * FRAME, inverse_pose(X_WC) @ X_WT)
        deflection.update(estimator.measure(estimate, X_WC), 0.1, 1.0)
        first = deflection.tip_to_C if first is None else first
    assert first is not None
    return float(deflection.tip_to_C[0] - first[0])


def test_the_place_of_a_tool_that_leans_does_not_wind_up() -> None:
    assert abs(shifted(0.0)) > 5e-3
    assert shifted(4.0) == 0.0
    assert 0.2 < shifted(2.5) / shifted(0.0) < 0.8


@pytest.mark.parametrize("swing", [0.0, 2.5])
@pytest.mark.parametrize("noise", [0.02, 0.1, 0.5])
def test_the_noise_of_rotations_is_found_whatever_the_tool_does(noise: float, swing: float) -> None:
    """In degrees; a blade that swings with 3.3 Hz, and images at 30 Hz."""
    rng, filtered, found = np.random.default_rng(4), RotationNoise(), []
    for t in np.arange(0.0, 6.0, 1.0 / 30.0):
        R = so3_exp(np.deg2rad((0.0, 0.0, swing * np.sin(2.0 * np.pi * 3.3 * t))))
        found.append(filtered.update(R @ so3_exp(np.deg2rad(noise) * rng.normal(size=3)), np.deg2rad(2.0)))
    assert found[0] == np.deg2rad(2.0)  # what is stated, until there is something to judge by
    assert np.rad2deg(np.median(found[60:])) == pytest.approx(noise, rel=0.12, abs=0.03)
    assert RotationNoise().update(R, 1e-3) == 1e-3


def test_a_turn_about_the_force_is_answered_slowly() -> None:
    """A lean is upright in some tenths of a second; a yaw takes ten times as long, and comes right as well."""
    left = {}
    for axis, name in ((1, "lean"), (2, "yaw")):
        deflection = DeflectionFilter(ControllerParameters())
        turn = np.zeros(3)
        turn[axis] = 0.05
        for i in range(1, 41):
            X_TC = make_pose(so3_exp(turn))
            m = SimpleNamespace(stamp=i / 40.0, X_TC=X_TC, X_WC=X_TC, X_WT=np.eye(4), tip=np.zeros(3))
            deflection.update(m, 0.1, 1.0, pressing=np.array((0.0, 0.0, 1.0)))
            if i == 1:
                deflection.q = np.zeros(3)
        left[name] = 1.0 - deflection.q[axis] / 0.05
    assert left["lean"] < 0.01
    assert 0.4 < left["yaw"] < 0.7

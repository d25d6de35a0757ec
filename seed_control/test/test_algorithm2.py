# SPDX-License-Identifier: Apache-2.0
"""Algorithm 2 line by line, against itself in one dimension, against Drake's adjoint, and as what the full law is."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from quasi_static import Bench

from seed_control.algorithm1 import motor_position
from seed_control.algorithm2 import force_control, gripper_pose, wrench_about_T
from seed_control.law.hybrid import HybridLaw
from seed_control.law.published import PublishedLaw
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint, WrenchSetpoint
from seed_control.wrench.estimate import WrenchEstimator
from seed_core.bushing import Bushing, Stiffness
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Frame, Tool
from seed_core.spatial import Wrench, inverse_pose, make_pose, pose_from_rpy, rotation_from_rpy

RNG = np.random.default_rng(12)
TOOL = Tool(T_tip=Frame((0.01, -0.02, 0.12)), mass=0.0)
P_TTIP = np.array(TOOL.T_tip.position)
EVERY = (True, True, True)


def random_case() -> tuple[Wrench, np.ndarray]:
    """A load that the grasp endures, about the tip in W, and a pose of the tool."""
    load = Wrench(0.2 * RNG.uniform(-1, 1, 3), 5.0 * RNG.uniform(-1, 1, 3))
    return load, pose_from_rpy(RNG.uniform(-1.5, 1.5, 3), RNG.uniform(-0.5, 0.5, 3))


@pytest.mark.parametrize("model", ["plain", "midpoint"])
def test_at_the_pose_commanded_the_grasp_exerts_the_wrench_asked_for(model: str) -> None:
    """Forwards through the stiffness map: balance of moments by numpy, nothing of the algorithm's own."""
    bushing = Bushing(DEFAULT_STIFFNESS, model)  # type: ignore[arg-type]
    for _ in range(50):
        load, X_WT = random_case()
        X_TC, X_WC = force_control(load, X_WT, P_TTIP, bushing.pose)
        assert_allclose(X_WC, X_WT @ X_TC, atol=1e-15)
        spring = bushing.wrench(inverse_pose(X_WT) @ X_WC)  # about T's origin, in T
        R = X_WT[:3, :3]
        assert_allclose(R @ spring.force, load.force, atol=1e-10)  # [N]
        moment_about_tip = R @ spring.torque - np.cross(R @ P_TTIP, load.force)
        assert_allclose(moment_about_tip, load.torque, atol=1e-10)  # [N m]


def test_line_4_is_the_adjoint_transform() -> None:
    """By hand: 2 N along x at a tip 0.1 m up z make 0.2 N m about y at the origin; turned by a quarter about z."""
    R_WT = rotation_from_rpy((0.0, 0.0, np.pi / 2))
    wrench = wrench_about_T(Wrench(np.array((0.0, 0.0, 0.3)), np.array((0.0, 2.0, 0.0))), R_WT, np.array((0, 0, 0.1)))
    assert_allclose(wrench.force, (2.0, 0.0, 0.0), atol=1e-15)
    assert_allclose(wrench.torque, (0.0, 0.2, 0.3), atol=1e-15)


def test_line_4_is_drakes_shift_and_reexpression() -> None:
    math = pytest.importorskip("pydrake.multibody.math")
    rotation = pytest.importorskip("pydrake.math")
    for _ in range(10):
        load, X_WT = random_case()
        R_TW = rotation.RotationMatrix(X_WT[:3, :3].T)
        theirs = math.SpatialForce(load.torque, load.force).Rotate(R_TW).Shift(-P_TTIP)
        ours = wrench_about_T(load, X_WT[:3, :3], P_TTIP)
        assert_allclose(ours.vector(), theirs.get_coeffs(), atol=1e-13)


def test_line_6_composes_tool_and_displacement() -> None:
    X_WT, X_TC = pose_from_rpy((0.0, 0.0, np.pi / 2), (1.0, 2.0, 3.0)), make_pose(p=(0.1, 0.0, 0.0))
    assert_allclose(gripper_pose(X_WT, X_TC)[:3, 3], (1.0, 2.1, 3.0), atol=1e-15)


def test_along_one_axis_it_is_algorithm_1() -> None:
    k, load_position = 800.0, 0.3
    bushing = Bushing(Stiffness((4.0, 3.0, 4.0), (k, k, k)), "plain")
    X_WT = make_pose(p=(0.0, 0.0, load_position))
    _, X_WC = force_control(Wrench(np.zeros(3), np.array((0.0, 0.0, 7.0))), X_WT, np.zeros(3), bushing.pose)
    assert_allclose(X_WC[2, 3], motor_position(7.0, k, load_position), rtol=1e-15)


def measured(law: type[PublishedLaw], load: Wrench, X_WT: np.ndarray) -> tuple[PublishedLaw, Bushing]:
    """A law in contact through an image of the tool at X_WT, in a grasp that bears the load already."""
    bushing = Bushing(DEFAULT_STIFFNESS, law.model)
    estimator = WrenchEstimator(TOOL, bushing, law.gravity, 1e-6)
    X_TC, X_WC = force_control(load, X_WT, P_TTIP, bushing.pose)
    image = estimator.measure(RelativePoseEstimate(0.0, inverse_pose(X_TC)), X_WC)
    follower = law(replace(ControllerParameters(), max_rotation=60.0, max_drift=90.0), estimator)
    follower.image(image, loop_time=0.0)
    setpoint = HybridSetpoint(X_WT @ TOOL.X_Ttip, load, np.eye(3), EVERY, contact_resists=EVERY)
    follower.adopt(setpoint, (0.0, 0.0, 0.0))
    for i in range(4):
        follower.image(image._replace(stamp=0.02 * (i + 1)), loop_time=0.0)
    assert follower.contact.made
    assert follower.plan.limits == ()
    return follower, bushing


@pytest.mark.parametrize("law", [PublishedLaw, HybridLaw])
def test_both_laws_command_what_algorithm_2_does_for_a_whole_wrench(law: type[PublishedLaw]) -> None:
    for _ in range(10):
        load, X_WT = random_case()
        follower, bushing = measured(law, load, X_WT)
        X_TC, X_WC = force_control(load, X_WT, P_TTIP, bushing.pose)
        assert_allclose(follower.plan.X_TC, X_TC, atol=1e-12)
        assert_allclose(follower.plan.X_WC, X_WC, atol=1e-12)


def test_the_published_law_is_algorithm_2_wherever_the_grasp_is() -> None:
    """Also off the balance: with the plain bushing and all six components nothing measured but X_WT enters."""
    for _ in range(10):
        load, X_WT = random_case()
        follower, bushing = measured(PublishedLaw, load, X_WT)
        other = Wrench(0.5 * load.torque, 1.2 * load.force)
        setpoint = HybridSetpoint(X_WT @ TOOL.X_Ttip, other, np.eye(3), EVERY, contact_resists=EVERY)
        follower.adopt(setpoint, (0.0, 0.0, 0.0))
        assert_allclose(follower.plan.X_WC, force_control(other, X_WT, P_TTIP, bushing.pose)[1], atol=1e-12)


@pytest.mark.parametrize("law", ["plain", "seed"])
def test_the_full_law_reduces_to_algorithm_2_without_delay_noise_slope_and_gravity(law: str) -> None:
    """Pressing on a flat table it comes to rest at the very pose that Algorithm 2 gives, and at its force."""
    bench = Bench(law=law, delay=0.0, tool=Tool(mass=0.0)).enabled()
    load = Wrench(np.zeros(3), np.array((0.0, 0.0, -8.0)))
    bench.controller.set_setpoint(WrenchSetpoint(load), bench.t)
    bench.run(8.0)
    X_WT = bench.X_WE @ bench.hand.X_EC @ bench.grasp()
    bushing = Bushing(bench.stiffness, "midpoint")
    _, X_WC = force_control(load, X_WT, bench.tool.X_Ttip[:3, 3], bushing.pose)
    assert_allclose((bench.X_WE @ bench.hand.X_EC)[:3, 3], X_WC[:3, 3], atol=1e-12)  # [m]
    assert_allclose(bench.force, 8.0, atol=1e-9)  # [N]

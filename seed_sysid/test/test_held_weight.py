# SPDX-License-Identifier: Apache-2.0
"""A recording of a hand that was turned with a known tool in it: its rests, their loads, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.bushing import Bushing, Stiffness
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Frame, Hand, Tool, weight_about_T
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, pose_from_rpy, rotation_from_rpy
from seed_sysid.data.dataset import DatasetError
from seed_sysid.data.held_weight import attitudes
from seed_sysid.fit.weight import ORIENTATIONS_DEG, fit_weight
from seed_sysid.report.weight import stiffness_lines, weight_picture, weight_stiffness_file

K = Stiffness(rotation=(2.0, 1.0, 1.5), translation=(700.0, 1100.0, 900.0))
HAND = Hand(E_C=Frame((0.02, 0.0, 0.15), (0.0, 10.0, 30.0)))  # a flange that is turned against C
TOOL = Tool(name="weight", mass=0.4, center_of_mass=(0.03, 0.01, 0.05))
REST, WAY, DT = 2.5, 1.0, 0.02  # [s]
SLID = pose_from_rpy((0.0, 0.1, 0.0), (0.001, 0.0, -0.002))  # X_PT


def held(R_WC: Array, up: tuple[float, float, float] = HAND.up) -> Array:
    """X_CT of the tool that hangs in the spring with the hand at R_WC."""
    X_TC = np.eye(4)
    for _ in range(50):
        load = weight_about_T(TOOL.mass, TOOL.center_of_mass, R_WC @ inverse_pose(X_TC)[:3, :3], up)
        X_TC = Bushing(K).pose(Wrench.zero().minus(load))
    return inverse_pose(X_TC)


def recording(hand: Hand = HAND, rest: float = REST) -> tuple[list[tuple[float, Array]], list[RelativePoseEstimate]]:
    """Of a hand that rests in each orientation; on the way, and until it has settled, its tool is anywhere."""
    arm, estimates, t = list[tuple[float, Array]](), list[RelativePoseEstimate](), 100.0
    for roll, pitch in ORIENTATIONS_DEG:
        R_WC = rotation_from_rpy(np.deg2rad([roll, pitch, 20.0]))
        X_WE = make_pose(R_WC @ hand.X_EC[:3, :3].T, (0.4, 0.1, 0.5))
        X_CT, begun = held(R_WC, hand.up), t
        while t < begun + WAY:
            share = (t - begun) / WAY
            arm.append((t, pose_from_rpy((share, 0.0, 0.0), (0.0, 0.0, 0.0)) @ X_WE))
            estimates.append(RelativePoseEstimate(t, pose_from_rpy((0.0, 0.0, 0.3), (0.0, 0.0, 0.0))))
            t += DT
        begun = t
        while t < begun + rest:
            arm.append((t, X_WE))
            swings = pose_from_rpy((0.1, 0.0, 0.0), (0.0, 0.0, 0.0)) if t < begun + 0.9 else np.eye(4)
            estimates.append(RelativePoseEstimate(t + 0.004, X_CT @ swings))
            t += DT
    return arm, estimates


def test_every_rest_is_found_and_its_load_gives_the_stiffness_of_all_axes() -> None:
    rests = attitudes(*recording(), HAND, TOOL)
    assert len(rests) == len(ORIENTATIONS_DEG)
    X_TC = np.array([inverse_pose(r.X_CP) for r in rests])
    loads = np.array([r.wrench_of_patches for r in rests])
    fit = fit_weight(X_TC, loads)
    assert fit.undetermined == {}
    assert fit.left_out == ()
    assert_allclose(fit.stiffness, K.vector(), rtol=1e-3)
    file = weight_stiffness_file(fit, HAND.name, TOOL.name, "2026-01-01", float("nan"), 1030.0, "midpoint")
    assert_allclose(file.grips[0].stiffness.vector(), fit.stiffness)
    assert (file.grips[0].width_m, file.grips[0].pressure_hpa) == (0.0, 1030.0)
    assert "roll" in stiffness_lines(fit)[0]
    assert weight_picture(X_TC, loads, fit, "midpoint").startswith("<svg")


def test_an_arm_on_the_ceiling_is_loaded_the_other_way() -> None:
    hand = replace(HAND, up=(0.0, 0.0, -1.0))
    rests = attitudes(*recording(hand), hand, TOOL)
    fit = fit_weight(np.array([inverse_pose(r.X_CP) for r in rests]), np.array([r.wrench_of_patches for r in rests]))
    assert_allclose(fit.stiffness, K.vector(), rtol=1e-3)


def test_what_the_tool_has_slid_on_the_patches_bends_no_spring() -> None:
    arm, estimates = recording()
    slid = [replace(e, X_CT=e.X_CT @ SLID, X_PT=SLID) for e in estimates]
    tool = replace(TOOL, center_of_mass=tuple((inverse_pose(SLID) @ (*TOOL.center_of_mass, 1.0))[:3]))
    stuck, moved = attitudes(arm, estimates, HAND, TOOL), attitudes(arm, slid, HAND, tool)
    for a, b in zip(stuck, moved, strict=True):
        assert_allclose(b.X_CP, a.X_CT, atol=1e-12)
        assert_allclose(b.wrench_of_patches, a.wrench, atol=1e-9)


def test_an_attitude_in_which_a_hand_bears_the_tool_is_left_out() -> None:
    rests = attitudes(*recording(), HAND, TOOL)
    X_TC, loads = (
        np.array([f(r) for r in rests]) for f in (lambda r: inverse_pose(r.X_CP), lambda r: r.wrench_of_patches)
    )
    X_TC[3] = np.eye(4)
    fit = fit_weight(X_TC, loads)
    assert fit.left_out == (3,)
    assert_allclose(fit.stiffness, K.vector(), rtol=1e-3)


def test_rests_that_are_too_short_or_without_valid_poses_count_for_nothing() -> None:
    assert attitudes(*recording(rest=1.2), HAND, TOOL) == []
    arm, estimates = recording()
    assert attitudes(arm, [replace(e, valid=False) for e in estimates], HAND, TOOL) == []
    assert attitudes([], estimates, HAND, TOOL) == []


def test_a_tool_that_slid_and_one_without_weight_are_refused() -> None:
    arm, estimates = recording()
    slid = [replace(e, gross_slip=e.stamp > 105.0) for e in estimates]
    with pytest.raises(DatasetError, match=r"had slid in the grasp 5\.[56] s after .* grasp it anew, more firmly"):
        attitudes(arm, slid, HAND, TOOL)
    with pytest.raises(DatasetError, match=r"tool\.mass = 0 kg"):
        attitudes(arm, estimates, HAND, replace(TOOL, mass=0.0))

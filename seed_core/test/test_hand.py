# SPDX-License-Identifier: Apache-2.0
"""The hand's frames, the tool's weight, and the pressure that the gripper's width tells."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.config import ConfigError
from seed_core.hand import GRAVITY, GripperPressure, Hand, read_hand, weight_about_T
from seed_core.spatial import rotation_from_rpy

RNG = np.random.default_rng(6)


def test_the_cameras_of_the_default_hand_look_at_each_other_through_the_grasp() -> None:
    hand = Hand()
    middle = 0.105 * hand.X_CL[:3, 2] + hand.X_CL[:3, 3]
    assert_allclose(middle, np.zeros(3), atol=1e-15)
    assert_allclose(hand.X_CL[:3, 2], -hand.X_CR[:3, 2], atol=1e-15)
    assert_allclose(hand.X_CL[:3, 0], hand.X_CR[:3, 0], atol=1e-15)  # columns of both images run along x_C


def test_a_hand_is_read_from_any_section_of_the_launch_files_or_alone(tmp_path: Path) -> None:
    hand, file = "E_C: {position: [0.0, 0.0, 0.2]}", tmp_path / "hand.yaml"
    for section in ("/**", "/left/**", "estimator"):
        file.write_text(f"{section}:\n  ros__parameters:\n    hand:\n      {hand}\n    tool: {{mass: 0.3}}\n")
        read, tool = read_hand(str(file), alone=section == "/**")
        assert (read.E_C.position, tool.mass) == ((0.0, 0.0, 0.2), 0.3)
    file.write_text(hand)
    assert read_hand(str(file), alone=True)[0].E_C.position == (0.0, 0.0, 0.2)
    with pytest.raises(ConfigError, match="has no 'hand' under ros__parameters"):
        read_hand(str(file))
    file.write_text("hand: [")
    with pytest.raises(ConfigError, match=r"hand.yaml: not readable as YAML"):
        read_hand(str(file))
    file.write_text("/**: {ros__parameters: {hand: {E_C: {position: [0.0, 0.2]}}}}")
    with pytest.raises(ConfigError, match=r"hand.yaml: hand: E_C.position has 2 values; it needs 3"):
        read_hand(str(file), alone=True)


@pytest.mark.parametrize("scale", [1e-7, 0.3, 1.5])
def test_weight_points_down_in_the_world_and_turns_about_the_tools_origin(scale: float) -> None:
    mass, com = 0.3, np.array((0.01, -0.02, 0.06))
    for rpy in scale * RNG.uniform(-1.0, 1.0, (20, 3)):
        R_WT = rotation_from_rpy(rpy)
        weight_W = weight_about_T(mass, com, R_WT).rotated(R_WT)
        assert_allclose(weight_W.force, (0.0, 0.0, -mass * GRAVITY), atol=1e-15)
        assert_allclose(weight_W.torque, np.cross(R_WT @ com, weight_W.force), atol=1e-15)


def test_pressure_rises_as_the_gripper_closes() -> None:
    bubbles = GripperPressure(width=0.05, pressure=1030.0, slope=2000.0)
    assert bubbles.at_width(0.05) == 1030.0
    assert bubbles.at_width(0.04) == pytest.approx(1050.0)
    assert_allclose(bubbles.at_width(np.array((0.06, 0.03))), (1010.0, 1070.0))

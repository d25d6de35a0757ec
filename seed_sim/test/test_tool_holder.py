# SPDX-License-Identifier: Apache-2.0
"""The holder carries a grasped tool until the arm moves, and gives its weight to the grasp without a swing."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.spatial import inverse_pose, make_pose, pose_from_rpy
from seed_sim.plant.plant import Plant
from seed_sim.plant.tool_holder import LETTING_DOWN, ToolHolder
from seed_sim.scenario import Scenario, ServoSection

SCENARIO = Scenario(servo=ServoSection(repeatability=0.0))
WORK = make_pose(None, (0.45, 0.0, 0.0))
X_W_TIP = WORK @ pose_from_rpy((np.pi, 0.0, 0.0), (0.0, 0.0, 0.3))
START = X_W_TIP @ inverse_pose(SCENARIO.tool.X_Ttip) @ inverse_pose(SCENARIO.hand.X_EC)
RAISED = START + np.array([[0.0] * 4, [0.0] * 4, [0.0, 0.0, 0.0, 0.005], [0.0] * 4])
PERIOD = 0.004  # [s]
SAG = SCENARIO.tool.mass * 9.81 / SCENARIO.grasp.stiffness.translation[2]  # [m]


@pytest.fixture
def plant() -> Plant:
    return Plant(SCENARIO, 0, WORK, START)


def run(holder: ToolHolder, plant: Plant, seconds: float) -> None:
    for _ in range(round(seconds / PERIOD)):
        holder.advance(plant.time + PERIOD)


def test_a_tool_does_not_sag_before_the_arm_moves(plant: Plant) -> None:
    holder = ToolHolder(plant)
    run(holder, plant, 0.2)
    assert not holder.grasped
    holder.grasp()
    run(holder, plant, 1.0)
    assert holder.carries
    assert_allclose(plant.X_CT, np.eye(4), atol=1e-5)  # [m]: it falls for less than a millisecond at a time


def test_once_the_arm_moves_the_weight_is_given_to_the_grasp_gently(plant: Plant) -> None:
    holder = ToolHolder(plant)
    holder.grasp()
    plant.command(RAISED)
    lowest = 0.0
    while holder.carries:
        holder.advance(plant.time + PERIOD)
        assert plant.time < 2.0 + LETTING_DOWN
    for _ in range(250):
        holder.advance(plant.time + PERIOD)
        lowest = max(lowest, plant.X_CT[2, 3])
    assert plant.X_CT[2, 3] == pytest.approx(SAG, rel=0.02)  # z of C points down
    assert lowest < 1.2 * SAG  # let go at once it would swing to twice the sag


def test_a_released_tool_stands_in_the_holder_again(plant: Plant) -> None:
    holder = ToolHolder(plant)
    holder.grasp()
    plant.command(RAISED)
    run(holder, plant, 1.5)
    assert not holder.carries
    holder.release()
    run(holder, plant, 0.5)
    assert (holder.grasped, holder.carries) == (False, True)
    assert_allclose(plant.X_CT, np.eye(4), atol=1e-5)

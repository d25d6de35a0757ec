# SPDX-License-Identifier: Apache-2.0
"""The plant of a world, and the controller in it, which goes by what is believed."""

from dataclasses import replace

import numpy as np

from seed_control.tasks import Task
from seed_sim.closed_loop.relative_poses import FROM_IMAGES
from seed_sim.closed_loop.run import SeedSteering, start_pose
from seed_sim.plant.plant import Plant
from seed_sim.scenario import Scenario
from seed_sim.world.belief import Belief
from seed_sim.world.cameras import true_hand
from seed_sim.world.parameters import World
from seed_sim.world.poses import WorldPoses
from seed_sim.world.spring import WorldSpring


def true_scenario(scenario: Scenario, world: World) -> Scenario:
    """The scenario as the plant has it: the flange, the tool's weight and the table are the world's."""
    cell, table = world.cell, scenario.table
    if cell.tilt_deg is not None:
        span = (-cell.tilt_deg, cell.tilt_deg)
        table = replace(table, tilt_x=span, tilt_y=span)
    if cell.friction is not None:
        table = replace(table, friction=cell.friction)
    return replace(
        scenario,
        hand=true_hand(scenario.hand, world),
        true_mass=scenario.tool_mass * (1.0 + cell.mass),
        table=table,
    )


def make_plant(scenario: Scenario, world: World, seed: int, task: Task) -> Plant:
    """The plant of a world: `scenario` states tool and grasp; the arm starts where it believes the task's begin."""
    true, X_work, X_WE = true_scenario(scenario, world), task.frame.pose, start_pose(scenario, task)
    if scenario.grasp.kind == "membrane":
        return Plant(true, seed, X_work, X_WE)
    spring = WorldSpring(scenario.grasp.stiffness, world.spring)
    plant = Plant(true, seed, X_work, X_WE, grasp_force=spring)
    spring.damping = np.concatenate(plant.grip.damping)
    return plant


def make_steering(
    plant: Plant, belief: Belief, world: World, seed: int, *, law: str = "seed", estimator: str = "rigid_fit"
) -> SeedSteering:
    """The controller with what the suite believes, and with relative poses from the world's images, or the truth's."""
    scenario, poses = belief.scenario, None
    if estimator in FROM_IMAGES:
        poses = WorldPoses(scenario, world, seed, estimator, belief.calibration, belief.clock_offset, plant)
    return SeedSteering(plant, scenario, law, estimator, seed, poses, belief.wrench_model())

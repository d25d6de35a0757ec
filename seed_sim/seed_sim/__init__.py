# SPDX-License-Identifier: Apache-2.0
"""Simulated arm, grasp, tool, table and tactile cameras; evaluation in closed loop without ROS.

from seed_sim import evaluate

run = evaluate("squeegee", estimator="rigid_fit", seed=7)
print(run.result["force_z"]["rmse"], "N")
"""

from seed_sim.closed_loop.evaluate import Evaluation, evaluate
from seed_sim.plant.plant import Plant
from seed_sim.scenario import Scenario, load_scenario
from seed_sim.tactile import TactileParameters, TactileRenderer, ToolShape

__all__ = [
    "Evaluation",
    "Plant",
    "Scenario",
    "TactileParameters",
    "TactileRenderer",
    "ToolShape",
    "evaluate",
    "load_scenario",
]

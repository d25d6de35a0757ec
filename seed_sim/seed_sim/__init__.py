# SPDX-License-Identifier: Apache-2.0
"""Simulated arm, grasp, tool, table and tactile cameras; evaluation in closed loop without ROS.

    from seed_sim import evaluate

    run = evaluate("squeegee", estimator="rigid_fit", seed=7)
    print(run.result["force_z"]["rmse"], "N")

Each name is imported when it is first asked for: a command that wants scenarios alone waits for no renderer.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from seed_sim.closed_loop.evaluate import Evaluation, evaluate
    from seed_sim.closed_loop.relative_poses import Poses, PoseSource
    from seed_sim.plant.plant import Plant
    from seed_sim.scenario import Scenario, load_scenario
    from seed_sim.tactile import TactileParameters, TactileRenderer, ToolShape
else:
    _HOMES = {
        "Evaluation": "closed_loop.evaluate",
        "Plant": "plant.plant",
        "PoseSource": "closed_loop.relative_poses",
        "Poses": "closed_loop.relative_poses",
        "Scenario": "scenario",
        "TactileParameters": "tactile",
        "TactileRenderer": "tactile",
        "ToolShape": "tactile",
        "evaluate": "closed_loop.evaluate",
        "load_scenario": "scenario",
    }

    def __getattr__(name: str) -> Any:
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


__all__ = [
    "Evaluation",
    "Plant",
    "PoseSource",
    "Poses",
    "Scenario",
    "TactileParameters",
    "TactileRenderer",
    "ToolShape",
    "evaluate",
    "load_scenario",
]

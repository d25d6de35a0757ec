# SPDX-License-Identifier: Apache-2.0
"""What an identified stiffness is worth: the squeegee in closed loop, believing it, against believing the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from seed_core.bushing import Stiffness
from seed_core.hand import GRAVITY
from seed_core.spatial import Array
from seed_core.stiffness_file import GripStiffness, StiffnessFile, load_stiffness, save_stiffness

_FORCE = 10.0  # [N]
_ALLOWED = 1.2  # times the relative error of the force axis times (force + weight)


def read_back(file: StiffnessFile, width: float) -> Array:
    """The stiffness (6,) at a gripper width [m] that a controller finds in the file once it is written."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "stiffness.yaml"
        save_stiffness(path, file)
        return GripStiffness(load_stiffness(path)).at_width(width).vector()


def compare(identified: Array, true: Array, seed: int) -> dict[str, Any]:
    """Force error of both, rms and mean [N], and the bound that the identification's error allows; (6,) each."""
    from seed_sim import evaluate
    from seed_sim.scenario import load_scenario

    nominal = load_scenario("nominal")
    plant, belief = Stiffness.from_vector(true), Stiffness.from_vector(identified)
    scored = {}
    for name, believed in (("true", plant), ("identified", belief)):
        scenario = replace(nominal, grasp=replace(nominal.grasp, stiffness=plant, believed=believed))
        scored[name] = evaluate("squeegee", force=_FORCE, seed=seed, scenario=scenario).result["force_z"]
    relative = float(abs(identified[5] - true[5]) / true[5])
    allowed = scored["true"]["rmse"] + _ALLOWED * relative * (_FORCE + nominal.tool.mass * GRAVITY)
    return {
        "force_z": scored,
        "relative_error_z": relative,
        "allowed_rmse": float(allowed),
        "within": bool(scored["identified"]["rmse"] <= allowed),
    }

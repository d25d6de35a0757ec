# SPDX-License-Identifier: Apache-2.0
"""What an identified stiffness is worth: the squeegee in closed loop, believing it, against believing the truth."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from seed_core.bushing import Stiffness
from seed_core.hand import GRAVITY
from seed_core.spatial import Array
from seed_core.stiffness_file import GripStiffness, StiffnessFile

_FORCE = 10.0  # [N]
_ALLOWED = 1.2  # times the relative error of the force axis times (force + weight)


def compare(file: StiffnessFile, width: float, true: Array, seed: int) -> dict[str, Any]:
    """Force error with the identified and with the true stiffness.

    Args:
        file: the result; width: [m] of the gripper, at which the controller looks its belief up in it.
        true: (6,) the plant's stiffness at that width.

    Returns:
        Rms and mean of the force error [N] of both, and the bound that the identification's error allows.
    """
    from seed_sim import evaluate
    from seed_sim.scenario import load_scenario

    nominal = load_scenario("nominal")
    plant, belief = Stiffness.from_vector(true), GripStiffness(file).at_width(width)
    scored = {}
    for name, believed in (("true", plant), ("identified", belief)):
        scenario = replace(nominal, grasp=replace(nominal.grasp, stiffness=plant, believed=believed))
        scored[name] = evaluate("squeegee", force=_FORCE, seed=seed, scenario=scenario).result["force_z"]
    relative = float(abs(belief.translation[2] - true[5]) / true[5])
    allowed = scored["true"]["rmse"] + _ALLOWED * relative * (_FORCE + nominal.tool.mass * GRAVITY)
    return {
        "force_z": scored,
        "relative_error_z": relative,
        "allowed_rmse": float(allowed),
        "within": bool(scored["identified"]["rmse"] <= allowed),
    }

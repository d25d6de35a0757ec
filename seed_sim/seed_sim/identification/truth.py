# SPDX-License-Identifier: Apache-2.0
"""The hidden truth of a simulated identification, drawn from the seed, and results compared with it."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seed_core.bushing import Stiffness
from seed_core.hand import GRAVITY, GripperPressure
from seed_core.spatial import Array
from seed_core.stiffness_file import GripStiffness, StiffnessFile
from seed_sim.identification.scenario import IdentificationScenario
from seed_sim.scenario import load_scenario
from seed_sysid.fit.analysis import Analysis
from seed_sysid.report.summary import split, summary

_FORCE = 10.0  # [N] of the squeegee in closed loop
_ALLOWED = 1.2  # times the relative error of the force axis times (force + weight)


@dataclass(frozen=True)
class Truth:
    """Stiffness per grip (G, 6) and its pressure (G,) [hPa], frame offset (6,), bias and drift of the sensor (6,)."""

    stiffness: Array
    pressures: Array
    offset: Array
    bias: Array
    drift: Array


def draw_truth(scenario: IdentificationScenario, rng: np.random.Generator) -> Truth:
    """The hidden values of one seed."""
    grasp, sensor = scenario.grasp, scenario.sensor
    widths = np.array(scenario.procedure.widths)
    gripper = GripperPressure(float(np.median(widths)), grasp.pressure, -grasp.pressure_per_width)
    pressures = gripper.at_width(widths)
    base = grasp.stiffness.vector() * rng.uniform(1.0 - grasp.spread, 1.0 + grasp.spread, 6)
    trend = 1.0 + np.outer(pressures - grasp.pressure, grasp.slope)
    scatter = 1.0 + rng.uniform(-1.0, 1.0, (len(widths), 6)) * np.array(grasp.scatter)
    turn, shift = np.deg2rad(sensor.offset_deg) * direction(rng), 1e-3 * sensor.offset_mm * direction(rng)
    uniform = rng.uniform(-1.0, 1.0, (2, 6))
    bias = uniform[0] * np.repeat([sensor.torque_bias, sensor.force_bias], 3)
    drift = uniform[1] * np.repeat([sensor.torque_drift, sensor.force_drift], 3)
    return Truth(base * np.maximum(trend, 0.1) * scatter, pressures, np.concatenate([turn, shift]), bias, drift)


def direction(rng: np.random.Generator) -> Array:
    """A random unit vector (3,)."""
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def summary_with_truth(a: Analysis, truth: Truth) -> dict[str, Any]:
    """The summary of an analysis with the truth and the errors against it."""
    true, found, g = truth.stiffness[a.grips], a.solution.value, a.nominal
    relative = np.abs(found.stiffness - true) / true
    covered = np.abs(found.stiffness - true) <= a.solution.half_width
    offset_error = found.offset - truth.offset
    return summary(a) | {
        "truth": split(true[g]),
        "relative_error": split(relative[g]),
        "max_relative_error": float(relative[g].max()),
        "max_relative_error_all_grips": float(relative.max()),
        "truth_all_grips": [split(v) for v in true],
        "covered": [split(v) for v in covered],
        "frame_offset_error": {
            "rotation_deg": float(np.rad2deg(np.linalg.norm(offset_error[:3]))),
            "translation_mm": float(1e3 * np.linalg.norm(offset_error[3:])),
        },
    }


def compare_in_the_loop(file: StiffnessFile, width: float, true: Array, seed: int) -> dict[str, Any]:
    """What an identified stiffness is worth: the squeegee in closed loop, believing it, against believing the truth.

    Args:
        file: the result; width: [m] of the gripper, at which the controller looks its belief up in it.
        true: (6,) the plant's stiffness at that width.

    Returns:
        Rms and mean of the force error [N] of both, and the bound that the identification's error allows.
    """
    from seed_sim import evaluate

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

# SPDX-License-Identifier: Apache-2.0
"""A simulated identification without a force sensor: a known weight hangs in the hand, which is turned."""

from typing import Any

import numpy as np

from seed_core.bushing import Bushing, Model, Stiffness
from seed_core.hand import weight_about_T
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, rotation_from_rpy, so3_exp
from seed_sim.identification.scenario import IdentificationScenario
from seed_sim.identification.truth import draw_truth
from seed_sysid.fit.weight import ORIENTATIONS_DEG, WeightFit, fit_weight
from seed_sysid.report.summary import split
from seed_sysid.report.weight import split_known

_NOISE = np.array([np.deg2rad(0.1)] * 3 + [5e-5] * 3)  # [rad, m]; of averaged images: docs/estimation_figures.md
_SETTLED = 30  # steps of the fixed point of a tool that turns under its weight


def simulate_weight(
    stiffness: Stiffness, mass: float, center_of_mass: Array, rng: np.random.Generator, model: Model = "midpoint"
) -> tuple[Array, Array]:
    """Poses X_TC (n, 4, 4) as measured and spring wrenches (n, 6) as computed from them, for each orientation."""
    bushing = Bushing(stiffness, model)
    poses, wrenches = [], []
    for roll, pitch in ORIENTATIONS_DEG:
        R_WC = rotation_from_rpy(np.deg2rad([roll, pitch, 0.0]))
        X_TC = np.eye(4)
        for _ in range(_SETTLED):
            X_TC = bushing.pose(_carrying(X_TC, R_WC, mass, center_of_mass))
        noise = _NOISE * rng.normal(size=6)
        poses.append(X_TC @ make_pose(so3_exp(noise[:3]), noise[3:]))
        wrenches.append(_carrying(poses[-1], R_WC, mass, center_of_mass).vector())
    return np.array(poses), np.array(wrenches)


def _carrying(X_TC: Array, R_WC: Array, mass: float, center_of_mass: Array) -> Wrench:
    """What the spring exerts on the tool to carry it, about T, in T."""
    return Wrench.zero().minus(weight_about_T(mass, center_of_mass, R_WC @ inverse_pose(X_TC)[:3, :3]))


def identify_with_weight(scenario: IdentificationScenario, seed: int, model: Model) -> tuple[WeightFit, dict[str, Any]]:
    """Simulate and fit a scenario's middle grip; the fit, and all figures as plain data."""
    rng = np.random.default_rng([seed, 0x5EED])
    truth = draw_truth(scenario, rng).stiffness[len(scenario.procedure.widths) // 2]
    hidden, weight = Stiffness.from_vector(truth), scenario.weight
    fit = fit_weight(*simulate_weight(hidden, weight.mass, np.array(weight.center_of_mass), rng, model), model)
    error = np.abs(fit.stiffness - truth) / truth
    return fit, {
        "procedure": "weight",
        "stiffness": split_known(fit.stiffness),
        "std": split_known(fit.std),
        "truth": split(truth),
        "relative_error": split_known(error),
        "max_relative_error": float(np.nanmax(error)),
        "undetermined": fit.undetermined,
        "scenario": scenario.name,
        "seed": seed,
        "orientations": len(ORIENTATIONS_DEG),
    }

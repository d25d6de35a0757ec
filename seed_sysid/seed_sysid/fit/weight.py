# SPDX-License-Identifier: Apache-2.0
"""Stiffness without a force sensor: a calibrated weight, held in a few orientations.

At rest the spring carries the weight: w = -(com x m g, m g) about T, in T. With w = B (K xi) each axis is a line
through its own numbers, xi_j = (B^-1 w)_j / k_j + xi0_j; xi0 is how the grasp sat at its reference. An axis gets a
stiffness only where the weight loads it: a weight whose centre of mass lies at T gives the forces alone.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from seed_core.bushing import Bushing, Model, Stiffness
from seed_core.errors import SeedError
from seed_core.spatial import Array, Wrench, cross, inverse_pose, make_pose, rotation_from_rpy, so3_exp
from seed_sysid.stiffness_map import AXES, UNITS, stiffness_map

GRAVITY = np.array([0.0, 0.0, -9.81])  # [m/s^2]
_UNCERTAIN = 0.10  # relative standard deviation above which an axis is not given
_MINIMUM = 4
_TURNS_DEG = ((0, 0), (90, 0), (-90, 0), (180, 0), (0, 90), (0, -90), (45, 0), (0, 45), (-135, 0), (0, -135))
_SIM_NOISE = np.array(
    [np.deg2rad(0.1)] * 3 + [5e-5] * 3
)  # [rad, m]; an average of some images (math.md of the estimator)


class WeightError(SeedError):
    """Data of a held weight that give no stiffness."""


@dataclass(frozen=True)
class WeightFit:
    """Stiffness (6,) and its standard deviation, nan where the weight cannot tell, and why."""

    stiffness: Array
    std: Array
    residual: Array
    undetermined: dict[str, str]


def weight_wrench(R_WT: Array, mass: float, center_of_mass: Array) -> Array:
    """(6,) what the spring exerts on the tool to carry it, about T, in T."""
    f = -mass * (R_WT.T @ GRAVITY)
    return np.concatenate([cross(center_of_mass, f), f])


def fit_weight(X_TC: Array, wrench: Array, model: Model = "midpoint") -> WeightFit:
    """Fit displacements X_TC (n, 4, 4) under spring wrenches (n, 6).

    Raises:
        WeightError: too few orientations, or no axis is loaded.
    """
    if len(X_TC) < _MINIMUM:
        raise WeightError(f"{len(X_TC)} orientations are too few: hold the weight in at least {_MINIMUM}")
    m = stiffness_map(X_TC, model)
    load = np.asarray(np.linalg.solve(m.B, wrench[:, :, None])[:, :, 0], dtype=float)
    k, std, residual, reasons = np.full(6, np.nan), np.full(6, np.nan), np.zeros(6), {}
    for j, axis in enumerate(AXES):
        k[j], std[j], residual[j] = _line(load[:, j], m.xi[:, j])
        reason = _refusal(k[j], std[j], float(np.ptp(load[:, j])), j)
        if reason:
            reasons[axis], k[j], std[j] = reason, np.nan, np.nan
    if len(reasons) == 6:
        raise WeightError("the weight determines no axis: use a heavier one and turn the hand further")
    return WeightFit(k, std, residual, reasons)


def _line(load: Array, xi: Array) -> tuple[float, float, float]:
    """Stiffness, its standard deviation, and the residual of xi, from a straight line of xi over load."""
    center = load - load.mean()
    spread = float(center @ center)
    if spread <= 0.0:
        return float("nan"), float("inf"), float(xi.std())
    compliance = float(center @ xi) / spread
    r = xi - xi.mean() - compliance * center
    s = float(np.sqrt(r @ r / (len(xi) - 2)))
    return 1.0 / compliance, s / np.sqrt(spread) / compliance**2, s


def _refusal(k: float, std: float, span: float, j: int) -> str:
    unit = "N m" if j < 3 else "N"
    if span < (1e-3 if j < 3 else 0.05):
        return f"the weight puts no {'torque' if j < 3 else 'force'} on it (at most {span:.2g} {unit})"
    if k <= 0.0 or std > _UNCERTAIN * k:
        return f"its load varies by {span:.2g} {unit} only: too little for the noise of the poses"
    return ""


def simulate_weight(
    stiffness: Array, mass: float, com: Array, rng: np.random.Generator, model: Model = "midpoint"
) -> tuple[Array, Array]:
    """Poses X_TC (n, 4, 4) as measured and spring wrenches (n, 6) as computed from them, for each orientation."""
    k = [float(v) for v in stiffness]
    bushing = Bushing(Stiffness((k[0], k[1], k[2]), (k[3], k[4], k[5])), model)
    poses, wrenches = [], []
    for roll, pitch in _TURNS_DEG:
        R_WC = rotation_from_rpy(np.deg2rad([roll, pitch, 0.0]))
        X_TC = _hanging(bushing, R_WC, mass, com)
        noise = _SIM_NOISE * rng.normal(size=6)
        seen = X_TC @ make_pose(so3_exp(noise[:3]), noise[3:])
        poses.append(seen)
        wrenches.append(weight_wrench(R_WC @ inverse_pose(seen)[:3, :3], mass, com))
    return np.array(poses), np.array(wrenches)


def _hanging(bushing: Bushing, R_WC: Array, mass: float, com: Array) -> Array:
    """Equilibrium X_TC (4, 4) of a weight in a hand turned to R_WC; the turn of the tool changes what gravity does."""
    X_TC = np.eye(4)
    for _ in range(30):
        w = weight_wrench(R_WC @ X_TC[:3, :3].T, mass, com)
        X_TC = bushing.pose(Wrench(w[:3], w[3:]))
    return X_TC


def run_weight(args: argparse.Namespace) -> int:
    """./seed identify --procedure weight: simulate and fit, or say what is missing."""
    from seed_sim.identification.cell import draw_truth
    from seed_sim.identification.scenario import load

    scenario = load(args.scenario)
    if args.source:
        raise WeightError("--from holds wrenches of a sensor; --procedure weight has none: leave one of the two out")
    rng = np.random.default_rng([args.seed, 0x5EED])
    truth = draw_truth(scenario, rng).stiffness[len(scenario.procedure.widths) // 2]
    w = scenario.weight
    model = args.model or scenario.procedure.fit.model
    fit = fit_weight(*simulate_weight(truth, w.mass, np.array(w.center_of_mass), rng, model), model)
    figures = _figures(fit, truth) | {"scenario": scenario.name, "seed": args.seed, "orientations": len(_TURNS_DEG)}
    print(json.dumps(figures) if args.json else _text(fit, truth, w.mass))
    return 0


def _figures(fit: WeightFit, truth: Array) -> dict[str, Any]:
    def split(v: Array) -> dict[str, list[float | None]]:
        values = [float(x) if np.isfinite(x) else None for x in v]
        return {"rotation": values[:3], "translation": values[3:]}

    error = np.abs(fit.stiffness - truth) / truth
    return {
        "procedure": "weight",
        "stiffness": split(fit.stiffness),
        "std": split(fit.std),
        "truth": split(truth),
        "relative_error": split(error),
        "max_relative_error": float(np.nanmax(error)),
        "undetermined": fit.undetermined,
    }


def _text(fit: WeightFit, truth: Array, mass: float) -> str:
    lines = [f"stiffness from a weight of {mass:g} kg in {len(_TURNS_DEG)} orientations:"]
    for j, axis in enumerate(AXES):
        if axis in fit.undetermined:
            lines.append(f"  {axis:<6} not given: {fit.undetermined[axis]}")
        else:
            k, s = fit.stiffness[j], fit.std[j]
            value = f"{k:9.2f} +- {2 * s:6.2f} {UNITS[j]:<8}"
            lines.append(f"  {axis:<6}{value} true {truth[j]:9.2f}  error {abs(k / truth[j] - 1):6.2%}")
    return "\n".join(lines)

# SPDX-License-Identifier: Apache-2.0
"""Hysteresis, loading against unloading: friction along an axis that is elastic first and then slides (Prandtl's stop).

The state z of an axis follows its coordinate with slope 1/yield and saturates at +-1; the load is k xi + h z. Between
two samples each coordinate runs straight, so the state at the samples is exact. A new grasp begins with z = 0. An axis
is hysteretic when the data want its h: clearly away from zero, and not small beside what the axis carries.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seed_core.spatial import Array
from seed_sysid.fit.identification_fit import Solution, fit_stiffness
from seed_sysid.fit.load_model import Problem
from seed_sysid.stiffness_map import stiffness_map

_YIELDS = (0.02, 0.1, 0.25)  # share of an axis' range until friction slides: candidates
_SIGNIFICANT = 6.0  # standard deviations
_SHARE = 0.02  # of the largest elastic load on that axis; below it friction does not matter


def stop_states(path: Array, index: np.ndarray, yields: Array, grasps: Sequence[int] = ()) -> Array:
    """z (n, 6) of n samples, which are the points `index` (n,) of a path (m, 6) that starts at rest at the centre, and
    anew in another grasp at each of the points `grasps`."""
    steps = np.diff(path, axis=0, prepend=np.zeros((1, 6))) / yields
    steps[list(grasps)] = 0.0
    states = [np.array([_stop(axis) for axis in part.T.tolist()]) for part in np.split(steps, list(grasps))]
    return np.asarray(np.concatenate(states, axis=1).T[index])


def _stop(steps: list[float]) -> list[float]:
    """The state of one axis after each step. A plain loop: a fit goes over millions of steps."""
    z, states = 0.0, []
    for step in steps:
        z += step
        if z > 1.0:
            z = 1.0
        elif z < -1.0:
            z = -1.0
        states.append(z)
    return states


def fit_with_friction(problem: Problem) -> tuple[Problem, Solution]:
    """The problem with the hysteretic axes that its data show, and its fit.

    Each axis' friction is first fitted along with everything else, for several lengths of yield; the best length stays.
    """
    xi = stiffness_map(problem.path, problem.parameters.model).xi
    ranges = np.abs(xi).max(axis=0)
    trials = []
    for share in _YIELDS:
        z = stop_states(xi, problem.index, np.maximum(share * ranges, 1e-9), problem.grasps)
        trial = replace(problem, z=z, hysteretic=tuple(range(6)))
        trials.append((trial, fit_stiffness(trial)))
    best, solution = min(trials, key=lambda trial: _cost(trial[1]))
    friction = np.abs(solution.value.friction)
    carried = np.abs(solution.value.stiffness).max(axis=0) * ranges
    flagged = (friction > _SIGNIFICANT * np.maximum(solution.std.friction, 1e-12)) & (friction > _SHARE * carried)
    final = replace(best, hysteretic=tuple(int(j) for j in np.flatnonzero(flagged)))
    return final, fit_stiffness(final)


def _cost(solution: Solution) -> float:
    """Log-likelihood up to constants, robustly: the sum of the logarithms of the channels' noise."""
    residuals = np.abs(solution.residuals)
    return float(np.log(np.maximum(np.median(residuals, axis=0), 1e-9)).sum())

# SPDX-License-Identifier: Apache-2.0
"""From a file of samples to everything that is said about a grasp."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from seed_core.spatial import Array, interpolate_pose, pose_from_rpy
from seed_sysid.data.dataset import Dataset, DatasetError
from seed_sysid.fit import checks
from seed_sysid.fit.assumption_2 import Assumption, check_diagonal
from seed_sysid.fit.hysteresis import find
from seed_sysid.fit.identification_fit import Problem, Solution, solve
from seed_sysid.fit.stiffness_schedule import GripModel, fit_grips
from seed_sysid.parameters import FitParameters
from seed_sysid.stiffness_map import AXES, UNITS, wrench_transform

_UNCERTAIN = 0.10  # relative standard deviation above which an axis counts as undetermined
_OFFSET_DEG, _OFFSET = 20.0, 0.04  # [deg], [m]; a larger frame offset is a wrong frame, not a tolerance
_FOLDS = 5
_WAY = (0.25, 0.5, 0.75)  # a straight way in space is curved in the axes of the stiffness map


@dataclass(frozen=True)
class Analysis:
    """A fit and what is to be known about it.

    Attributes:
        grips: number of each grip, (G,); widths [m] and pressures [hPa] are their means.
        hysteresis: significance of friction per axis (6,), in standard deviations.
        left_out: rms error of wrenches (6,) predicted for poses that the fit did not see;
            `left_out_share`: as a share of their spread.
    """

    data: Dataset
    source: str
    problem: Problem
    solution: Solution
    grips: np.ndarray
    widths: Array
    pressures: Array
    pressure_std: Array
    hysteretic: tuple[str, ...]
    hysteresis: Array
    outliers: tuple[str, ...]
    undetermined: tuple[str, ...]
    assumption: Assumption
    left_out: Array
    left_out_share: Array
    grip_model: GripModel | None
    warnings: tuple[str, ...]

    @property
    def nominal(self) -> int:
        """Index of the grip in the middle of the widths."""
        return int(np.argsort(self.widths, kind="stable")[len(self.widths) // 2])


def analyse(data: Dataset, source: str, parameters: FitParameters | None = None) -> Analysis:
    """Check and fit data with poses from source ('kinematic' or 'estimator').

    Raises:
        DatasetError: the data cannot give a stiffness; the message says why and what to do.
    """
    fit = parameters or FitParameters()
    data = data.with_poses(source)
    checks.check(data, source)
    problem = make_problem(data, source, fit)
    solution, significance = solve(problem), np.zeros(6)
    if fit.hysteresis:
        problem, solution, significance = find(problem)
    _refuse_nonsense(solution)
    grips = np.unique([s.grip for s in data.samples])
    widths, pressures, pressure_std = _grip_states(data, grips)
    left_out, share = cross_validate(problem)
    undetermined = _undetermined(solution)
    result = Analysis(
        data=data,
        source=source,
        problem=problem,
        solution=solution,
        grips=grips,
        widths=widths,
        pressures=pressures,
        pressure_std=pressure_std,
        hysteretic=tuple(AXES[j] for j in problem.hysteretic),
        hysteresis=significance,
        outliers=tuple(s.key for s, good in zip(data.samples, solution.inlier, strict=True) if not good),
        undetermined=undetermined,
        assumption=check_diagonal(problem, solution),
        left_out=left_out,
        left_out_share=share,
        grip_model=fit_grips(widths, pressures, solution) if np.isfinite(pressures).all() else None,
        warnings=(),
    )
    return replace(result, warnings=_warnings(result))


def make_problem(data: Dataset, source: str, fit: FitParameters) -> Problem:
    """The numbers of a dataset, wrenches moved to the nominal tool frame, grips counted from 0."""
    grips, X_TC = np.array([s.grip for s in data.samples]), data.poses(source)
    path, index = _path(data, X_TC)
    return Problem(
        X_TC=X_TC,
        wrench=data.wrenches() @ wrench_transform(data.header.X_TS).T,
        grip=np.searchsorted(np.unique(grips), grips),
        time=np.array([s.stamp for s in data.samples]),
        path=path,
        index=index,
        parameters=fit,
        group=np.array([int(s.kind == "combination") for s in data.samples]),
    )


def _path(data: Dataset, X_TC: Array) -> tuple[Array, np.ndarray]:
    """Points along the arm's way (m, 4, 4), close enough to show its curve, and which of them are the samples (n,)."""
    points, index = [np.eye(4)], []
    for sample, X in zip(data.samples, X_TC, strict=True):
        for turn in (*(pose_from_rpy(v[3:], v[:3]) for v in sample.via), X):
            start = points[-1]
            points += [interpolate_pose(start, turn, share) for share in _WAY]
            points.append(turn)
        index.append(len(points) - 1)
    return np.array(points), np.array(index)


def _refuse_nonsense(solution: Solution) -> None:
    """Stiffness must be positive and the frames near their nominal places."""
    bad = solution.stiffness + 2.0 * solution.stiffness_std < 0.0
    if bad[:, 3:].all():
        raise DatasetError(
            "every force stiffness is negative: the sensor reports the reaction (load on the hand); turn its sign, "
            "or the poses are X_CT instead of X_TC"
        )
    if bad.any():
        g, j = np.argwhere(bad)[0]
        raise DatasetError(
            f"stiffness about {AXES[j]} at grip {g} is {solution.stiffness[g, j]:.3g} {UNITS[j]}, below 0: "
            "frames disagree, or the sensor's axes are swapped; check sensor_rpy in the header"
        )
    turn, shift = float(np.rad2deg(np.linalg.norm(solution.offset[:3]))), float(np.linalg.norm(solution.offset[3:]))
    if turn > _OFFSET_DEG or shift > _OFFSET:
        raise DatasetError(
            f"frames disagree: sensor and tool seem {turn:.0f} deg and {1e3 * shift:.0f} mm off their nominal pose "
            f"(at most {_OFFSET_DEG:g} deg and {1e3 * _OFFSET:g} mm pass for a tolerance): "
            "correct sensor_xyz, sensor_rpy"
        )


def _undetermined(solution: Solution) -> tuple[str, ...]:
    relative = solution.stiffness_std / np.maximum(np.abs(solution.stiffness), 1e-12)
    return tuple(AXES[j] for j in range(6) if (relative[:, j] > _UNCERTAIN).any())


def _grip_states(data: Dataset, grips: np.ndarray) -> tuple[Array, Array, Array]:
    widths, pressures, spread = [], [], []
    for grip in grips:
        mine = [s for s in data.samples if s.grip == grip]
        known = [float(np.mean(s.pressures)) for s in mine if s.pressures]
        widths.append(float(np.mean([s.width for s in mine])))
        pressures.append(float(np.mean(known)) if known else float("nan"))
        spread.append(float(np.std(known)) if known else float("nan"))
    return np.array(widths), np.array(pressures), np.array(spread)


def cross_validate(problem: Problem) -> tuple[Array, Array]:
    """Error of predictions on poses left out of the fit: rms (6,) [N m, N] of inliers, and its share of the spread."""
    fold = np.arange(len(problem.X_TC)) % _FOLDS
    errors, values = [], []
    for i in range(_FOLDS):
        train = fold != i
        if len(np.unique(problem.grip[train])) < len(np.unique(problem.grip)):
            continue
        weighted = solve_subset(problem, train)
        keep = ~train & weighted.inlier
        errors.append(weighted.residuals[keep])
        values.append(problem.wrench[keep])
    e, w = np.vstack(errors), np.vstack(values)
    rms = np.sqrt((e**2).mean(axis=0))
    return rms, rms / np.maximum(w.std(axis=0), 1e-12)


def solve_subset(problem: Problem, train: np.ndarray) -> Solution:
    """Fit the samples of a mask; residuals, distances and inliers are of all samples."""
    from scipy.stats import chi2

    part = replace(
        problem,
        X_TC=problem.X_TC[train],
        wrench=problem.wrench[train],
        grip=problem.grip[train],
        time=problem.time[train],
        z=None if problem.z is None else problem.z[train],
        group=None if problem.group is None else problem.group[train],
    )
    fitted = solve(part)
    residuals = predict(problem, fitted, part) - problem.wrench
    distance = ((residuals / fitted.noise_of(problem)) ** 2).sum(axis=1)
    return replace(
        fitted, residuals=residuals, distance=distance, inlier=distance < chi2.isf(problem.parameters.outlier, 6)
    )


def predict(problem: Problem, fitted: Solution, of: Problem) -> Array:
    """Wrenches (n, 6) about T' of all samples of problem from a fit of part of them."""
    from seed_sysid.fit.identification_fit import _Model

    model = _Model(problem)
    theta = np.concatenate(
        [
            fitted.stiffness.ravel(),
            fitted.offset,
            fitted.bias.ravel(),
            fitted.drift,
            fitted.friction[list(problem.hysteretic)],
        ]
    )
    span = float(np.ptp(of.time)) or 1.0
    model.s = (problem.time - of.time.mean()) / span
    return model.predict(theta)


def _warnings(a: Analysis) -> tuple[str, ...]:
    out = list(a.data.warnings)
    planned, have = a.data.header.planned, len(a.data.samples)
    if have < planned:
        out.append(f"{have} of {planned} planned poses are there: resume the run for the rest")
    for axis in a.undetermined:
        out.append(f"{axis} is not determined by these data (standard deviation over {_UNCERTAIN:.0%}): excite it more")
    for axis in a.hysteretic:
        j = AXES.index(axis)
        h = abs(float(a.solution.friction[j]))
        out.append(f"{axis} is hysteretic: loading and unloading differ by {2 * h:.3g} {'N m' if j < 3 else 'N'}")
    unsettled = [s.key for s in a.data.samples if s.settle < 1.0 and s.settle > 0.0]
    if unsettled:
        out.append(f"{len(unsettled)} poses had not come to rest (first: {unsettled[0]}): raise settle.timeout")
    if a.outliers:
        out.append(f"outliers left out: {', '.join(a.outliers)}")
    out += a.assumption.warnings
    out += a.grip_model.warnings if a.grip_model else ["no pressures in the data: stiffness is tied to width only"]
    return tuple(out)

# SPDX-License-Identifier: Apache-2.0
"""The analysis of an identification: from samples to everything that is said about a grasp."""

from dataclasses import dataclass

import numpy as np

from seed_core.spatial import Array, interpolate_pose, pose_from_rpy, so3_log
from seed_sysid.data.dataset import Dataset
from seed_sysid.fit.assumption_2 import Assumption2, check_assumption_2
from seed_sysid.fit.checks import check_data, check_inliers, check_solution
from seed_sysid.fit.hysteresis import fit_with_friction
from seed_sysid.fit.identification_fit import Solution, fit_stiffness
from seed_sysid.fit.load_model import Problem
from seed_sysid.fit.membrane_map import MembraneResult, membrane_result
from seed_sysid.fit.stiffness_schedule import StiffnessSchedule, fit_schedule
from seed_sysid.parameters import FitParameters
from seed_sysid.stiffness_map import AXES, LOAD_UNITS, wrench_transform

_UNCERTAIN = 0.10  # relative standard deviation above which an axis counts as undetermined
_MOST_TURN = np.deg2rad(20.0)  # [rad] of the tool in a grasp that bears its work: the task will turn it further
WIDTHS_APART = 5e-4  # [m] of two grips; less is noise of an encoder, or of the hand that closes the gripper
_FOLDS = 5
_WAY = (0.25, 0.5, 0.75)  # a straight way in space is curved in the axes of the stiffness map


@dataclass(frozen=True)
class Analysis:
    """A fit and what is to be known about it.

    Attributes:
        data, source: the samples that were fitted, and where their poses come from.
        grips: number of each grip, (G,); widths [m] and pressures [hPa] are their means.
            Pressures are nan where they are unknown, or do not rise as the gripper closes; `no_pressures` says why.
        left_out: rms error of wrenches (6,) predicted for poses that the fit did not see;
            `left_out_share`: as a share of their spread.
        schedule: stiffness over pressure and width; None without two pressures.
        membrane: the map from the membranes' motion; None where no sample tells of it, or `membrane_refused` why not.
    """

    data: Dataset
    source: str
    problem: Problem
    solution: Solution
    grips: np.ndarray
    widths: Array
    pressures: Array
    assumption: Assumption2
    left_out: Array
    left_out_share: Array
    schedule: StiffnessSchedule | None
    membrane: MembraneResult | None = None
    membrane_refused: str = ""
    no_pressures: str = ""

    @property
    def nominal(self) -> int:
        """Index of the grip in the middle of the widths."""
        return int(np.argsort(self.widths, kind="stable")[len(self.widths) // 2])

    @property
    def grips_told_apart(self) -> bool:
        """Whether pressure or width differs from grip to grip, and not by the noise of an encoder alone."""
        return not self.no_pressures or bool((np.diff(np.sort(self.widths)) > WIDTHS_APART).all())

    @property
    def hysteretic(self) -> tuple[str, ...]:
        """Axes whose loading and unloading differ."""
        return tuple(AXES[j] for j in self.problem.hysteretic)

    @property
    def unexplained(self) -> Array:
        """(6,) share of each component about T that the stiffness leaves of poses that the fit did not see.

        Friction counts, which the fit explains and a bushing does not.
        """
        friction = self.solution.value.friction * np.sqrt((self.problem.z**2).mean(axis=0))
        spread = np.maximum(self.problem.wrench[self.solution.inlier].std(axis=0), 1e-12)
        return np.asarray(np.hypot(self.left_out_share, friction / spread))

    @property
    def outliers(self) -> tuple[str, ...]:
        """Keys of the samples that were left out."""
        return tuple(s.key for s, good in zip(self.data.samples, self.solution.inlier, strict=True) if not good)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Axes with a standard deviation above 10 % at any grip."""
        relative = self.solution.std.stiffness / np.maximum(np.abs(self.solution.value.stiffness), 1e-12)
        return tuple(AXES[j] for j in np.flatnonzero((relative > _UNCERTAIN).any(axis=0)))

    @property
    def not_borne(self) -> tuple[str, ...]:
        """Keys of the poses of the work that the grasp does not bear: there the estimator lost the tool, or it had
        turned by more than 20 degrees about one axis."""
        samples = zip(self.data.samples, self.problem.X_TC, strict=True)
        work = ((s, np.abs(so3_log(X_TC[:3, :3])).max()) for s, X_TC in samples if s.kind == "work")
        return tuple(s.key for s, turn in work if s.lost or turn > _MOST_TURN)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user has to know, in words."""
        out = list(self.data.warnings)
        planned, have = self.data.header.planned, len(self.data.samples)
        if have < planned:
            out.append(f"{have} of {planned} planned poses are there: resume the run for the rest")
        for axis in self.undetermined:
            out.append(
                f"{axis} is not determined by these data (standard deviation over {_UNCERTAIN:.0%}): excite it more"
            )
        for j, axis in zip(self.problem.hysteretic, self.hysteretic, strict=True):
            gap = 2.0 * abs(float(self.solution.value.friction[j]))
            out.append(f"{axis} is hysteretic: loading and unloading differ by {gap:.3g} {LOAD_UNITS[j]}")
        unsettled = [s.key for s in self.data.samples if 0.0 < s.settle < 1.0]
        if unsettled:
            out.append(f"{len(unsettled)} poses had not come to rest (first: {unsettled[0]}): raise settle.timeout")
        if poses := self.not_borne:
            out.append(
                f"the tool was lost, or had turned by more than {np.rad2deg(_MOST_TURN):.0f} degrees, at {len(poses)} "
                f"poses of the work (first: {poses[0]}): the grasp does not bear it; close the gripper further and "
                "identify again, or ask for less force"
            )
        if self.outliers:
            out.append(f"outliers left out: {', '.join(self.outliers)}")
        out += self.assumption.warnings
        if self.schedule:
            out += self.schedule.warnings
        if self.no_pressures:
            tied = "is tied to width only" if self.grips_told_apart else "is that of the middle grip: widths are alike"
            out.append(f"{self.no_pressures}: stiffness {tied}")
        if self.membrane is not None:
            out += self.membrane.remarks
        if self.membrane_refused:
            out.append(f"no membrane map: {self.membrane_refused}")
        return tuple(out)


def analyse(data: Dataset, source: str, parameters: FitParameters | None = None) -> Analysis:
    """Check and fit the data of an identification.

    Args:
        data: header and samples.
        source: 'kinematic' or 'estimator', the poses to use.
        parameters: of the fit.

    Returns:
        The fit with its cross-validation, Assumption 2, the stiffness schedule and warnings.

    Raises:
        DatasetError: the data cannot give a stiffness; the message says why and what to do.
    """
    parameters = parameters or FitParameters()
    data = data.with_poses(source)
    check_data(data, source)
    problem = make_problem(data, source, parameters)
    if parameters.hysteresis:
        problem, solution = fit_with_friction(problem)
    else:
        solution = fit_stiffness(problem)
    check_solution(solution)
    check_inliers(data, source, solution.inlier)
    grips = np.unique([s.grip for s in data.samples])
    widths, pressures = np.array([_grip_state(data, grip) for grip in grips]).T
    no_pressures = _no_pressures(widths, pressures)
    if no_pressures:
        pressures = np.full(len(grips), np.nan)
    left_out, share = cross_validate(problem)
    membrane, refused = membrane_result(data, problem, solution)
    return Analysis(
        data=data,
        source=source,
        problem=problem,
        solution=solution,
        grips=grips,
        widths=widths,
        pressures=pressures,
        assumption=check_assumption_2(problem, solution),
        left_out=left_out,
        left_out_share=share,
        schedule=fit_schedule(widths, pressures, solution),
        membrane=membrane,
        membrane_refused=refused,
        no_pressures=no_pressures,
    )


def make_problem(data: Dataset, source: str, parameters: FitParameters) -> Problem:
    """The numbers of a dataset, wrenches moved to the nominal tool frame, grips counted from 0."""
    samples, X_TC = data.samples, data.poses(source)
    path, index, grasps = _path(data, X_TC)
    return Problem(
        X_TC=X_TC,
        wrench=data.wrenches() @ wrench_transform(data.header.X_TS).T,
        grip=np.unique([s.grip for s in samples], return_inverse=True)[1],
        time=np.array([s.stamp for s in samples]),
        group=np.array([int(s.kind in ("combination", "work")) for s in samples]),
        path=path,
        index=index,
        z=np.zeros((len(samples), 6)),
        parameters=parameters,
        grasps=grasps,
    )


def _path(data: Dataset, X_TC: Array) -> tuple[Array, np.ndarray, tuple[int, ...]]:
    """Points along the arm's way (m, 4, 4), close enough to show its curve, which of them are the samples (n,), and at
    which another grasp begins: at the centre."""
    points, index, grasps = [np.eye(4)], [], []
    for before, sample, X in zip((None, *data.samples), data.samples, X_TC, strict=False):
        if before is not None and sample.grasp != before.grasp:
            grasps.append(len(points))
            points.append(np.eye(4))
        for turn in (*(pose_from_rpy(v[3:], v[:3]) for v in sample.via), X):
            start = points[-1]
            points += [interpolate_pose(start, turn, share) for share in _WAY]
            points.append(turn)
        index.append(len(points) - 1)
    return np.array(points), np.array(index), tuple(grasps)


def _grip_state(data: Dataset, grip: int) -> tuple[float, float]:
    """Mean width [m] and pressure [hPa] of a grip, nan where no pressure is known."""
    mine = [s for s in data.samples if s.grip == grip]
    known = [np.mean(s.pressures) for s in mine if s.pressures]
    return float(np.mean([s.width for s in mine])), float(np.mean(known)) if known else float("nan")


def _no_pressures(widths: Array, pressures: Array) -> str:
    """Why pressures [hPa] cannot tell grips of these widths [m] apart; '' where they rise as the gripper closes."""
    if not np.isfinite(pressures).all():
        return f"no pressures in the data of {np.isnan(pressures).sum()} of {len(pressures)} grips"
    in_order = pressures[np.lexsort((pressures, -widths))]
    if (np.diff(in_order) > 0.0).all():
        return ""
    values = ", ".join(f"{p:.1f}" for p in in_order)
    return f"pressure does not rise as the gripper closes ({values} hPa): a sensor is stuck or too coarse"


def cross_validate(problem: Problem) -> tuple[Array, Array]:
    """Error of predictions on poses left out of the fit: rms (6,) [N m, N] of inliers, and its share of the spread."""
    fold = np.empty(len(problem.X_TC), dtype=int)  # of each grip's poses a share, in whatever order they were recorded
    for grip in np.unique(problem.grip):
        mine = np.flatnonzero(problem.grip == grip)
        fold[mine] = np.arange(len(mine)) % _FOLDS
    errors, values = [], []
    for i in range(_FOLDS):
        train = fold != i
        fitted = fit_stiffness(problem, train)
        keep = ~train & fitted.likely
        errors.append(fitted.residuals[keep])
        values.append(problem.wrench[keep])
    e, w = np.vstack(errors), np.vstack(values)
    rms = np.sqrt((e**2).mean(axis=0))
    return rms, rms / np.maximum(w.std(axis=0), 1e-12)

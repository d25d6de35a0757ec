# SPDX-License-Identifier: Apache-2.0
"""Refusals of data that cannot be fitted, and of fits that make no sense: each says what is wrong and what to do."""

from dataclasses import replace

import numpy as np

from seed_core.spatial import Array, inverse_pose, so3_log
from seed_sysid.data.dataset import Dataset, DatasetError, grip_problem
from seed_sysid.fit.identification_fit import Solution
from seed_sysid.stiffness_map import AXES, CHANNELS, UNITS, stiffness_map

MINIMUM_POSES = 12  # at each grip; 12 unknowns with 6 numbers per pose, and something left to judge the fit by
_EXCITED = np.array([np.deg2rad(1.0)] * 3 + [5e-4] * 3)  # [rad, m]; an axis that moved less is not excited
_SATURATED = 3  # samples that share a channel's extreme value to the last digit
MOST_OUTLIERS = 0.3  # share of a grip's poses: of more nobody knows which are right; bent springs leave 0.25
_DISAGREE = np.array([6.0, 0.006])  # [deg, m]; median gap of two sources of pose
_OFFSET_DEG, _OFFSET = 20.0, 0.04  # [deg], [m]; a larger frame offset is a wrong frame, not a tolerance
_CORRECT = (
    "correct sensor.position and sensor.rpy_deg of the node sysid and repeat the goal, or in a file sensor_xyz and "
    "sensor_rpy of its header, and fit it again (--from)"
)
_IN_SI = (  # most that a displacement [m], a turn [rad], and the spread of torques [N m] and of forces [N] can be
    (
        0.2,
        "a displacement of {:.3g} m: a grasp gives way by some mm; it looks like mm (divide by 1000), "
        "or like a pose in the world instead of C in T",
    ),
    (1.3, "a rotation of {:.3g} rad: a grasp turns by 0.5 at most; it looks like degrees: convert to rad"),
    (100.0, "torques vary by {:.3g} N m: that looks like N mm; divide by 1000"),
    (2000.0, "forces vary by {:.3g} N: that looks like mN; divide by 1000"),
)


def check_data(data: Dataset, source: str) -> None:
    """Refuse data that cannot be fitted with poses from source ('kinematic' or 'estimator').

    Raises:
        DatasetError: naming the trouble and the remedy.
    """
    if not data.samples:
        raise DatasetError("the data hold no finished pose: record again")
    X_TC, wrenches = data.poses(source), data.wrenches()
    _check_units(data, wrenches)
    grips = np.array([s.grip for s in data.samples])
    for grip in np.unique(grips):
        _check_excitation(X_TC[grips == grip], int(grip))
    _check_sensor(wrenches, data.header.sensor_range)
    _check_frames(data)


def check_inliers(data: Dataset, source: str, inlier: np.ndarray) -> None:
    """Refuse a fit that leaves out too many poses of a grip, or all that excite an axis; inlier: (n,) what was fitted.

    Raises:
        DatasetError: naming the trouble and the remedy.
    """
    X_TC, grips = data.poses(source), np.array([s.grip for s in data.samples])
    for grip in np.unique(grips):
        mine = grips == grip
        out = [s.key for s, left_out in zip(data.samples, mine & ~inlier, strict=True) if left_out]
        if len(out) > MOST_OUTLIERS * mine.sum():
            raise DatasetError(
                f"grip {grip}: {len(out)} of {mine.sum()} poses do not fit one spring (at most {MOST_OUTLIERS:.0%} "
                f"may be left out; first: {out[0]}): check that the tool sits fast and that nothing but the hand "
                "touches the sensor, and record again"
            )
        if out:
            _check_moved(X_TC[mine & inlier], int(grip), f", without {len(out)} outliers (first: {out[0]})")


def check_solution(solution: Solution) -> None:
    """Refuse a fit whose stiffness is negative, or whose frames are far from their nominal places.

    Raises:
        DatasetError: naming the trouble and the remedy.
    """
    stiffness, offset = solution.value.stiffness, solution.value.offset
    bad = stiffness + 2.0 * solution.std.stiffness < 0.0
    if bad[:, 3:].all():
        raise DatasetError(
            "every force stiffness is negative: the sensor reports the reaction (load on the hand); turn its sign, "
            "or the poses are X_CT instead of X_TC"
        )
    if bad.any():
        g, j = np.argwhere(bad)[0]
        raise DatasetError(
            f"stiffness about {AXES[j]} at grip {g} is {stiffness[g, j]:.3g} {UNITS[j]}, below 0: "
            f"frames disagree, or the sensor's axes are swapped: {_CORRECT}"
        )
    turn, shift = float(np.rad2deg(np.linalg.norm(offset[:3]))), float(np.linalg.norm(offset[3:]))
    if turn > _OFFSET_DEG or shift > _OFFSET:
        raise DatasetError(
            f"frames disagree: sensor and tool seem {turn:.0f} deg and {1e3 * shift:.0f} mm off their nominal pose "
            f"(at most {_OFFSET_DEG:g} deg and {1e3 * _OFFSET:g} mm pass for a tolerance): "
            f"{_CORRECT}"
        )


def _check_units(data: Dataset, wrenches: Array) -> None:
    poses = np.array([v for s in data.samples for v in (s.kinematic, s.estimator) if v is not None])
    spread = np.ptp(wrenches, axis=0)
    largest = np.abs(poses[:, :3]).max(), np.abs(poses[:, 3:]).max(), spread[:3].max(), spread[3:].max()
    for value, (most, words) in zip(largest, _IN_SI, strict=True):
        if value > most:
            raise DatasetError(words.format(value))
    for s in data.samples:
        if problem := grip_problem(s.width, s.pressures):
            raise DatasetError(f"sample {s.key}: {problem}")


def _check_excitation(X_TC: Array, grip: int) -> None:
    if len(X_TC) < MINIMUM_POSES:
        raise DatasetError(
            f"grip {grip} has {len(X_TC)} poses; at least {MINIMUM_POSES} are needed, 60 are advised: "
            "resume the run, or leave this grip out"
        )
    _check_moved(X_TC, grip)


def _check_moved(X_TC: Array, grip: int, words: str = "") -> None:
    moved = np.ptp(stiffness_map(X_TC).xi, axis=0)
    idle = ", ".join(axis for axis, m, least in zip(AXES, moved, _EXCITED, strict=True) if m < least)
    if idle:
        raise DatasetError(
            f"grip {grip}{words}: {idle} was never excited (moved by less than "
            f"1 deg or 0.5 mm): its stiffness cannot be known; visit poses along {idle} both ways"
        )


def _check_sensor(wrenches: Array, sensor_range: tuple[float, float]) -> None:
    full = np.repeat(sensor_range[::-1], 3)
    for name, values, most in zip(CHANNELS, wrenches.T, full, strict=True):
        if np.ptp(values) == 0.0:
            raise DatasetError(
                f"{name} of the sensor stays at {values[0]:g} at every pose: "
                "a dead channel or a frozen stream; check the sensor"
            )
        for extreme in (float(values.max()), float(values.min())):
            times = int((np.abs(values - extreme) <= 1e-9 * abs(extreme)).sum())
            if 0.0 < most <= abs(extreme) / 0.999 or times >= _SATURATED:
                raise DatasetError(
                    f"{name} of the sensor saturates at {extreme:g} ({times} of {len(values)} poses): "
                    "use smaller poses or a larger range"
                )


def _check_frames(data: Dataset) -> None:
    """Kinematics and estimator must speak of one displacement, if both are there."""
    both = replace(data, samples=[s for s in data.samples if s.kinematic is not None and s.estimator is not None])
    if len(both.samples) < MINIMUM_POSES:
        return
    kinematic, estimator = both.poses("kinematic"), both.poses("estimator")
    gap = _gap(kinematic, estimator)
    if (gap < _DISAGREE).all():
        return
    hint = "the grasp has slipped, or X_EC or X_CL/X_CR of the hand are wrong"
    if (_gap(kinematic, np.array([inverse_pose(X) for X in estimator])) < 0.5 * _DISAGREE).all():
        hint = "the estimator's poses look like X_CT; the file wants X_TC, their inverse"
    raise DatasetError(
        f"frames disagree: kinematics and estimator differ by {gap[0]:.1f} deg and {1e3 * gap[1]:.1f} mm "
        f"(median): {hint}"
    )


def _gap(A: Array, B: Array) -> Array:
    """Median turn [deg] and shift [m] between poses (n, 4, 4)."""
    turn = [np.linalg.norm(so3_log(a[:3, :3].T @ b[:3, :3])) for a, b in zip(A, B, strict=True)]
    return np.array([np.rad2deg(np.median(turn)), np.median(np.linalg.norm(A[:, :3, 3] - B[:, :3, 3], axis=1))])

# SPDX-License-Identifier: Apache-2.0
"""Whether data can be fitted at all: every refusal says what is wrong and what to do about it."""

from __future__ import annotations

import numpy as np

from seed_core.spatial import Array, inverse_pose, so3_log
from seed_sysid.data.dataset import Dataset, DatasetError
from seed_sysid.stiffness_map import AXES, CHANNELS, stiffness_map

MINIMUM_POSES = 12  # at each grip; 12 unknowns with 6 numbers per pose, and something left to judge the fit by
_EXCITED = np.array([np.deg2rad(1.0)] * 3 + [5e-4] * 3)  # [rad, m]; an axis that moved less is not excited
_SATURATED = 3  # samples that share a channel's extreme value to the last digit
_DISAGREE_DEG, _DISAGREE = 6.0, 0.006  # [deg], [m]; median gap of two sources of pose


def check(data: Dataset, source: str) -> None:
    """Refuse data that cannot be fitted with poses from source ('kinematic' or 'estimator').

    Raises:
        DatasetError: naming the trouble and the remedy.
    """
    if not data.samples:
        raise DatasetError("the data hold no finished pose: record again")
    X, w = data.poses(source), data.wrenches()
    _check_units(w, data)
    grips = np.array([s.grip for s in data.samples])
    for grip in np.unique(grips):
        _check_count(int((grips == grip).sum()), int(grip))
        _check_excitation(X[grips == grip], int(grip))
    _check_sensor(w, data)
    _check_frames(data)


def _check_units(w: Array, data: Dataset) -> None:
    raw = np.array([v for s in data.samples for v in (s.kinematic, s.estimator) if v is not None])
    shift, turn = float(np.abs(raw[:, :3]).max()), float(np.abs(raw[:, 3:]).max())
    if shift > 0.2:
        raise DatasetError(
            f"a displacement of {shift:.3g} m: a grasp gives way by some mm; it looks like mm (divide by 1000), "
            "or like a pose in the world instead of C in T"
        )
    if turn > 1.3:
        raise DatasetError(
            f"a rotation of {turn:.3g} rad: a grasp turns by 0.5 at most; it looks like degrees: convert to rad"
        )
    torque, force = float(np.ptp(w[:, :3], axis=0).max()), float(np.ptp(w[:, 3:], axis=0).max())
    if torque > 100.0:
        raise DatasetError(f"torques vary by {torque:.3g} N m: that looks like N mm; divide by 1000")
    if force > 2000.0:
        raise DatasetError(f"forces vary by {force:.3g} N: that looks like mN; divide by 1000")


def _check_count(count: int, grip: int) -> None:
    if count < MINIMUM_POSES:
        raise DatasetError(
            f"grip {grip} has {count} poses; at least {MINIMUM_POSES} are needed, 60 are advised: "
            "resume the run, or leave this grip out"
        )


def _check_excitation(X: Array, grip: int) -> None:
    spread = np.ptp(stiffness_map(X).xi, axis=0)
    idle = [AXES[j] for j in range(6) if spread[j] < _EXCITED[j]]
    if idle:
        raise DatasetError(
            f"grip {grip}: {', '.join(idle)} was never excited (moved by less than "
            f"1 deg or 0.5 mm): its stiffness cannot be known; visit poses along {', '.join(idle)} both ways"
        )


def _check_sensor(w: Array, data: Dataset) -> None:
    full = np.repeat([data.header.sensor_range[1], data.header.sensor_range[0]], 3)
    for j, name in enumerate(CHANNELS):
        values = w[:, j]
        if np.ptp(values) == 0.0:
            raise DatasetError(
                f"{name} of the sensor stays at {values[0]:g} at every pose: "
                "a dead channel or a frozen stream; check the sensor"
            )
        for extreme in (float(values.max()), float(values.min())):
            times = int((np.abs(values - extreme) <= 1e-9 * abs(extreme)).sum())
            if 0.0 < full[j] <= abs(extreme) / 0.999 or times >= _SATURATED:
                raise DatasetError(
                    f"{name} of the sensor saturates at {extreme:g} ({times} of {len(values)} poses): "
                    "use smaller poses or a larger range"
                )


def _check_frames(data: Dataset) -> None:
    """Kinematics and estimator must speak of one displacement, if both are there."""
    both = Dataset(data.header, [s for s in data.samples if s.kinematic is not None and s.estimator is not None])
    if len(both.samples) < MINIMUM_POSES:
        return
    K, E = both.poses("kinematic"), both.poses("estimator")
    gap, inverted = _gap(K, E), _gap(K, np.array([inverse_pose(x) for x in E]))
    if gap[0] < _DISAGREE_DEG and gap[1] < _DISAGREE:
        return
    hint = "the grasp has slipped, or X_EC or X_CL/X_CR of the hand are wrong"
    if inverted[0] < 0.5 * _DISAGREE_DEG and inverted[1] < 0.5 * _DISAGREE:
        hint = "the estimator's poses look like X_CT; the file wants X_TC, their inverse"
    raise DatasetError(
        f"frames disagree: kinematics and estimator differ by {gap[0]:.1f} deg and {1e3 * gap[1]:.1f} mm "
        f"(median): {hint}"
    )


def _gap(A: Array, B: Array) -> tuple[float, float]:
    turn = [float(np.linalg.norm(so3_log(a[:3, :3].T @ b[:3, :3]))) for a, b in zip(A, B, strict=True)]
    shift = np.linalg.norm(A[:, :3, 3] - B[:, :3, 3], axis=1)
    return float(np.rad2deg(np.median(turn))), float(np.median(shift))

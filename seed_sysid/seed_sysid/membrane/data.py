# SPDX-License-Identifier: Apache-2.0
"""Samples of an identification as the membrane map's fit wants them: features, wrenches in C, nuisances."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from seed_core.membrane.features import COUNT, features
from seed_core.spatial import Array, inverse_pose, make_pose, so3_log
from seed_sysid.data.dataset import Dataset, DatasetError, Sample
from seed_sysid.data.membrane_sample import MembraneSample, since
from seed_sysid.membrane.terms import MAIN
from seed_sysid.stiffness_map import AXES, frame_derivatives, wrench_transform

LEAST_POSES = 24  # at a grip; fewer leave most terms to the prior
_LOST = 0.2  # share of samples that may lack the membranes' motion
_SEEN = 0.02  # [scale] rms of a motion of the tool below which the estimator's noise is all: 0.08 deg, 0.04 mm
_OFFSET_STD = np.array([np.deg2rad(3.0)] * 3 + [5e-3] * 3)  # of the sensor's frame
_BIAS_STD, _DRIFT_STD = np.array([2.0] * 3 + [50.0] * 3), np.array([0.02] * 3 + [0.5] * 3)  # [N m, N]


class MembraneData(NamedTuple):
    """n samples of G grips.

    Attributes:
        Z: (n, 32) features. wrench: (n, 6) about the point midway between both patches, in C, as the sensor tells it
            [N m, N]: about that point a grasp is the nearest to symmetric, wherever in the hand the tool is held.
        grip: (n,) number from 0; middles: (G, 2, 3) of the patches at the grasp [m].
        pressures: (G,) [hPa] at the grasp, nan where unknown. widths: (G,) [m].
        nuisance: (n, 6, k) derivatives of `wrench` by bias of each grip, drift, and the offset of the sensor's frame;
            nuisance_std: (k,) of their prior.
        motion: (n, 6) of the tool since its grip's first sample, in C: rotation vector [rad], translation [m].
        path: (n,) number of the path that a sample lies on: those along one axis, at all grips, are one; each
            combination is one of its own.
        with_pressure: whether all samples tell the pressures of both.
        lost: keys of samples without motion of the membranes, which are left out.
        kept: (n,) which of the dataset's samples these are.
    """

    Z: Array
    wrench: Array
    grip: np.ndarray
    middles: Array
    pressures: Array
    widths: Array
    nuisance: Array
    nuisance_std: Array
    motion: Array
    path: np.ndarray
    with_pressure: bool
    lost: tuple[str, ...]
    kept: np.ndarray

    @property
    def to_C(self) -> Array:
        """(G, 6, 6) that take a wrench about the point midway between both patches to C's origin, by grip."""
        return np.array([wrench_transform(make_pose(None, p)) for p in self.middles.mean(axis=1)])

    def without(self, bad: np.ndarray) -> MembraneData:
        """The samples that are not bad (n,)."""
        good = ~bad
        return self._replace(
            Z=self.Z[good], wrench=self.wrench[good], grip=self.grip[good], nuisance=self.nuisance[good],
            motion=self.motion[good], path=self.path[good], kept=self.kept[good],
        )  # fmt: skip


def has_membranes(data: Dataset) -> bool:
    """Whether any sample tells of membranes."""
    return any(s.membrane for s in data.samples)


def membrane_data(data: Dataset) -> MembraneData:
    """Features and wrenches of a dataset; motions count from the first sample of each grip, taken at the centre.

    Raises:
        DatasetError: samples without features, too few, or motions that the poses did not excite.
    """
    missing = tuple(s.key for s in data.samples if len(s.membrane) != 2)
    if len(missing) > _LOST * len(data.samples):
        raise DatasetError(
            f"{len(missing)} of {len(data.samples)} samples do not tell the motion of both membranes (first: "
            f"{missing[0]}; at most {_LOST:.0%} may): the estimator has to publish RelativePose.membrane at every pose"
        )
    index = np.flatnonzero([len(s.membrane) == 2 for s in data.samples])
    data = replace(data, samples=[data.samples[i] for i in index])
    samples = data.samples
    grips, grip = np.unique([s.grip for s in samples], return_inverse=True)
    pairs = [sorted(s.membrane, key=lambda m: m.finger) for s in samples]
    Z, middles, pressures = np.zeros((len(samples), COUNT)), [], []
    told = all(m.pressure is not None for pair in pairs for m in pair)
    for g in range(len(grips)):
        mine = np.flatnonzero(grip == g)
        if samples[mine[0]].kind != "home":
            raise DatasetError(f"grip {grips[g]}: its first sample must be of the centre, from which motions count")
        first = pairs[mine[0]]
        middle = np.array([m.centroid or (0.0, 0.0, 0.0) for m in first])
        for i in mine:
            Z[i] = _features(pairs[i], first, middle, told)
        middles.append(middle)
        pressures.append(np.mean([m.pressure for m in first]) if told else np.nan)
    _check(Z, grip, grips)
    X_TC = data.poses("kinematic" if all(s.kinematic is not None for s in samples) else "estimator")
    motion = np.array([_motion(inverse_pose(X)) for X in X_TC])
    motion -= np.array([motion[grip == g][0] for g in range(len(grips))])[grip]
    between = np.array([make_pose(None, -p) for p in np.mean(middles, axis=1)])[grip]  # (n, 4, 4) of C, midway
    from_T = np.array([wrench_transform(X @ inverse_pose(Y)) for X, Y in zip(between, X_TC, strict=True)])
    w_T = data.wrenches() @ wrench_transform(data.header.X_TS).T
    time = np.array([s.stamp for s in samples])
    drift = (time - time.mean()) / (float(np.ptp(time)) or 1.0)
    home = np.array([w_T[grip == g][0] for g in range(len(grips))])
    columns = [(grip == g)[:, None, None] * np.eye(6) for g in range(len(grips))]
    columns += [drift[:, None, None] * np.eye(6), frame_derivatives(w_T - home[grip])]
    return MembraneData(
        Z=Z,
        wrench=np.einsum("nij,nj->ni", from_T, w_T),
        grip=grip,
        middles=np.array(middles),
        pressures=np.array(pressures),
        widths=np.array([np.mean([s.width for s in samples if s.grip == g]) for g in grips]),
        nuisance=from_T @ np.concatenate(columns, axis=2),
        nuisance_std=np.concatenate([np.tile(_BIAS_STD, len(grips)), _DRIFT_STD, _OFFSET_STD]),
        motion=motion,
        path=_paths(samples),
        with_pressure=told,
        lost=missing,
        kept=index,
    )


def _motion(X: Array) -> Array:
    return np.concatenate((so3_log(X[:3, :3]), X[:3, 3]))


def _paths(samples: list[Sample]) -> np.ndarray:
    names = [s.kind if s.kind in (*AXES, "home") else s.key for s in samples]
    return np.unique(names, return_inverse=True)[1]


def _features(pair: list[MembraneSample], first: list[MembraneSample], middle: Array, told: bool) -> Array:
    left, right = (since(m, m0).estimate for m, m0 in zip(pair, first, strict=True))
    rises = (
        [(m.pressure or 0.0) - (m0.pressure or 0.0) for m, m0 in zip(pair, first, strict=True)] if told else (0.0, 0.0)
    )
    return features((left, right), middle, rises)


def _check(Z: Array, grip: np.ndarray, grips: np.ndarray) -> None:
    for g, number in enumerate(grips):
        mine = Z[grip == g]
        if len(mine) < LEAST_POSES:
            raise DatasetError(
                f"grip {number} has {len(mine)} samples with membranes; a map needs {LEAST_POSES}: resume the run"
            )
    refuse_idle(Z, np.full(6, _SEEN))


def refuse_idle(Z: Array, least: Array) -> None:
    """Raises DatasetError where a motion of the tool has less than `least` (6,) [scale] rms in features Z (n, 32)."""
    spread = np.sqrt((Z[:, list(MAIN)] ** 2).mean(axis=0))
    idle = [axis for axis, s, low in zip(AXES, spread, least, strict=True) if s < low]
    if idle:
        raise DatasetError(
            f"the membranes hardly moved along {', '.join(idle)}: rms {np.round(spread, 2).tolist()} of 4 deg or 2 mm "
            f"(at least {least.max():g}): visit larger poses, and grip harder if the grasp does not bear them; or "
            "the estimator does not follow the material"
        )

# SPDX-License-Identifier: Apache-2.0
"""The data of an identification: a header and a sample for each pose that was measured."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from seed_core.errors import SeedError
from seed_core.spatial import Array, pose_from_rpy, rpy_from_rotation
from seed_core.stiffness_file import MOST_PRESSURE, MOST_WIDTH
from seed_sysid.data.membrane_sample import MembraneSample

FORMAT, VERSION = "seed-stiffness-samples", 2
READABLE = (1, 2)  # version 1 had no `membrane` in its samples
UNITS = {"length": "m", "angle": "rad", "force": "N", "torque": "N m", "pressure": "hPa", "time": "s"}
SOURCES = ("kinematic", "estimator")  # of poses
Pose = tuple[float, ...]  # x, y, z [m], roll, pitch, yaw [rad]


class DatasetError(SeedError):
    """A file of samples that cannot be used."""


# Metadata of fields that are so many finite numbers (None: any); a null in the file is the default if nullable.
_TWO, _THREE, _SIX, _ANY = ({"size": size, "nullable": False} for size in (2, 3, 6, None))
_SIX_OR_NULL = {"size": 6, "nullable": True}
_ZERO3, _ZERO6 = (0.0,) * 3, (0.0,) * 6


@dataclass(frozen=True)
class Header:
    """What all samples of a file share.

    Attributes:
        sensor_xyz, sensor_rpy: nominal pose of the sensor's frame S in the tool's frame T [m, rad].
        sensor_range: largest force [N] and torque [N m] that the sensor can report; 0 if unknown.
        grasp_xyz, grasp_rpy: X_WT, where C stood at the grasp [m, rad]; kinematic displacements refer to it.
        planned: how many poses the run wants in all.
        run: names the run (scenario, seed, design); a file is only continued by the same run.
    """

    hand: str = ""
    tool: str = ""
    run: str = ""
    planned: int = 0
    sensor_frame: str = "ft_sensor"
    sensor_xyz: tuple[float, ...] = field(default=_ZERO3, metadata=_THREE)
    sensor_rpy: tuple[float, ...] = field(default=_ZERO3, metadata=_THREE)
    sensor_range: tuple[float, float] = field(default=(0.0, 0.0), metadata=_TWO)
    grasp_xyz: tuple[float, ...] = field(default=_ZERO3, metadata=_THREE)
    grasp_rpy: tuple[float, ...] = field(default=_ZERO3, metadata=_THREE)
    created: str = ""
    units: dict[str, str] = field(default_factory=lambda: dict(UNITS))
    format: str = FORMAT
    version: int = VERSION

    @property
    def X_TS(self) -> Array:
        """Nominal pose (4, 4) of the sensor in the tool's frame."""
        return pose_from_rpy(self.sensor_rpy, self.sensor_xyz)


@dataclass(frozen=True)
class Sample:
    """One pose, measured at rest. Poses are [x, y, z (m), roll, pitch, yaw (rad)] of C in T.

    Attributes:
        wrench: mean load of the hand on the sensor about S, in S: [torque (N m), force (N)].
        wrench_std: standard deviation of the single readings.
        settle: tolerance over change during the settling test; below 1 the pose was not at rest, 0: unknown.
        clipped: drawn back towards the centre because a limit was met.
        lost: drawn back because the estimator lost the tool.
        via: where the arm turned on its way from the last sample, if it did not come straight; friction depends on it.
        membrane: what both membranes did, where an estimator told.
        grasp: number of the grasp, from 0: friction has forgotten what was before.
    """

    name: str
    kind: str
    grip: int
    stamp: float
    kinematic: Pose | None = field(metadata=_SIX_OR_NULL)
    wrench: tuple[float, ...] = field(metadata=_SIX)
    estimator: Pose | None = field(default=None, metadata=_SIX_OR_NULL)
    wrench_std: tuple[float, ...] = field(default=_ZERO6, metadata=_SIX_OR_NULL)
    pressures: tuple[float, ...] = field(default=(), metadata=_ANY)
    width: float = 0.0
    settle: float = 0.0
    readings: int = 0
    slip: float = 0.0
    clipped: bool = False
    lost: bool = False
    via: tuple[Pose, ...] = ()
    membrane: tuple[MembraneSample, ...] = ()
    grasp: int = 0

    @property
    def key(self) -> str:
        """Unique within a run."""
        return f"{self.grip}/{self.name}"


@dataclass(frozen=True)
class Dataset:
    """A header, its samples in order of time, what was odd about the file, and the poses that lost the tool.

    Attributes:
        lost: keys of the poses at which a run ended since the tool was lost, one for each time.
        regrasp: whether a run ended after the last sample since the tool was lost or slid: what comes is a new grasp.
    """

    header: Header
    samples: list[Sample]
    warnings: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    regrasp: bool = False

    def poses(self, source: str) -> Array:
        """X_TC (n, 4, 4) from 'kinematic' or 'estimator'.

        Raises:
            DatasetError: a sample lacks that pose, or there is no such source.
        """
        _check_source(source)
        values = [getattr(s, source) for s in self.samples]
        missing = [s.key for s, v in zip(self.samples, values, strict=True) if v is None]
        if missing:
            raise DatasetError(f"{len(missing)} of {len(values)} samples have no {source} pose (first: {missing[0]})")
        return np.array([pose_from_rpy(v[3:], v[:3]) for v in values]).reshape(-1, 4, 4)

    def with_poses(self, source: str) -> Dataset:
        """Only the samples that have a pose from source; the others stay as points that the arm came through.

        Raises:
            DatasetError: no sample has one, or there is no such source.
        """
        _check_source(source)
        kept: list[Sample] = []
        missing: list[str] = []
        way: list[Pose] = []
        grasp = 0
        for s in self.samples:
            way = [*(way if s.grasp == grasp else ()), *s.via]
            grasp = s.grasp
            if getattr(s, source) is not None:
                kept.append(replace(s, via=tuple(way)))
                way = []
            else:
                missing.append(s.key)
                way += [s.kinematic] if s.kinematic else []
        if self.samples and not kept:
            raise DatasetError(f"no sample has an {source} pose: choose the other source with --poses, or record again")
        named = [f"without {source} pose, left out: {', '.join(missing)}"] if missing else []
        header = replace(self.header, planned=max(0, self.header.planned - len(missing)))
        return Dataset(header, kept, self.warnings + named)

    def wrenches(self) -> Array:
        """(n, 6) about S, in S."""
        return np.array([s.wrench for s in self.samples]).reshape(-1, 6)


def _check_source(source: str) -> None:
    if source not in SOURCES:
        raise DatasetError(f"source = '{source}' must be one of: {', '.join(SOURCES)}")


def flat_pose(X: Array) -> Pose:
    """[x, y, z, roll, pitch, yaw] of X (4, 4), as samples store it."""
    return tuple(float(v) for v in (*X[:3, 3], *rpy_from_rotation(X[:3, :3])))


def grip_problem(width: float, pressures: Iterable[float]) -> str:
    """Why a width [m] or pressures [hPa] are not those of a grip as stiffness.yaml takes them; '' if they may be."""
    if not 0.0 <= width <= MOST_WIDTH:
        hint = "it looks like mm: divide by 1000" if width > 0.0 else "the zero of gripper/width is wrong"
        return f"a gripper width of {width:.6g} m (0 to {MOST_WIDTH:g} m are possible): {hint}"
    for p in pressures:
        if not 0.0 <= p <= MOST_PRESSURE:
            hint = "it looks like Pa: divide by 100" if p > 0.0 else "it looks like a gauge pressure: add the air's"
            return f"a pressure of {p:.6g} hPa (0 to {MOST_PRESSURE:g} hPa are possible, absolute): {hint}"
    return ""

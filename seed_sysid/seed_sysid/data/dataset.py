# SPDX-License-Identifier: Apache-2.0
"""The file of samples: JSON lines, append-only, one header and then one line per finished pose.

Line 1 is the header ({"format": "seed-stiffness-samples", "version": 1, ...}: hand, tool, units, sensor), every other
line a sample or an event (docs/identification.md lists the keys). Each line is flushed to the disk before the next
pose is visited, so that a crash loses at most the running one.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from seed_core.errors import SeedError
from seed_core.spatial import Array, pose_from_rpy, rpy_from_rotation

FORMAT, VERSION = "seed-stiffness-samples", 1
UNITS = {"length": "m", "angle": "rad", "force": "N", "torque": "N m", "pressure": "hPa", "time": "s"}
MAX_BYTES = 200_000_000
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
        settle: tolerance over change during the settling test; below 1 the pose was not at rest.
        clipped: drawn back towards the centre because a limit was met.
        via: where the arm turned on its way from the last sample, if it did not come straight; friction depends on it.
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
    via: tuple[Pose, ...] = ()

    @property
    def key(self) -> str:
        """Unique within a run."""
        return f"{self.grip}/{self.name}"


@dataclass(frozen=True)
class Dataset:
    """A header, its samples in order of time, and what was odd about the file."""

    header: Header
    samples: list[Sample]
    warnings: list[str] = field(default_factory=list)

    def poses(self, source: str) -> Array:
        """X_TC (n, 4, 4) from 'kinematic' or 'estimator'.

        Raises:
            DatasetError: a sample lacks that pose.
        """
        values = [getattr(s, source) for s in self.samples]
        missing = [s.key for s, v in zip(self.samples, values, strict=True) if v is None]
        if missing:
            raise DatasetError(f"{len(missing)} of {len(values)} samples have no {source} pose (first: {missing[0]})")
        return np.array([pose_from_rpy(v[3:], v[:3]) for v in values]).reshape(-1, 4, 4)

    def with_poses(self, source: str) -> Dataset:
        """Only the samples that have a pose from source; the others stay as points that the arm came through.

        Raises:
            DatasetError: no sample has one.
        """
        kept: list[Sample] = []
        missing: list[str] = []
        way: list[Pose] = []
        for s in self.samples:
            way += s.via
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


def flat_pose(X: Array) -> Pose:
    """[x, y, z, roll, pitch, yaw] of X (4, 4), as samples store it."""
    return tuple(float(v) for v in (*X[:3, 3], *rpy_from_rotation(X[:3, :3])))


def header_line(header: Header) -> str:
    """The header as one line."""
    return json.dumps(asdict(header))


def sample_line(sample: Sample) -> str:
    """A sample as one line."""
    return json.dumps({"sample": asdict(sample)})


def read(path: Path) -> Dataset:
    """A file of samples.

    Raises:
        DatasetError: not readable, another format or version, or a broken line other than the last.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise DatasetError(f"{path}: {path.stat().st_size} bytes are too many (at most {MAX_BYTES})")
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DatasetError(f"{path}: cannot be read as a file of samples: {error}") from error
    return parse(text.split("\n"), str(path))


def parse(lines: Iterable[str], source: str) -> Dataset:
    """Header and samples from the lines of a file (or of a recorded topic), named source.

    Raises:
        DatasetError: another format or version, or a broken line other than the last.
    """
    rows = list(lines)
    while rows and not rows[-1].strip():
        rows.pop()
    if not rows:
        raise DatasetError(f"{source}: the file is empty; record again")
    header, samples, warnings = _header(rows[0], f"{source}:1"), {}, []
    for number, row in enumerate(rows[1:], start=2):
        where = f"{source}:{number}"
        try:
            entry = json.loads(row)
        except (ValueError, RecursionError) as error:
            if number < len(rows):
                raise DatasetError(f"{where}: not JSON ({error}); restore the line or remove it") from error
            warnings.append(f"{where}: the last line is cut short; that pose is left out (resume to repeat it)")
            break
        if isinstance(entry, dict) and "sample" in entry:
            sample = _sample(entry["sample"], where)
            samples[sample.key] = sample  # of a pose that was repeated the last one
    return Dataset(header, sorted(samples.values(), key=lambda s: s.stamp), warnings)


def _header(row: str, where: str) -> Header:
    try:
        data = json.loads(row)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{where}: no header in the first line ({error}): cut short, or no such file") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise DatasetError(f'{where}: the first line is no header with "format": "{FORMAT}"')
    if data.get("version") != VERSION:
        raise DatasetError(
            f"{where}: version {data.get('version')!r}; this program reads version {VERSION}: "
            "convert the file, or use the program that wrote it"
        )
    units = data.get("units", UNITS)
    for quantity, unit in UNITS.items():
        if not isinstance(units, dict) or units.get(quantity, unit) != unit:
            raise DatasetError(f"{where}: units {units!r}; {quantity} must be in {unit}: convert the file")
    return Header(**_values(data, Header, where))


def _sample(data: Any, where: str) -> Sample:
    if not isinstance(data, dict):
        raise DatasetError(f"{where}: a sample must be a mapping")
    missing = [n for n in ("name", "kind", "grip", "stamp", "wrench") if n not in data]
    if missing or not (data.get("kinematic") or data.get("estimator")):
        raise DatasetError(f"{where}: the sample lacks {', '.join(missing) or 'a pose (kinematic or estimator)'}")
    values = {"kinematic": None} | _values(data, Sample, where)
    for name in ("stamp", "width"):
        (values[name],) = _numbers([values.get(name, 0.0)], 1, f"{where}: {name}")
    via = values.get("via", ())
    if not isinstance(via, list | tuple):
        raise DatasetError(f"{where}: via = {via!r} must be a list")
    values["via"] = tuple(_numbers(v, 6, f"{where}: via") for v in via)
    if not isinstance(values["grip"], int) or values["grip"] < 0:
        raise DatasetError(f"{where}: grip = {values['grip']!r} must be a whole number from 0")
    return Sample(**values)


def _values(data: dict[str, Any], cls: type, where: str) -> dict[str, Any]:
    """The fields of a dataclass that stand in data, its vectors checked; keys that it does not know are left out."""
    out = {}
    for f in fields(cls):
        if f.name not in data or (data[f.name] is None and f.metadata.get("nullable")):
            continue
        vector = "size" in f.metadata
        out[f.name] = _numbers(data[f.name], f.metadata["size"], f"{where}: {f.name}") if vector else data[f.name]
    return out


def _numbers(values: Any, size: int | None, name: str) -> tuple[float, ...]:
    good = isinstance(values, list | tuple) and all(
        isinstance(v, int | float) and not isinstance(v, bool) and np.isfinite(v) for v in values
    )
    if not good or (size is not None and len(values) != size):
        raise DatasetError(f"{name} = {values!r} must be {size or 'some'} finite numbers")
    return tuple(float(v) for v in values)

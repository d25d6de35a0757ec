# SPDX-License-Identifier: Apache-2.0
"""The file of samples: JSON lines, append-only, one header and then one line per finished pose.

Line 1 is the header ({"format": "seed-stiffness-samples", "version": 1, ...}: hand, tool, units, sensor), every other
line a sample or an event (docs/identification.md lists the keys). Each line is flushed to the disk before the next
pose is visited, so that a crash loses at most the running one.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from seed_core.errors import SeedError
from seed_core.spatial import Array, pose_from_rpy, rpy_from_rotation

FORMAT, VERSION = "seed-stiffness-samples", 1
UNITS = {"length": "m", "angle": "rad", "force": "N", "torque": "N m", "pressure": "hPa", "time": "s"}
MAX_BYTES = 200_000_000


class DatasetError(SeedError):
    """A file of samples that cannot be used."""


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
    sensor_xyz: tuple[float, ...] = (0.0, 0.0, 0.0)
    sensor_rpy: tuple[float, ...] = (0.0, 0.0, 0.0)
    sensor_range: tuple[float, float] = (0.0, 0.0)
    grasp_xyz: tuple[float, ...] = (0.0, 0.0, 0.0)
    grasp_rpy: tuple[float, ...] = (0.0, 0.0, 0.0)
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
    kinematic: tuple[float, ...] | None
    wrench: tuple[float, ...]
    estimator: tuple[float, ...] | None = None
    wrench_std: tuple[float, ...] = (0.0,) * 6
    pressures: tuple[float, ...] = ()
    width: float = 0.0
    settle: float = 0.0
    readings: int = 0
    slip: float = 0.0
    clipped: bool = False
    via: tuple[tuple[float, ...], ...] = ()

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
        way: tuple[tuple[float, ...], ...] = ()
        for s in self.samples:
            if getattr(s, source) is not None:
                kept.append(replace(s, via=(*way, *s.via)))
                way = ()
            else:
                missing.append(s.key)
                way = (*way, *s.via, *((s.kinematic,) if s.kinematic else ()))
        if self.samples and not kept:
            raise DatasetError(f"no sample has an {source} pose: choose the other source with --poses, or record again")
        named = [f"without {source} pose, left out: {', '.join(missing)}"] if missing else []
        header = replace(self.header, planned=max(0, self.header.planned - len(missing)))
        return Dataset(header, kept, self.warnings + named)

    def wrenches(self) -> Array:
        """(n, 6) about S, in S."""
        return np.array([s.wrench for s in self.samples]).reshape(-1, 6)


def flat_pose(X: Array) -> tuple[float, ...]:
    """[x, y, z, roll, pitch, yaw] of X (4, 4), as samples store it."""
    return tuple(float(v) for v in (*X[:3, 3], *rpy_from_rotation(X[:3, :3])))


def header_line(header: Header) -> str:
    """The header as one line."""
    return json.dumps(asdict(header))


def sample_line(sample: Sample) -> str:
    """A sample as one line."""
    return json.dumps({"sample": asdict(sample)})


class Writer:
    """Appends to a file of samples; continues one that the same run began."""

    def __init__(self, path: Path, header: Header) -> None:
        """Open path; `finished` holds what it already has.

        Raises:
            DatasetError: the file belongs to another run, or is no file of samples.
        """
        self.finished: list[Sample] = []
        self.header = header
        self._path = path
        fresh = not path.exists() or path.stat().st_size == 0
        if not fresh:
            self._continue(path, header)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file: IO[str] = path.open("a", encoding="utf-8")
        if fresh:
            self._write(header_line(header))

    def _continue(self, path: Path, header: Header) -> None:
        old = read(path)
        if old.header.run != header.run:
            raise DatasetError(
                f"{path} belongs to the run '{old.header.run}', not to '{header.run}': choose another --out, "
                "or move the file away; it was left as it is"
            )
        self.finished, self.header = old.samples, old.header
        text = path.read_bytes()
        if not text.endswith(b"\n"):  # the line that a crash cut short
            with path.open("r+b") as file:
                file.truncate(text.rfind(b"\n") + 1)

    def add(self, sample: Sample) -> None:
        """Write one finished sample through to the disk."""
        self._write(sample_line(sample))

    def event(self, stamp: float, text: str) -> None:
        """Write a remark: a limit met, a pose skipped."""
        self._write(json.dumps({"event": {"stamp": stamp, "text": text}}))

    def _write(self, line: str) -> None:
        self._file.write(line + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()


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
    """Header and samples from the lines of a file (or of a recorded topic)."""
    rows = list(lines)
    while rows and not rows[-1].strip():
        rows.pop()
    if not rows:
        raise DatasetError(f"{source}: the file is empty; record again")
    header, samples, warnings = _header(rows[0], source), [], []
    for number, row in enumerate(rows[1:], start=2):
        try:
            entry = json.loads(row)
        except (ValueError, RecursionError) as error:
            if number < len(rows):
                raise DatasetError(f"{source}:{number}: not JSON ({error}); restore the line or remove it") from error
            warnings.append(
                f"{source}:{number}: the last line is cut short; that pose is left out (resume to repeat it)"
            )
            break
        if isinstance(entry, dict) and "sample" in entry:
            samples.append(_sample(entry["sample"], f"{source}:{number}"))
    return Dataset(header, _unique(samples), warnings)


def _unique(samples: list[Sample]) -> list[Sample]:
    """In order of time; of a pose that was repeated the last one."""
    return sorted({s.key: s for s in samples}.values(), key=lambda s: s.stamp)


def _header(row: str, source: str) -> Header:
    try:
        data = json.loads(row)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{source}:1: no header in the first line ({error}): cut short, or no such file") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise DatasetError(f'{source}:1: the first line is no header with "format": "{FORMAT}"')
    if data.get("version") != VERSION:
        raise DatasetError(
            f"{source}:1: version {data.get('version')!r}; this program reads version {VERSION}: "
            "convert the file, or use the program that wrote it"
        )
    units = data.get("units", UNITS)
    for quantity, unit in UNITS.items():
        if not isinstance(units, dict) or units.get(quantity, unit) != unit:
            raise DatasetError(f"{source}:1: units {units!r}; {quantity} must be in {unit}: convert the file")
    known = {f.name for f in fields(Header)}
    values = {k: v for k, v in data.items() if k in known}
    for name, size in (("sensor_xyz", 3), ("sensor_rpy", 3), ("sensor_range", 2), ("grasp_xyz", 3), ("grasp_rpy", 3)):
        if name in values:
            values[name] = _numbers(values[name], size, f"{source}:1: {name}")
    return Header(**values)


def _sample(data: Any, where: str) -> Sample:
    if not isinstance(data, dict):
        raise DatasetError(f"{where}: a sample must be a mapping")
    known = {f.name for f in fields(Sample)}
    missing = [n for n in ("name", "kind", "grip", "stamp", "wrench") if n not in data]
    if missing or not (data.get("kinematic") or data.get("estimator")):
        raise DatasetError(f"{where}: the sample lacks {', '.join(missing) or 'a pose (kinematic or estimator)'}")
    values = {k: v for k, v in data.items() if k in known}
    for name in ("kinematic", "estimator", "wrench", "wrench_std"):
        if values.get(name) is not None:
            values[name] = _numbers(values[name], 6, f"{where}: {name}")
    values.setdefault("kinematic", None)
    values["via"] = tuple(_numbers(v, 6, f"{where}: via") for v in _list(values.get("via", ()), f"{where}: via"))
    values["pressures"] = _numbers(values.get("pressures", ()), None, f"{where}: pressures")
    (values["stamp"],) = _numbers([values["stamp"]], 1, f"{where}: stamp")
    (values["width"],) = _numbers([values.get("width", 0.0)], 1, f"{where}: width")
    if not isinstance(values["grip"], int) or values["grip"] < 0:
        raise DatasetError(f"{where}: grip = {values['grip']!r} must be a whole number from 0")
    return Sample(**values)


def _list(values: Any, name: str) -> list[Any]:
    if not isinstance(values, list | tuple):
        raise DatasetError(f"{name} = {values!r} must be a list")
    return list(values)


def _numbers(values: Any, size: int | None, name: str) -> tuple[float, ...]:
    good = isinstance(values, list | tuple) and all(
        isinstance(v, int | float) and not isinstance(v, bool) and np.isfinite(v) for v in values
    )
    if not good or (size is not None and len(values) != size):
        raise DatasetError(f"{name} = {values!r} must be {size or 'some'} finite numbers")
    return tuple(float(v) for v in values)

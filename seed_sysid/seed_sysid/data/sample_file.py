# SPDX-License-Identifier: Apache-2.0
"""The file of samples: JSON lines, append-only, one header and then one line per finished pose.

Line 1 is the header ({"format": "seed-stiffness-samples", "version": 2, ...}: hand, tool, units, sensor), every other
line a sample or an event (docs/identification_inside.md lists the keys). Each line is flushed to the disk before the
next pose is visited, so that a crash loses at most the running one.
"""

import json
import os
from collections.abc import Iterable
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import IO, Any

from seed_core.program.files import written_whole
from seed_sysid.data.bag import bag_lines
from seed_sysid.data.dataset import FORMAT, READABLE, UNITS, Dataset, DatasetError, Header, Sample
from seed_sysid.data.membrane_sample import from_json

LARGE = 1e300  # beyond it a number is none
MAX_BYTES = 200_000_000
SENSOR = ("sensor_frame", "sensor_xyz", "sensor_rpy", "sensor_range")  # of the header; no sample depends on them


class Recorder:
    """Keeps the samples of a run and appends each to a file as it comes; continues a file that the same run began."""

    def __init__(self, path: Path | None, header: Header) -> None:
        """Open path; `samples`, `lost`, `regrasp` and `header` are then what the file has. None keeps it in memory.

        What the header says of the sensor is taken over into a file that goes on; `remark` tells of it.

        Raises:
            DatasetError: the file belongs to another run, or is no file of samples.
        """
        self.header, self.samples, self.lost = header, list[Sample](), list[str]()
        self.regrasp = False
        self.remark = ""
        self._file: IO[str] | None = None
        if path is None:
            return
        fresh = is_fresh(path)
        if not fresh:
            self._continue(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("a", encoding="utf-8")
        if fresh:
            self._write(header_line(header))
        if self.remark:
            self._write(json.dumps({"event": {"text": self.remark}}))

    def _continue(self, path: Path) -> None:
        old = read(path)
        its_run, run = old.header.run, self.header.run
        if its_run != run:
            live = not run.startswith("simulation") and its_run.rpartition(" ")[0] == run.rpartition(" ")[0]
            why = "; its hand file (hand.E_C) or its procedure was another" if live else ""
            raise DatasetError(
                f"{path} belongs to the run '{its_run}', not to '{run}'{why}: choose another --out, "
                "or move the file away; it was left as it is"
            )
        given = {name: getattr(self.header, name) for name in SENSOR}
        changed = [f"{n} = {v} (was {was})" for n, v in given.items() if v != (was := getattr(old.header, n))]
        self.samples, self.lost, self.header = old.samples, old.lost, replace(old.header, **given)
        self.regrasp = old.regrasp
        text = path.read_bytes()
        first, _, rest = text.partition(b"\n")
        if changed:
            self.remark = f"the sensor of {path} is corrected: {', '.join(changed)}"
            first = header_line(self.header).encode()
        if old.warnings:  # of a last line that a crash cut short
            rest = rest[: rest.rstrip().rfind(b"\n") + 1]
        elif rest and not rest.endswith(b"\n"):
            rest += b"\n"
        whole = first + b"\n" + rest
        if whole != text:
            with written_whole(path) as part:
                part.write_bytes(whole)

    @property
    def dataset(self) -> Dataset:
        """All that was recorded."""
        return Dataset(self.header, self.samples, [self.remark] if self.remark else [], self.lost, self.regrasp)

    @property
    def grasp(self) -> int:
        """Number of the grasp in which a run goes on."""
        return (self.samples[-1].grasp if self.samples else 0) + self.regrasp

    def lines(self) -> list[str]:
        """Header and samples, as they stand in the file."""
        return [header_line(self.header), *(sample_line(s) for s in self.samples)]

    def record(
        self, stamp: float, sample: Sample | None, event: str = "", lost: str = "", regrasp: bool = False
    ) -> None:
        """Write a finished sample and a remark (a limit met, a pose skipped), where there is one, to the disk.

        lost: key of the pose at which the run ends since the tool was lost, with the remark; '' otherwise.
        regrasp: the run ends, with the remark, and goes on in a new grasp.

        Raises:
            DatasetError: the sample has a value that is not finite; it is not kept.
        """
        if event:
            more = ({"lost": lost} if lost else {}) | ({"regrasp": True} if regrasp else {})
            self._write(json.dumps({"event": {"stamp": stamp, "text": event} | more}))
        self.regrasp = (self.regrasp or regrasp) and not sample
        if lost:
            self.lost.append(lost)
        if sample:
            self._write(sample_line(sample))
            self.samples.append(sample)

    def _write(self, line: str) -> None:
        if self._file is not None:
            self._file.write(line + "\n")
            self._file.flush()
            os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


def header_line(header: Header) -> str:
    """The header as one line."""
    return json.dumps(asdict(header))


def sample_line(sample: Sample) -> str:
    """A sample as one line. Raises DatasetError: a value is not finite, and no file with it could be read."""
    try:
        return json.dumps({"sample": asdict(sample)}, allow_nan=False)
    except ValueError as error:
        raise DatasetError(f"{sample.key} has a value that is not finite: {sample}") from error


def is_fresh(path: Path) -> bool:
    """Whether a run begins in this file: it is not there, or empty."""
    return not path.exists() or path.stat().st_size == 0


def read(file: str | Path) -> Dataset:
    """Header and samples from a file, a run's folder, or a bag (folder, .mcap or .db3) of the node's topic.

    Raises:
        DatasetError: not readable, another format or version, or a broken line other than the last; of a bag: without
            that topic, or with several identifications.
    """
    path = Path(file)
    if path.is_dir() and (path / "samples.jsonl").is_file():
        path /= "samples.jsonl"
    elif path.is_dir() and not (path / "metadata.yaml").is_file():
        raise DatasetError(f"{path} has neither samples.jsonl, as a run leaves it, nor metadata.yaml, as a bag has it")
    if path.is_dir() or path.suffix in (".mcap", ".db3"):
        return parse(bag_lines(path), str(path))
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
    header, samples, warnings, lost, regrasp = _header(rows[0], f"{source}:1"), {}, [], [], False
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
            regrasp = False
        elif isinstance(entry, dict) and isinstance(event := entry.get("event"), dict):
            lost += [str(event["lost"])] if "lost" in event else []
            regrasp = regrasp or "lost" in event or "regrasp" in event
    return Dataset(header, sorted(samples.values(), key=lambda s: s.stamp), warnings, lost, regrasp)


def _header(row: str, where: str) -> Header:
    try:
        data = json.loads(row)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{where}: no header in the first line ({error}): cut short, or no such file") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise DatasetError(f'{where}: the first line is no header with "format": "{FORMAT}"')
    if data.get("version") not in READABLE:
        raise DatasetError(
            f"{where}: version {data.get('version')!r}; this program reads versions {READABLE[0]} to {READABLE[-1]}: "
            "convert the file, or use the program that wrote it"
        )
    units = data.get("units", UNITS)
    for quantity, unit in UNITS.items():
        if not isinstance(units, dict) or units.get(quantity, unit) != unit:
            raise DatasetError(f"{where}: units {units!r}; {quantity} must be in {unit}: convert the file")
    return Header(**(_values(data, Header, where) | {"units": dict(UNITS)}))


def _sample(data: Any, where: str) -> Sample:
    if not isinstance(data, dict):
        raise DatasetError(f"{where}: a sample must be a mapping")
    missing = [n for n in ("name", "kind", "grip", "stamp", "wrench") if n not in data]
    if missing or not (data.get("kinematic") or data.get("estimator")):
        raise DatasetError(f"{where}: the sample lacks {', '.join(missing) or 'a pose (kinematic or estimator)'}")
    values = {"kinematic": None} | _values(data, Sample, where)
    (values["stamp"],) = _numbers([values["stamp"]], 1, f"{where}: stamp")
    via = values.get("via", ())
    if not isinstance(via, list | tuple):
        raise DatasetError(f"{where}: via = {via!r} must be a list")
    values["via"] = tuple(_numbers(v, 6, f"{where}: via") for v in via)
    try:
        values["membrane"] = tuple(from_json(entry) for entry in values.get("membrane") or ())
    except (TypeError, ValueError) as error:
        raise DatasetError(f"{where}: {error}") from error
    if not isinstance(values["grip"], int) or values["grip"] < 0:
        raise DatasetError(f"{where}: grip = {values['grip']!r} must be a whole number from 0")
    return Sample(**values)


def _values(data: dict[str, Any], cls: type, where: str) -> dict[str, Any]:
    """The fields of a dataclass that stand in data, its vectors checked; keys that it does not know are left out."""
    out = {}
    for f in fields(cls):
        if f.name not in data or (data[f.name] is None and f.metadata.get("nullable")):
            continue
        value, name = data[f.name], f"{where}: {f.name}"
        if "size" in f.metadata:
            value = _numbers(value, f.metadata["size"], name)
        elif isinstance(f.default, int | float) and not isinstance(f.default, bool):
            (number,) = _numbers([value], 1, name)
            value = int(number) if isinstance(f.default, int) else number
        elif f.type in (str, "str") and not isinstance(value, str):
            raise DatasetError(f"{name} = {value!r} must be a text")
        elif f.type in (bool, "bool") and not isinstance(value, bool):
            raise DatasetError(f"{name} = {value!r} must be true or false")
        out[f.name] = value
    return out


def _numbers(values: Any, size: int | None, name: str) -> tuple[float, ...]:
    good = isinstance(values, list | tuple) and all(
        isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < LARGE for v in values
    )
    if not good or (size is not None and len(values) != size):
        raise DatasetError(f"{name} = {values!r} must be {size or 'some'} finite numbers")
    return tuple(float(v) for v in values)

# SPDX-License-Identifier: Apache-2.0
"""The recorder of an identification: keeps its samples, and writes each through to a file as it comes."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import IO

from seed_sysid.data.dataset import Dataset, DatasetError, Header, Sample, header_line, read, sample_line


class Recorder:
    """Appends to a file of samples; continues one that the same run began."""

    def __init__(self, path: Path | None, header: Header) -> None:
        """Open path; `samples` and `header` are then what the file has. None keeps the samples in memory alone.

        Raises:
            DatasetError: the file belongs to another run, or is no file of samples.
        """
        self.header, self.samples = header, list[Sample]()
        self._file: IO[str] | None = None
        if path is None:
            return
        fresh = not path.exists() or path.stat().st_size == 0
        if not fresh:
            self._continue(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("a", encoding="utf-8")
        if fresh:
            self._write(header_line(header))

    def _continue(self, path: Path) -> None:
        old = read(path)
        if old.header.run != self.header.run:
            raise DatasetError(
                f"{path} belongs to the run '{old.header.run}', not to '{self.header.run}': choose another --out, "
                "or move the file away; it was left as it is"
            )
        self.samples, self.header = old.samples, old.header
        text = path.read_bytes()
        if not text.endswith(b"\n"):  # the line that a crash cut short
            with path.open("r+b") as file:
                file.truncate(text.rfind(b"\n") + 1)

    @property
    def dataset(self) -> Dataset:
        """All that was recorded."""
        return Dataset(self.header, self.samples)

    def lines(self) -> list[str]:
        """Header and samples, as they stand in the file."""
        return [header_line(self.header), *(sample_line(s) for s in self.samples)]

    def record(self, stamp: float, sample: Sample | None, event: str = "") -> None:
        """Write a finished sample and a remark (a limit met, a pose skipped), where there is one, to the disk."""
        if event:
            self._write(json.dumps({"event": {"stamp": stamp, "text": event}}))
        if sample:
            self.samples.append(sample)
            self._write(sample_line(sample))

    def _write(self, line: str) -> None:
        if self._file is not None:
            self._file.write(line + "\n")
            self._file.flush()
            os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

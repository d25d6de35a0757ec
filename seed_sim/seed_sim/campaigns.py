# SPDX-License-Identifier: Apache-2.0
"""What campaigns of many runs share: a file with a line of JSON for each, from which they go on, and their figures."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from seed_core.errors import SeedError

T = TypeVar("T")


def kept_runs(file: Path | None, read: Callable[[dict[str, Any]], T], what: str, instead: str = "file") -> list[T]:
    """What the file holds, of each line what `read` makes of it; nothing without a file, or where there is none yet.

    A last line that an interrupt cut off is left out, and taken out of the file. A folder that is missing is made.

    Args:
        file: of the runs.
        read: a run of its plain data.
        what: a line of the file is, in words.
        instead: what to name when it is not.

    Raises:
        SeedError: a line is none of such a run; the file is left as it is.
        OSError: the folder cannot be made, or the file not be read.
    """
    if file is None:
        return []
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        return []
    text = file.read_bytes()
    end = text.rfind(b"\n") + 1
    cut_off = text[end:]
    lines, runs = text[:end].splitlines(), []
    if cut_off and not cut_off.startswith(b"{"):
        lines.append(cut_off)  # of something else
    for number, line in enumerate(lines, start=1):
        try:
            runs.append(read(json.loads(line)))
        except (ValueError, KeyError, TypeError) as error:
            raise SeedError(f"{file}:{number}: not {what} ({error}): name another {instead}") from error
    if cut_off:
        file.write_bytes(text[:end])
    return runs


def keep_run(file: Path | None, line: str) -> None:
    """One more run in the file as a line of JSON, there at once, whatever ends the campaign; None: it is not kept."""
    if file is not None:
        with file.open("a", encoding="utf-8") as out:
            out.write(line + "\n")


def spread(values: Sequence[float]) -> dict[str, float]:
    """median, p90 and worst."""
    return {
        "median": float(np.median(values)),
        "p90": float(np.percentile(values, 90)),
        "worst": float(np.max(values)),
    }

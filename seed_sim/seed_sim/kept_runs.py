# SPDX-License-Identifier: Apache-2.0
"""Files that keep the runs of a campaign, a line of JSON each, so that an interrupted one goes on from there."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from seed_core.errors import SeedError

T = TypeVar("T")


def kept_runs(file: Path, read: Callable[[dict[str, Any]], T], what: str, instead: str = "file") -> list[T]:
    """What the file holds, of each line what `read` makes of it; nothing where there is no file yet.

    A last line that an interrupt cut off is left out, and taken out of the file.

    Args:
        file: of the runs.
        read: a run of its plain data.
        what: a line of the file is, in words.
        instead: what to name when it is not.

    Raises:
        SeedError: a line is none of such a run; the file is left as it is.
    """
    if not file.exists():
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

# SPDX-License-Identifier: Apache-2.0
"""What a mistyped name may have been meant for; standard library only, for tools/bootstrap asks it, too."""

import difflib
from collections.abc import Iterable
from pathlib import Path


def nearest(name: str, known: Iterable[str], like: float = 0.6) -> str:
    """The known name that is most like `name`; '' where none is alike by `like` of 1."""
    return next(iter(difflib.get_close_matches(name, list(known), 1, like)), "")


def did_you_mean(name: str, known: Iterable[str], before: str = "") -> str:
    """'; did you mean X?', to end a refusal with; '' where nothing is alike. before: stands in front of X."""
    near = nearest(name, known)
    return f"; did you mean {before}{near}?" if near else ""


def no_such_file(file: Path) -> str:
    """'no such file in FOLDER; there is X', X being the file there of a like name; or that it is there and no file."""
    folder = file.parent.absolute()
    try:
        if file.exists() and not file.is_file():
            return f"{file.absolute()} is a {'folder' if file.is_dir() else 'pipe or a device'}, not a file"
        there = [f.stem for f in sorted(folder.iterdir()) if f.suffix == file.suffix]
    except (OSError, ValueError):  # also for a name that no folder can have
        return f"there is no folder {folder!s:.200}"
    near = nearest(file.stem, there)
    return f"no such file in {folder}" + (f"; there is {near}{file.suffix}" if near else "")

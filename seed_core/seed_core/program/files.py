# SPDX-License-Identifier: Apache-2.0
"""Files that are installed beside a package's code (configuration, tasks, scenarios), and such as are written whole."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import EEXIST
from importlib.util import find_spec
from pathlib import Path

from seed_core.errors import SeedError


def shared_path(package: str, relative: str) -> Path:
    """A file or folder of a package: in its source tree, or in the share folder of where it is installed.

    Args:
        package: import name, which is also the name of the ROS package.
        relative: path below the package's root, such as "config/tasks".

    Raises:
        SeedError: the package is not installed, or lacks the file.
    """
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise SeedError(f"the package {package} is not installed: build the workspace again")
    code = Path(spec.origin).resolve().parent
    for base in (code.parent, *(parent / "share" / package for parent in code.parents)):
        if (base / relative).exists():
            return base / relative
    raise SeedError(f"{package}/{relative} is not installed: build the workspace again")


@contextmanager
def named_in_errors(path: str | Path) -> Iterator[None]:
    """Errors of the system in the block that name no file, as of a full disk, name this one."""
    try:
        yield
    except OSError as error:
        if error.errno and not error.filename:
            error.filename = str(path)
        raise


@contextmanager
def written_whole(path: str | Path) -> Iterator[Path]:
    """The file to write in the block, `path` with .part at its end. It takes the place of `path` when the block ends.

    After an error `path` is as it was, and the other file is gone. Where `path` is a link, what it leads to is written.

    Raises:
        OSError: it cannot be written, or `path` is a folder or a device; with its name, also where the disk is full.
    """
    target = Path(os.path.realpath(path)) if os.path.islink(path) else Path(path)
    if target.exists() and not target.is_file():
        raise FileExistsError(EEXIST, "is a folder or a device: name a file", str(target))
    part = target.with_name(target.name + ".part")
    try:
        with named_in_errors(path):
            yield part
            with part.open("rb") as file:  # on the disk before the old one goes
                os.fsync(file.fileno())
            part.replace(target)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise


def write_text(path: str | Path, text: str) -> None:
    """Write a text file in UTF-8, whole or not at all. Raises OSError."""
    with written_whole(path) as part:
        part.write_text(text, encoding="utf-8")

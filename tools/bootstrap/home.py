# SPDX-License-Identifier: Apache-2.0
"""The folder of environments and builds, outside every checkout, and the locks on them."""

import fcntl
import hashlib
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from progress import SetupError, UsageError, say


def seed_home() -> Path:
    """SEED_HOME, else the user's cache; a writable folder without white space (shebangs and CMake need that)."""
    wanted = os.environ.get("SEED_HOME")
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    name = f"seed-ros2-{os.geteuid()}"
    places = [Path(cache, "seed-ros2"), Path("/var/tmp", name), Path(tempfile.gettempdir(), name)]
    for home in (place.absolute() for place in ([Path(wanted)] if wanted else places)):
        problem = _problem(home)
        if not problem:
            return home
        say(f"cannot keep the environment in {home}: {problem}")
    if wanted:
        raise UsageError("set SEED_HOME to a writable folder without white space in its path")
    raise SetupError("found no place for the environment; set SEED_HOME to a writable folder with 3 GB free")


def _problem(home: Path) -> str:
    """Why a folder will not do, or nothing."""
    if any(c.isspace() or c in ";:\"'$" for c in str(home)):
        return "white space or special characters in the path, which CMake and script headers cannot take"
    return why_not_writable(home) or ("" if home.stat().st_uid == os.geteuid() else "it belongs to somebody else")


def why_not_writable(folder: Path) -> str:
    """Why a folder cannot be made or written to; nothing if it can."""
    try:
        folder = folder.expanduser()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except (OSError, RuntimeError) as error:  # RuntimeError: nobody has a home here
        return getattr(error, "strerror", None) or str(error)


@contextmanager
def locked(path: Path, what: str) -> Iterator[int]:
    """Hold the lock file while the block runs; yields its descriptor, which children may hold too."""
    with path.open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say(f"another ./seed is at work on {what}; waiting for it")
            fcntl.flock(file, fcntl.LOCK_EX)
        yield file.fileno()


def digest(parts: Iterable[bytes]) -> str:
    """A short hash over parts; a part's end counts too."""
    total = hashlib.sha256()
    for part in parts:
        total.update(len(part).to_bytes(8, "little") + part)
    return total.hexdigest()[:12]

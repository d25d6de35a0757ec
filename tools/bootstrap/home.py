# SPDX-License-Identifier: Apache-2.0
"""Where environments and builds are kept, outside every checkout, and the locks on them."""

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
    fallback = Path(tempfile.gettempdir()) / f"seed-ros2-{os.geteuid()}"
    for home in (
        [Path(wanted).absolute()]
        if wanted
        else [Path(cache).absolute() / "seed-ros2", Path("/var") / fallback.relative_to("/"), fallback]
    ):
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
    try:
        home.mkdir(mode=0o700, parents=True, exist_ok=True)
        if home.stat().st_uid != os.geteuid():
            return "it belongs to somebody else"
        with tempfile.TemporaryFile(dir=home):
            return ""
    except OSError as error:
        return error.strerror or str(error)


def can_make(folder: str) -> bool:
    """Whether a folder below the user's home exists or could be made."""
    try:
        Path(folder).expanduser().mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=Path(folder).expanduser()):
            return True
    except (OSError, RuntimeError):
        return False


@contextmanager
def locked(path: Path, what: str) -> Iterator[int]:
    """Hold the lock file while the block runs; yields its descriptor, which children may hold too."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say(f"another ./seed is at work on {what}; waiting for it")
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield descriptor
    finally:
        os.close(descriptor)


def digest(parts: Iterable[bytes]) -> str:
    """A short hash over parts; a part's end counts too."""
    total = hashlib.sha256()
    for part in parts:
        total.update(len(part).to_bytes(8, "little") + part)
    return total.hexdigest()[:12]

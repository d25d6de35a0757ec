# SPDX-License-Identifier: Apache-2.0
"""A ROS domain for each cell on this machine, so that none hears another.

A running cell holds a lock on a file named after its domain, which says what runs; the lock ends with the process.
A second one that is wanted in that domain, in a namespace of its own, holds one on DOMAIN.1, and so on.
Every user has a folder of such files. Commands look for cells in their user's; a new cell keeps clear of all of them.
"""

import fcntl
import itertools
import math
import os
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from seed_core.errors import FailedError

VARIABLE = "ROS_DOMAIN_ID"
FOLDERS = "seed-domains-"
LAST = 101  # above it, DDS ports meet the ephemeral ones of Linux
OWN = range(1, LAST + 1)  # of those who want to be alone
SHARED = range(LAST + 1)  # of a cell that others are to find: 0, which is ROS's default, while it is free


def folder() -> Path:
    """Where this user's locks are."""
    place = Path(tempfile.gettempdir()) / f"{FOLDERS}{os.getuid()}"
    place.mkdir(exist_ok=True)
    return place


@contextmanager
def claimed(candidates: Iterable[int], who: str) -> Iterator[int]:
    """A domain that no other cell of this machine has, set in this process's environment.

    One that the environment names already is taken as it is, for whoever named it wants it so.

    Args:
        candidates: the domains, in the order of preference.
        who: what is written beside the lock.

    Raises:
        FailedError: none is free.
    """
    named = os.environ.get(VARIABLE, "")
    wanted = [int(named)] if named.isdigit() else candidates
    for domain in wanted:
        lock = _lock_beside(domain, who) if named else _lock(str(domain), who)
        if not named and (lock is None or _elsewhere(domain)):
            if lock is not None:
                lock.close()
            continue
        os.environ[VARIABLE] = str(domain)
        try:
            yield domain
        finally:
            if lock is not None:
                lock.truncate(0)
                lock.close()
            if not named:
                os.environ.pop(VARIABLE, None)
        return
    raise FailedError(f"no ROS domain is free: {LAST + 1} cells run on this machine, see {folder()}")


def _lock_beside(domain: int, who: str) -> IO[str] | None:
    """Of a cell that may not be the first in its domain; None where a test has that, of which nobody is to know."""
    if (lock := _lock(str(domain), who)) is not None or domain not in running():
        return lock
    return next(lock for i in itertools.count(1) if (lock := _lock(f"{domain}.{i}", who)) is not None)


def _lock(name: str, who: str) -> IO[str] | None:
    lock = (folder() / name).open("a+")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.close()
        return None
    os.set_inheritable(lock.fileno(), True)  # by a program that takes this one's place; started ones do not get it
    lock.truncate(0)
    lock.write(who)
    lock.flush()
    return lock


def _elsewhere(domain: int) -> bool:
    """Whether a cell of another user of this machine has a domain, or one of this user whose first has ended."""
    first = folder() / str(domain)
    places = {first.parent, *first.parent.parent.glob(f"{FOLDERS}*")}
    files = [place / str(domain) for place in places] + [f for place in places for f in place.glob(f"{domain}.*")]
    return any(_held(file) is not None for file in files if file != first)


def _held(file: Path) -> str | None:
    """What a cell that holds a lock on a file wrote into it; None where nobody does, or it is not for us to read."""
    try:
        with file.open() as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                return lock.read().strip()
    except OSError:
        pass
    return None


def age(domain: int) -> float:
    """How long ago [s] the newest cell in a domain was launched; infinite where none of this user runs."""
    try:  # it wrote its name then
        return max(time.time() - max(f.stat().st_mtime for f, _ in _of_user().get(domain, ())), 0.0)
    except (OSError, ValueError):
        return math.inf


def running() -> dict[int, list[str]]:
    """The domains with cells of this user in them, and what these are."""
    return {domain: [who for _, who in cells] for domain, cells in _of_user().items()}


def _of_user() -> dict[int, list[tuple[Path, str]]]:
    found: dict[int, list[tuple[Path, str]]] = {}
    for file in sorted(folder().iterdir()):
        if who := _held(file):  # tests take a domain without a word
            found.setdefault(int(file.name.partition(".")[0]), []).append((file, who))
    return found

# SPDX-License-Identifier: Apache-2.0
"""A ROS domain for each cell on this machine, so that none hears another.

A running cell holds a lock on a file named after its domain, which says what runs; the lock ends with the process.
Every user has a folder of such files. Commands look for cells in their user's; a new cell keeps clear of all of them.
"""

import fcntl
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
        lock = _lock(domain, who)
        if not named and (lock is None or _of_others(domain)):
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


def _lock(domain: int, who: str) -> IO[str] | None:
    lock = (folder() / str(domain)).open("a+")
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


def _of_others(domain: int) -> bool:
    """Whether a cell of another user of this machine has a domain."""
    mine = folder()
    for place in mine.parent.glob(f"{FOLDERS}*"):
        if place == mine:
            continue
        try:
            with (place / str(domain)).open() as lock:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:  # there is none, or it is not for us to read
            continue
    return False


def age(domain: int) -> float:
    """How long ago [s] the cell that runs in a domain was launched; infinite where none of this user does."""
    if domain not in running():
        return math.inf
    try:
        return max(time.time() - (folder() / str(domain)).stat().st_mtime, 0.0)  # it wrote its name then
    except OSError:
        return math.inf


def running() -> dict[int, str]:
    """The domains with a cell in them, and what it is."""
    found = {}
    for file in sorted(folder().iterdir()):
        with file.open() as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                found[int(file.name)] = lock.read().strip()
    return {domain: who for domain, who in found.items() if who}  # tests take a domain without a word

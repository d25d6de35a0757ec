# SPDX-License-Identifier: Apache-2.0
"""What the system tells of a process: memory, open files, threads, children."""

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

MB = 1024.0  # [kB], which /proc counts in


class Usage(NamedTuple):
    """Of one process."""

    rss: float  # [MB] of memory that is its own, without what it shares with others
    files: int
    threads: int


def usage(pid: int) -> Usage | None:
    """What a process holds now; None when it has ended."""
    folder = Path(f"/proc/{pid}")
    try:
        lines = (line.split() for line in (folder / "status").read_text().splitlines())
        status = {words[0]: int(words[1]) for words in lines if len(words) > 1 and words[1].isdigit()}
        return Usage(status["RssAnon:"] / MB, len(os.listdir(folder / "fd")), status["Threads:"])
    except (OSError, KeyError):
        return None


def cpu_time(pid: int) -> float:
    """[s] of processor time that a process has used; nan when it has ended."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return math.nan
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def named(nodes: Mapping[int, str]) -> dict[str, int]:
    """Processes below this one by name: a node's own, `node/servo` of the driver, `recorder`.

    nodes: names of the nodes by their process numbers.
    """
    parents = _parents()
    found: dict[str, int] = {}
    for pid, parent in parents.items():
        if pid in nodes:
            found[nodes[pid]] = pid
        elif (words := _command(pid)) and _below(pid, os.getpid(), parents):
            if "seed_driver.servo" in words and parent in nodes:
                found[f"{nodes[parent]}/servo"] = pid
            elif "record" in words:
                found["recorder"] = pid
    return found


def descendants(pid: int) -> set[int]:
    """Every process below one."""
    parents = _parents()
    return {p for p in parents if p != pid and _below(p, pid, parents)}


def _parents() -> dict[int, int]:
    """Parent of every process."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    return parents


def _below(pid: int, ancestor: int, parents: Mapping[int, int]) -> bool:
    while pid and pid != ancestor:
        pid = parents.get(pid, 0)
    return pid == ancestor


def _command(pid: int) -> list[str]:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text().split("\0")
    except OSError:
        return []

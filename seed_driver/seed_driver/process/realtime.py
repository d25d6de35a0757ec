# SPDX-License-Identifier: Apache-2.0
"""Scheduling of the servo process, as far as the system allows it."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from seed_driver.config import DriverConfig

HASTE = -15  # niceness
_PR_SET_PDEATHSIG = 1
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4


def die_with_parent() -> None:
    """The kernel kills this process when its parent ends; only the parent decides about an interrupt."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def no_collector() -> None:
    """No pauses for garbage: the loop makes none in cycles."""
    gc.freeze()
    gc.disable()


def stay_in_memory() -> None:
    """No pauses for pages that the system has taken away, when it lets us keep them."""
    ctypes.CDLL(None).mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT)


def hasten(pid: int) -> None:
    """Have a process start before ordinary ones, when the system allows it: a robot without one holds."""
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, pid, HASTE)


def realtime(config: DriverConfig) -> None:
    """Real-time priority and one processor, when the system allows it; timing is measured, whether or not it does."""
    if config.cpu >= 0:
        with suppress(OSError):
            os.sched_setaffinity(0, {config.cpu})
    if config.realtime_priority > 0:
        _prioritize(config.realtime_priority)


def _prioritize(priority: int) -> None:
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))


@contextmanager
def threads_above(config: DriverConfig) -> Iterator[None]:
    """Threads made in the block get a higher priority than ours: ur_rtde spins until they have received something."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    if config.realtime_priority > 0:
        _prioritize(config.realtime_priority + 1)
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


def silence() -> None:
    """ur_rtde prints a line per failed call: nothing is printed, unless SEED_DRIVER_DEBUG is set."""
    if not os.environ.get("SEED_DRIVER_DEBUG"):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)

# SPDX-License-Identifier: Apache-2.0
"""Scheduling of the servo process, as far as the system allows it; its timing is measured, whether or not it does."""

import ctypes
import gc
import os
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from seed_driver.config import DriverConfig

NICENESS = -15
_PR_SET_PDEATHSIG = 1
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4


def die_with_parent() -> None:
    """The kernel kills this process when its parent ends; only the parent decides about an interrupt."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def raise_niceness(pid: int) -> None:
    """Have a process start before ordinary ones: a robot without one holds."""
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, pid, NICENESS)


def become_realtime(config: DriverConfig) -> None:
    """No pauses for garbage or swapped pages; real-time priority and one processor, if configured and allowed."""
    gc.freeze()
    gc.disable()  # the loop makes no garbage in cycles
    ctypes.CDLL(None).mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT)
    if config.cpu >= 0:
        with suppress(OSError):
            os.sched_setaffinity(0, {config.cpu})
    if config.realtime_priority > 0:
        take_priority(config.realtime_priority)


def take_priority(priority: int) -> None:
    """SCHED_FIFO at this priority, or as near below as leaves one above it to `threads_above`.

    A user without CAP_SYS_NICE gets no more than RLIMIT_RTPRIO, and no thread above it (man 7 sched).
    """
    if not _prioritize(priority + 1):
        priority = min(priority, resource.getrlimit(resource.RLIMIT_RTPRIO)[0] - 1)
    if priority > 0:
        _prioritize(priority)


def _prioritize(priority: int) -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        return False
    return True


@contextmanager
def threads_above(config: DriverConfig) -> Iterator[None]:
    """Threads made in the block get a higher priority than ours: ur_rtde spins until they have received something."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    if config.realtime_priority > 0:
        _prioritize((before[1].sched_priority or config.realtime_priority) + 1)
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)

# SPDX-License-Identifier: Apache-2.0
"""Work that takes long, on several cores, and what is seen of it: a bar, or without a terminal a line now and then."""

import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from multiprocessing import resource_tracker
from typing import Any, TypeVar

from joblib import Parallel
from tqdm import tqdm

T = TypeVar("T")
EVERY = 10.0  # [s] between two lines
# joblib's process that takes away what others leave behind tells so, on whatever Ctrl-C cuts short
_QUIET = "ignore::UserWarning:joblib.externals.loky.backend.resource_tracker"

Progress = Callable[[float, str], None]  # share of a stretch of work, and what is done; a smaller share: the next one


def in_parallel(calls: Sequence[Any], jobs: int, unit: str, ordered: bool = True) -> Iterator[Any]:
    """What joblib's delayed calls give, made by so many processes or by joblib's active back end, counted as `unit`.

    ordered: in the order of the calls; else as they end.
    """
    pool = Parallel(n_jobs=jobs, return_as="generator" if ordered else "generator_unordered")
    with _deaf_processes() if jobs != 1 else nullcontext():
        results = pool(calls)
    yield from counted(results, len(calls), unit)


@contextmanager
def _deaf_processes() -> Iterator[None]:
    """Those that are started meanwhile do not hear Ctrl-C, and tell nothing of it: this one does, and ends them."""
    resource_tracker.ensure_running()  # here, for on Python 3.11 it takes away the mask of whoever starts it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    sys.warnoptions.append(_QUIET)  # an argument of Python processes that are started
    try:
        yield
    finally:
        sys.warnoptions.remove(_QUIET)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def counted(work: Iterable[T], total: int, unit: str) -> Iterator[T]:
    """The same items; on stderr a bar with the time left, or without a terminal a line every ten seconds."""
    if sys.stderr.isatty():
        yield from tqdm(work, total=total, unit=unit)
        return
    began = told = time.monotonic()
    for done, item in enumerate(work, start=1):
        now = time.monotonic()
        if now - told >= EVERY and done < total:
            told, left = now, (now - began) / done * (total - done)
            print(f"{done} of {total} {unit}s, about {left:.0f} s left", file=sys.stderr, flush=True)
        yield item


@contextmanager
def progress_bar(name: str = "", *, shown: bool = True, leave: bool | None = None) -> Iterator[Progress]:
    """A bar on stderr; yields what moves it.

    Args:
        name: what stands before it.
        shown: on a terminal; never elsewhere.
        leave: it stays when the work is done; default: one with a name does.
    """
    looks = "{l_bar}{bar}| {remaining} left{postfix}"
    leave = bool(name) if leave is None else leave
    with tqdm(total=100, desc=name, bar_format=looks, leave=leave, disable=None if shown else True) as bar:

        def move(share: float, phase: str) -> None:
            done = round(100 * share)
            if done == 0 or done < bar.n:
                bar.reset()  # a new stretch: the time left is its own
            bar.n = done
            bar.set_postfix_str(phase)

        yield move

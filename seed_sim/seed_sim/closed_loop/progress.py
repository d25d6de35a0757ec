# SPDX-License-Identifier: Apache-2.0
"""What is seen of work that takes long: a bar on the terminal, or a line now and then where there is none."""

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from tqdm import tqdm

T = TypeVar("T")
EVERY = 10.0  # [s] between two lines

Progress = Callable[[float, str], None]  # share of the task, name of its phase


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
def progress_bar(name: str = "") -> Iterator[Progress]:
    """A bar on stderr, nothing where that is no terminal; yields what moves it. One with a name stays."""
    with tqdm(total=100, desc=name, bar_format="{l_bar}{bar}| {postfix}", leave=bool(name), disable=None) as bar:

        def move(share: float, phase: str) -> None:
            bar.n = round(100 * share)
            bar.set_postfix_str(phase)

        yield move

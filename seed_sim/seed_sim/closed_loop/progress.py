# SPDX-License-Identifier: Apache-2.0
"""A bar on the terminal while a task is played."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

Progress = Callable[[float, str], None]  # share of the task, name of its phase


@contextmanager
def progress_bar(name: str = "") -> Iterator[Progress]:
    """A bar on stderr, nothing where that is no terminal; yields what moves it. One with a name stays."""
    with tqdm(total=100, desc=name, bar_format="{l_bar}{bar}| {postfix}", leave=bool(name), disable=None) as bar:

        def move(share: float, phase: str) -> None:
            bar.n = round(100 * share)
            bar.set_postfix_str(phase)

        yield move

# SPDX-License-Identifier: Apache-2.0
"""The baselines of a run, in processes of their own at low priority."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any, NamedTuple

from seed_bringup.demo.score import Curve, curve_of

if TYPE_CHECKING:
    from multiprocessing.pool import AsyncResult


class Baseline(NamedTuple):
    """Score and curve of one simulated run."""

    score: dict[str, Any]
    curve: Curve


def run_baseline(law: str, task: str, force: float | None, seed: int, scenario: str) -> Baseline:
    """One headless run."""
    from seed_sim import evaluate  # takes a second, which is not the parent's

    done = evaluate(task, law=law, force=force, seed=seed, scenario=scenario)
    return Baseline(done.result, curve_of(done.recording))


@contextmanager
def running_baselines(laws: tuple[str, ...], *arguments: Any) -> Iterator[dict[str, AsyncResult[Baseline]]]:
    """Results to come, by law; the processes end with the block, and Ctrl-C is the parent's alone."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # which the processes inherit
    try:
        pool = get_context("spawn").Pool(len(laws), initializer=os.nice, initargs=(5,))
    finally:
        signal.signal(signal.SIGINT, before)
    with pool:
        yield {law: pool.apply_async(run_baseline, (law, *arguments)) for law in laws}

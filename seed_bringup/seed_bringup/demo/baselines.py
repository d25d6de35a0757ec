# SPDX-License-Identifier: Apache-2.0
"""The baselines of a run, in processes of their own at low priority."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import TimeoutError as LateError
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any, NamedTuple

from seed_bringup.demo.score import Curve, curve_of
from seed_bringup.demo.terminal import say

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


def finished(running: dict[str, AsyncResult[Baseline]], patience: float) -> dict[str, Baseline]:
    """What came of them; one that fails, or is not there within another `patience` [s], is left out, and that is said.

    A run that is over is not given away for want of a comparison.
    """
    done: dict[str, Baseline] = {}
    for law, result in running.items():
        try:
            done[law] = result.get(timeout=patience)
        except LateError:
            say(f"no baseline {law.replace('_', ' ')}: it took longer than {patience:g} s")
        except Exception as error:  # membranes may give way to it, and another process raises what it likes
            say(f"no baseline {law.replace('_', ' ')}: {error}")
    return done


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

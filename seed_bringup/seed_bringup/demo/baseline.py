# SPDX-License-Identifier: Apache-2.0
"""The baselines of a run, in processes of their own at low priority."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any

import numpy as np

from seed_bringup.demo.series import Array

if TYPE_CHECKING:
    from multiprocessing.pool import AsyncResult


@dataclass(frozen=True, eq=False)
class Baseline:
    """Score, and time [s], force (n,) [N] along the table's normal and torque (n,) [N m] about T's x."""

    score: dict[str, Any]
    t: Array
    force: Array
    torque: Array


def run_baseline(law: str, task: str, force: float | None, seed: int, scenario: str) -> Baseline:
    """One headless run."""
    from seed_sim.closed_loop.evaluate import run

    done = run(task, law=law, force=force, seed=seed, scenario=scenario)
    recording = done.run.recording
    return Baseline(done.result, np.array(recording["t"]), -recording["force"][:, 2], recording["torque_T"][:, 0])


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

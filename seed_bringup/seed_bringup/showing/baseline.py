# SPDX-License-Identifier: Apache-2.0
"""The baselines of a run, in processes of their own at low priority."""

from __future__ import annotations

import os
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np

from seed_bringup.showing.series import Array


@dataclass(frozen=True, eq=False)
class Baseline:
    """Score, and time [s], force (n,) [N] along the table's normal and torque (n,) [N m] about T's x."""

    score: dict[str, Any]
    t: Array
    force: Array
    torque: Array


def run_baseline(law: str, task: str, force: float | None, seed: int, scenario: str) -> Baseline:
    """One headless run."""
    from seed_sim.evaluate import run

    done = run(task, law=law, force=force, seed=seed, scenario=scenario)
    recording = done.run.recording
    return Baseline(done.result, np.array(recording["t"]), -recording["force"][:, 2], recording["torque_T"][:, 0])


def start_baselines(laws: tuple[str, ...], *arguments: Any) -> tuple[ProcessPoolExecutor, dict[str, Future[Baseline]]]:
    """Futures by law, and the pool to shut down."""
    pool = ProcessPoolExecutor(len(laws), mp_context=get_context("spawn"), initializer=os.nice, initargs=(5,))
    return pool, {law: pool.submit(run_baseline, law, *arguments) for law in laws}

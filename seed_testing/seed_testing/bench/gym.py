# SPDX-License-Identifier: Apache-2.0
"""Steps a second of the Gymnasium environment, by estimator: CPU time of this process on one core."""

import time
from typing import Any

import cv2
import gymnasium

import seed_sim.learning  # noqa: F401  registers the environments
from seed_sim.learning.wipe import action_of

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "truth": ("seed/Wipe-v0", {"estimator": "truth"}),
    "noisy": ("seed/Wipe-v0", {}),
    "hidden": ("seed/WipeHidden-v0", {}),
    "images": ("seed/WipeImages-v0", {}),
}


def run(steps: int = 100) -> dict[str, object]:
    """One episode of each case, pressing and dragging; a step is 0.04 s of the cell."""
    cv2.setNumThreads(1)
    gymnasium.make("seed/Wipe-v0").reset(seed=0)  # what is loaded once is no part of it
    return {name: _case(environment, given, steps) for name, (environment, given) in CASES.items()}


def _case(environment: str, given: dict[str, Any], steps: int) -> dict[str, float]:
    env = gymnasium.make(environment, **given)
    began = time.process_time()
    env.reset(seed=0)
    reset, done = time.process_time() - began, 0
    began = time.process_time()
    for i in range(steps):
        _, _, terminated, truncated, _ = env.step(action_of(force=10.0, velocity=(0.04 if i > 45 else 0.0, 0.0, 0.0)))
        done += 1
        if terminated or truncated:
            break
    rate = done / (time.process_time() - began)
    return {"reset_s": reset, "steps_per_s": rate, "times_real_time": rate / env.metadata["render_fps"]}

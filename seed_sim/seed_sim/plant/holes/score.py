# SPDX-License-Identifier: Apache-2.0
"""The score of a run whose tool is put into a hole: how deep, how long, and what was borne, all of the plant."""

from typing import Any

import numpy as np

from seed_control.tasks import Task
from seed_sim.closed_loop.recording import Recording
from seed_sim.plant.plant import Plant

TOLERANCE = 1e-3  # [m] by which the true depth may miss the wanted one


def insertion_of(plant: Plant, recording: Recording, task: Task) -> dict[str, Any] | None:
    """Success, depth [mm], times [s] from the first contact on, forces [N]; None without hole or insertion.

    largest_force: the largest net force of the tool on the environment at any step of the plant, pulling out included.
    squeeze: the largest sum of what all points of contact bear, each by itself.
    """
    wanted = next((p.insert.depth for p in task.phases if p.insert is not None), None)
    hole = plant.hole
    if hole is None or wanted is None:
        return None
    phase, t, began = recording["phase"], recording["t"], recording.contact_time

    def end_of(kind: str) -> float | None:
        """[s] from contact to the end of the last phase of this kind that was played."""
        played = [i for i, p in enumerate(task.phases) if getattr(p, kind) is not None and (phase == i).any()]
        return float(t[phase == played[-1]][-1] - began) if played and began is not None else None

    return {
        "success": recording.finished and hole.deepest > wanted - TOLERANCE,
        "depth_mm": 1e3 * hole.deepest,
        "found": end_of("search"),
        "inserted": end_of("insert"),
        "largest_force": hole.largest,
        "squeeze": hole.squeeze,
        "friction": hole.friction,
        "away_mm": float(1e3 * np.linalg.norm(hole.X_WH[:3, 3] - plant.surface.X_WS[:3, 3])),
        "tilt_deg": float(np.rad2deg(np.arccos(min(hole.X_WH[2, 2], 1.0)))),
    }

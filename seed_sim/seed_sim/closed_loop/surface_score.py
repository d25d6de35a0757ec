# SPDX-License-Identifier: Apache-2.0
"""The score of a task along a surface: its force along the true normal, and the normal that it found."""

from typing import Any

import numpy as np

from seed_control.tasks import Task
from seed_sim.closed_loop.recording import Recording, rms


def surface_score(recording: Recording, task: Task) -> dict[str, Any] | None:
    """Along the true normal, over the last phase along the surface that controls force.

    Returns:
        Rms [N] of the force along the normal against the wanted one, with its mean; rms and worst [deg] of the normal
        found; the largest force over the wanted one, of the whole run; None for other tasks. A run that does not reach
        the last of these phases has the whole wanted force and 90 degrees as its errors.
    """
    along = {p.name for p in task.phases if p.along == "surface" and p.control is not None}
    if not along:
        return None
    names = np.array([*recording.phases, ""])[recording["phase"].astype(int)]
    last = [p for p in task.phases if p.name in along][-1]
    assert last.control is not None
    keep, size = names == last.name, float(np.linalg.norm(last.control.force))
    largest = float(np.linalg.norm(recording["force"], axis=1).max(initial=0.0))
    out: dict[str, Any] = {"peak": largest / max(size, 1e-9)}
    if not keep.any():
        return out | {"force_rms": size, "force_mean": 0.0, "normal_rms_deg": 90.0, "normal_max_deg": 90.0}
    normal, found = recording["normal"][keep], recording["found_normal"][keep]
    force = -np.einsum("ij,ij->i", recording["force"][keep], normal)
    angle = np.rad2deg(np.arccos(np.clip(np.einsum("ij,ij->i", normal, found), -1.0, 1.0)))
    return out | {
        "force_rms": rms(force - size),
        "force_mean": float(force.mean()),
        "normal_rms_deg": rms(angle),
        "normal_max_deg": float(angle.max()),
    }

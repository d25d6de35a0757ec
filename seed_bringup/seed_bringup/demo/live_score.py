# SPDX-License-Identifier: Apache-2.0
"""The score of a live run, from its bag, by the same rule as the headless evaluation's."""

from __future__ import annotations

from typing import Any

import numpy as np

from seed_bringup.demo.figures import Phase
from seed_bringup.demo.series import Array, Series
from seed_control.tasks import Task
from seed_core.spatial import inverse_pose
from seed_sim.closed_loop.evaluate import scored_phase
from seed_sim.closed_loop.recording import Recording, lean_of, score, torque_axes_of

TOPICS = {
    "state": "/controller/state",
    "reference": "/controller/reference",
    "true_wrench": "/sim/ground_truth/contact_wrench",
    "true_tip": "/sim/ground_truth/tip_pose",
    "true_relative": "/sim/ground_truth/relative_pose",
    "relative_pose": "/relative_pose",
}


def recording_of(series: dict[str, Series], task: Task, X_Ttip: Array, phases: list[Phase]) -> Recording:
    """The run as the evaluation records one, a row per message of the true wrench; t counts from the first phase."""
    start, end = phases[0].start, phases[-1].end
    truth = series["true_wrench"].between(start, end)
    t = truth.t
    tips, references = _nearest(series["true_tip"], t), _nearest(series["reference"], t)
    desired = _nearest(series["state"], t)[:, :6]
    regulating = {p.name for p in task.phases if p.control is not None}
    recording = Recording([p.name for p in phases], torque_axes=torque_axes_of(task))
    of_tool = {p.name for p in phases if _in_tool_frame(task, p.name)}
    X_work, R_tipT = task.frame.pose, X_Ttip[:3, :3].T
    to_work, R_work = inverse_pose(X_work), X_work[:3, :3]
    for i, stamp in enumerate(t):
        R_T, R_ref = tips[i][:3, :3] @ R_tipT, references[i][:3, :3] @ R_tipT
        torque, force = truth.values[i][:3], truth.values[i][3:]
        phase = _phase_at(phases, stamp)
        R_task = tips[i][:3, :3] if phases[phase].name in of_tool else R_work  # that the controller's state is in
        if phases[phase].name in regulating and not desired[i].any():
            phase = -1  # the client learns of a new phase a little late
        recording.add(
            t=stamp - start, phase=phase, force=R_work.T @ force, torque=R_work.T @ torque, torque_T=R_T.T @ torque,
            wanted_force=R_work.T @ R_task @ desired[i][3:], wanted_torque_T=R_T.T @ R_task @ desired[i][:3],
            tip=(to_work @ tips[i])[:3, 3], reference=(to_work @ references[i])[:3, 3], lean=lean_of(R_ref, R_T),
            X_CT=np.eye(4),
        )  # fmt: skip
    return recording


def live_score(recording: Recording, task: Task) -> dict[str, Any]:
    """As the evaluation's result."""
    result: dict[str, Any] = score(recording, scored_phase(task))
    return result


def _in_tool_frame(task: Task, phase: str) -> bool:
    controls = {p.name: p.control for p in task.phases}
    control = controls.get(phase, task.draw.control if task.draw else None)
    return control is not None and control.frame == "tool"


def _nearest(series: Series, t: Array) -> Array:
    """The values (M, ...) whose stamps are nearest to t (M,)."""
    right = np.clip(np.searchsorted(series.t, t), 1, len(series.t) - 1)
    left = right - 1
    nearer = np.where(t - series.t[left] < series.t[right] - t, left, right)
    return np.asarray(series.values[nearer])


def _phase_at(phases: list[Phase], t: float) -> int:
    return max((i for i, p in enumerate(phases) if p.start <= t), default=0)

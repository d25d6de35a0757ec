# SPDX-License-Identifier: Apache-2.0
"""A live run from its bag, recorded as the headless evaluation records one, so that one rule scores both."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from seed_bringup.demo.series import Series
from seed_control.tasks import Task
from seed_core.spatial import Array, inverse_pose
from seed_sim.closed_loop.recording import SETTLING, Recording, counts_as, lean_of, rms, torque_axes_of

TOPICS = {
    "state": "/controller/state",
    "reference": "/controller/reference",
    "true_wrench": "/sim/ground_truth/contact_wrench",
    "true_tip": "/sim/ground_truth/tip_pose",
    "true_relative": "/sim/ground_truth/relative_pose",
    "relative_pose": "/relative_pose",
    "believed_wrench": "/wrench_estimate",
}


BAND = 2.0  # stated deviations, either way


class Phase(NamedTuple):
    """A named stretch of time [s]."""

    name: str
    start: float
    end: float


class BeliefCurves(NamedTuple):
    """Times (n,) [s] and pressing force (n,) [N]: true, believed, its stated deviation, wanted."""

    t: Array
    true: Array
    believed: Array
    deviation: Array
    wanted: Array


class Curve(NamedTuple):
    """Time (n,) [s], pressing force (n,) [N] along the table's normal and torque (n,) [N m] about T's x."""

    t: Array
    force: Array
    torque: Array


def curve_of(recording: Recording) -> Curve:
    """The curve of a run, simulated without ROS or live."""
    return Curve(recording["t"], -recording["force"][:, 2], recording["torque_T"][:, 0])


def belief_of(recording: Recording) -> BeliefCurves:
    """True and believed force of a live run."""
    force, believed, wanted = (-recording[name][:, 2] for name in ("force", "believed_force", "wanted_force"))
    return BeliefCurves(recording["t"], force, believed, recording["stated_force"][:, 2], wanted)


def scored_stretches(phases: list[Phase], name: str, contact: float) -> list[tuple[float, float]]:
    """The stretches of time [s] that the score is of: the named phases, from 2 s after first contact [s]."""
    start = contact + SETTLING
    return [(max(p.start, start), p.end) for p in phases if counts_as(p.name, name) and p.end > start]


def recording_of(series: dict[str, Series], task: Task, X_Ttip: Array, phases: list[Phase]) -> Recording:
    """A live run as a recording, a row per message of the true wrench; t counts from the first phase.

    Args:
        series: Of the topics in TOPICS, in ROS time.
        task: What was played.
        X_Ttip: (4, 4) the tip in the tool.
        phases: As the client of the task met them, in ROS time.
    """
    truth = series["true_wrench"].between(phases[0].start, phases[-1].end)
    t, torque, force = truth.t, truth.values[:, :3], truth.values[:, 3:]
    tips, references = series["true_tip"].nearest(t), series["reference"].nearest(t)
    wanted = series["state"].nearest(t)[:, :6]
    X_work = task.frame.pose
    to_work, R_work = inverse_pose(X_work), X_work[:3, :3]
    R_T, R_reference = (X[:, :3, :3] @ X_Ttip[:3, :3].T for X in (tips, references))  # of the tool, in the world
    phase = np.maximum(np.searchsorted([p.start for p in phases], t, side="right") - 1, 0)
    of_tool = np.array([_in_tool_frame(task, p.name) for p in phases])[phase]
    R_task = np.where(of_tool[:, None, None], tips[:, :3, :3], R_work)  # that the controller's state is in
    regulating = np.isin([p.name for p in phases], [p.name for p in task.phases if p.control is not None])[phase]
    phase[regulating & ~wanted.any(axis=1)] = -1  # the client learns of a new phase a little late
    rows: dict[str, Iterable[Any]] = {
        "t": t - phases[0].start,
        "phase": phase,
        "force": force @ R_work,
        "torque_T": _turned(_transposed(R_T), torque),
        "wanted_force": _turned(R_task, wanted[:, 3:]) @ R_work,
        "wanted_torque_T": _turned(_transposed(R_T) @ R_task, wanted[:, :3]),
        "tip": (to_work @ tips)[:, :3, 3],
        "reference": (to_work @ references)[:, :3, 3],
        "lean": [lean_of(R_wanted, R) for R_wanted, R in zip(R_reference, R_T, strict=True)],
    }
    if "believed_wrench" in series:
        told = series["believed_wrench"].nearest(t)
        rows["believed_force"] = told[:, 3:6] @ R_work
        rows["stated_force"] = deviations(told[:, 6:].reshape(-1, 6, 6)[:, :3, :3], R_work)
    return Recording(
        [p.name for p in phases],
        torque_axes=torque_axes_of(task),
        rows={name: list(values) for name, values in rows.items()},
    )


def deviations(covariance: Array, R: Array) -> Array:
    """(N, 3) standard deviations along the columns of R of vectors with covariances (N, 3, 3)."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("ji,njk,ki->ni", R, covariance, R), 0.0)))


def score_of_belief(recording: Recording, phase: str) -> dict[str, Any] | None:
    """Believed force along the task's z over the rows that count; None where there is none.

    Returns:
        rmse: [N] of the believed force against the wanted one. error, bias: [N] rms and mean of what it differs by
        from the true one. stated: [N] rms of its stated deviation. in_band: share of time that the truth is within
        BAND stated deviations.
    """
    if "believed_force" not in recording.rows:
        return None
    keep = recording.scored(phase)
    if not keep.any():
        return None
    true, believed = recording["force"][keep, 2], recording["believed_force"][keep, 2]
    off, stated = believed - true, recording["stated_force"][keep, 2]
    return {
        "rmse": rms(believed - recording["wanted_force"][keep, 2]),
        "error": rms(off),
        "bias": float(off.mean()),
        "stated": rms(stated),
        "in_band": float((np.abs(off) <= BAND * stated).mean()),
    }


def _turned(R: Array, vectors: Array) -> Array:
    """R v (N, 3) for each of R (N, 3, 3) and v (N, 3)."""
    return np.asarray((R @ vectors[:, :, None])[:, :, 0])


def _transposed(R: Array) -> Array:
    return np.swapaxes(R, 1, 2)


def _in_tool_frame(task: Task, phase: str) -> bool:
    controls = {p.name: p.control for p in task.phases}
    control = controls.get(phase, task.draw.control if task.draw else None)
    return control is not None and control.frame == "tool"

# SPDX-License-Identifier: Apache-2.0
"""A live run is scored as the evaluation scores one: the same axes, in the same frame."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_bringup.demo.score import Phase, recording_of
from seed_bringup.demo.series import Series
from seed_control.tasks import Task, load_task
from seed_core.spatial import make_pose, rotation_from_rpy
from seed_sim.closed_loop.recording import Recording, score, scored_phase

DOWN = make_pose(rotation_from_rpy((np.pi, 0.0, 0.0)), (0.45, 0.0, 0.0))  # z of the tip points into the table


def steady(task: Task, wanted: np.ndarray, felt: np.ndarray) -> Recording:
    """Every phase for four seconds with wanted [torque, force] in the task frame, and felt in the world."""
    phases = [Phase(p.name, 4.0 * i, 4.0 * (i + 1)) for i, p in enumerate(task.phases)]
    t = np.arange(0.0, 4.0 * len(phases), 0.1)
    poses, n = Series(t, np.tile(DOWN, (len(t), 1, 1))), len(t)
    series = {
        "true_wrench": Series(t, np.tile(felt, (n, 1))),
        "state": Series(t, np.tile(np.concatenate([wanted, np.zeros(9)]), (n, 1))),
        "true_tip": poses,
        "reference": poses,
    }
    return recording_of(series, task, np.eye(4), phases)


@pytest.mark.parametrize(
    ("name", "axes"),
    [
        ("squeegee", (True, False, False)),
        ("torque_driver", (False, False, True)),
        ("peg", (True, True, True)),
        ("write", (False, False, False)),  # no axis carries torque: its roll is lean
    ],
)
def test_axes_that_a_task_turns_are_scored_by_torque_and_not_by_lean(name: str, axes: tuple[bool, ...]) -> None:
    recording = steady(load_task(name), np.zeros(6), np.zeros(6))
    assert recording.torque_axes == axes


def test_a_live_screw_is_scored_by_its_torque() -> None:
    felt = np.array((0.0, 0.0, -0.5, 0.0, 0.0, -5.0))
    task = load_task("torque_driver")
    result = score(steady(task, felt, felt), scored_phase(task))
    assert result["samples"] > 0
    assert_allclose((result["torque_z"]["mean"], result["torque_z"]["rmse"]), (0.5, 0.0), atol=1e-12)


def test_a_force_wanted_along_the_tool_is_met_by_one_along_the_tool() -> None:
    task = load_task("squeegee")
    pressing = replace(task.phases[1].control, force=(0.0, 0.0, 10.0), frame="tool")
    phases = tuple(replace(p, control=pressing) if p.control is not None else p for p in task.phases)
    along, down = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 10.0)), np.array((0.0, 0.0, 0.0, 0.0, 0.0, -10.0))
    result = score(steady(replace(task, phases=phases), along, down), scored_phase(task))
    assert result["samples"] > 0
    assert_allclose(result["force_z"]["rmse"], 0.0, atol=1e-12)

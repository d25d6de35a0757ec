# SPDX-License-Identifier: Apache-2.0
"""Searching and inserting: what a file may say, what a spiral covers, what a wrench without progress means."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from quasi_static import Bench
from test_tasks import play

from seed_control.parameters import ControllerParameters
from seed_control.tasks import Task, TaskError, TaskPlayer, check_fits, load_task
from seed_control.tasks.insertion.search import spiral
from seed_control.tasks.insertion.stuck import Push, StuckWatch
from seed_control.tasks.insertion.surface import PlateUnderTip
from seed_core.config import ConfigError, load_text
from seed_core.hand import Frame, Tool
from seed_core.spatial import pose_from_rpy

PEG = Tool(name="round_peg", T_tip=Frame((0.0, 0.0, 0.09)), mass=0.15)


def test_no_place_within_the_radius_is_further_than_half_the_pitch_from_the_spiral() -> None:
    path = spiral(0.004, 0.001)[:, :2]
    rng = np.random.default_rng(0)
    angle, r = rng.uniform(0.0, 2.0 * np.pi, 500), 0.004 * np.sqrt(rng.uniform(size=500))
    places = np.column_stack([r * np.cos(angle), r * np.sin(angle)])
    away = np.sqrt(((places[:, None] - path[None]) ** 2).sum(axis=2)).min(axis=1)
    assert away.max() < 0.5e-3 + 1e-4
    assert_allclose(np.hypot(*path[-1]), 0.004, atol=1e-9)


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.05, -0.04)])
def test_a_drop_is_told_from_a_slope_and_from_noise(slope: tuple[float, float]) -> None:
    rng, plate, path = np.random.default_rng(2), PlateUnderTip(8e-4), spiral(0.004, 0.001)
    worst = 0.0
    for x, y, _ in path[::2]:
        plate.image(np.array((x, y, slope[0] * x + slope[1] * y + 3e-4 * rng.standard_normal())))
        worst = max(worst, plate.dropped)
    assert worst < 8e-4
    x, y, _ = path[-1]
    for _ in range(12):
        plate.image(np.array((x, y, slope[0] * x + slope[1] * y - 1.2e-3 + 3e-4 * rng.standard_normal())))
    assert plate.dropped > 8e-4
    assert plate.height(path[-1]) == pytest.approx(slope[0] * x + slope[1] * y, abs=3e-4)


@pytest.mark.parametrize(
    ("speed", "axial", "lateral", "moment", "kind"),
    [
        (0.005, 4.0, 0.2, 0.0, ""),  # it goes on
        (0.0, 1.0, 0.2, 0.0, ""),  # nobody pushes yet
        (0.0, 4.0, 1.5, 0.0, "jam"),
        (0.0, 4.0, 0.1, 0.03, "jam"),
        (0.0, 4.0, 0.1, 0.005, "wedge"),
    ],
)
def test_what_force_without_progress_means(
    speed: float, axial: float, lateral: float, moment: float, kind: str
) -> None:
    watch = StuckWatch(4.0, 0.5)
    for i in range(40):
        t = i / 45.0
        sideways, about = np.array((lateral, 0.0, 0.0)), np.array((0.0, moment, 0.0))
        watch.update(Push(t, speed * t, axial, sideways, about))
    assert watch.kind == kind


@pytest.mark.parametrize(
    ("phase", "said"),
    [
        ("search: {pattern: spiral}", "needs a control"),
        ("search: {pattern: line}\n    control: {force: 0 0 -2 N}", "give along"),
        ("search: {pitch: 0.01 m}\n    control: {force: 0 0 -2 N}", "has no turn"),
        ("search: {}\n    insert: {depth: 0.01 m}\n    control: {force: 0 0 -2 N}", "either search or insert"),
        ("insert: {depth: 0.01 m}\n    to: 0 0 0 m\n    control: {force: 0 0 -2 N}", "leave out to"),
        ("insert: {}\n    control: {force: 0 0 -2 N}", "depth"),
        ("insert: {depth: 10 mm}\n    control: {force: 0 0 -2 N}", "depth"),
    ],
)
def test_a_phase_that_makes_no_sense_is_refused(phase: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        load_text(f"name: t\nphases:\n  - name: a\n    {phase}\n", Task, "task")


def test_a_force_that_the_controller_may_not_be_asked_for_is_refused_before_it_begins() -> None:
    with pytest.raises(TaskError, match="max_force"):
        check_fits(load_task("insert_peg", force=18.0), PEG, ControllerParameters())


def test_a_hole_that_is_not_there_ends_with_a_reason_and_a_lift() -> None:
    """On a bare table the whole spiral is searched, then the tool is lifted."""
    task = load_task("insert_peg")
    place = np.array(task.frame.position) + np.array((0.0, 0.0, 0.03))
    bench = Bench(start=pose_from_rpy((np.pi, 0.0, 0.0), place)).enabled()
    player = TaskPlayer(task)
    status = play(bench, player, 60.0)
    assert status.failed
    assert "no hole found" in status.message
    bench.run(0.5)
    assert bench.force == 0.0
    assert bench.tip_height() > 0.04

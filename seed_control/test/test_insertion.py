# SPDX-License-Identifier: Apache-2.0
"""Searching and inserting: what a file may say, what a spiral covers, what a wrench without progress means."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from quasi_static import DT, Bench
from scipy.integrate import quad
from test_tasks import play

from seed_control.law.contact import ContactDetector
from seed_control.monitor.contact.force_watch import ForceWatch
from seed_control.parameters import ControllerParameters
from seed_control.state import ControllerState
from seed_control.tasks import Task, TaskError, TaskPlayer, check_fits, load_task
from seed_control.tasks.insertion.plate import PlateUnderTip
from seed_control.tasks.insertion.search import SearchRun
from seed_control.tasks.insertion.stuck import Push, StuckWatch
from seed_control.tasks.path import Spiral
from seed_control.tasks.steps import Step
from seed_core.config import ConfigError, load_text
from seed_core.hand import Frame, Tool
from seed_core.spatial import Wrench, make_pose, pose_from_rpy

PEG = Tool(name="round_peg", T_tip=Frame((0.0, 0.0, 0.09)), mass=0.15)


def spiral(radius: float, pitch: float) -> np.ndarray:
    """(n, 3) about every 0.3 mm of it."""
    path = Spiral(np.zeros(3), radius, pitch, 0.01, 1e3)
    return np.array([path.at(t)[0] for t in np.linspace(0.0, path.duration, int(path.length / 3e-4))])


def test_no_place_within_the_radius_is_further_than_half_the_pitch_from_the_spiral() -> None:
    path = spiral(0.004, 0.001)[:, :2]
    rng = np.random.default_rng(0)
    angle, r = rng.uniform(0.0, 2.0 * np.pi, 500), 0.004 * np.sqrt(rng.uniform(size=500))
    places = np.column_stack([r * np.cos(angle), r * np.sin(angle)])
    away = np.sqrt(((places[:, None] - path[None]) ** 2).sum(axis=2)).min(axis=1)
    assert away.max() < 0.5e-3 + 1e-4
    assert_allclose(np.hypot(*path[-1]), 0.004, atol=1e-9)


@pytest.mark.parametrize(("radius", "pitch"), [(0.004, 0.001), (0.1, 5e-5), (1e-4, 1e-4)])
def test_a_spiral_of_any_size_is_gone_evenly(radius: float, pitch: float) -> None:
    """SciPy integrates its length; the largest has 2000 turns and is not worked out beforehand."""
    path, per_angle = Spiral(np.array((0.1, 0.2, 0.3)), radius, pitch, 0.01, 1e3), pitch / (2.0 * np.pi)
    out, _ = quad(lambda a: per_angle * np.sqrt(1.0 + a * a), 0.0, radius / per_angle, epsrel=1e-12)
    assert path.length == pytest.approx(out + 2.0 * np.pi * radius, rel=1e-9)
    for t in np.linspace(1e-3, 0.999, 50) * path.duration:
        (place, velocity), before, after = path.at(t), path.at(t - 1e-5)[0], path.at(t + 1e-5)[0]
        assert_allclose(np.linalg.norm(velocity), 0.01, rtol=1e-9)
        assert_allclose((after - before) / 2e-5, velocity, atol=1e-6)
        x, y, z = place - (0.1, 0.2, 0.3)
        r, angle = np.hypot(x, y), 2.0 * np.pi * np.hypot(x, y) / pitch
        assert z == 0.0
        if r < radius * (1.0 - 1e-9):
            assert_allclose((x, y), (r * np.cos(angle), r * np.sin(angle)), atol=1e-9)


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


@pytest.mark.parametrize(
    ("drop", "sideways", "found"),
    [
        (0.0, 0.5, False),
        (5e-4, 0.0, False),
        (0.0, 1.7, False),
        (5e-4, 1.7, True),
        (1.2e-3, 0.0, True),
        (0.0, 2.8, True),
    ],
)
def test_a_hole_is_a_drop_or_a_rim_or_some_of_both(drop: float, sideways: float, found: bool) -> None:
    """[m] and [N]; a peg that has caught in the mouth was dragged out of it again, before each alone was enough."""
    phase = next(p for p in load_task("insert_peg").phases if p.name == "search")
    run = SearchRun(Step(phase), np.zeros(3), np.eye(3), np.eye(3), np.eye(4))
    nothing = ControllerState(0.0, "contact", True, in_contact=True, filtered=Wrench.zero(), X_W_tip=np.eye(4))
    for x, y, _ in spiral(0.004, 0.001)[:60:2]:
        assert run.advance(0.02, nothing._replace(X_W_tip=make_pose(np.eye(3), (x, y, 0.0)))) == ""
    pressed = Wrench(np.zeros(3), np.array((sideways, 0.0, 1.0)))
    told = [
        run.advance(0.02, nothing._replace(filtered=pressed, X_W_tip=make_pose(np.eye(3), (x, y, -drop))))
        for _ in range(15)
    ]
    assert ("done" in told) is found


def test_a_hole_that_is_not_there_ends_with_a_reason_and_a_lift() -> None:
    """On a bare table the whole spiral is searched, then the tool is lifted."""
    task = load_task("insert_peg")
    short = [replace(p, search=replace(p.search, radius=1.5e-3)) if p.search else p for p in task.phases]
    task = replace(task, phases=tuple(short))
    place = np.array(task.frame.position) + np.array((0.0, 0.0, 0.03))
    bench = Bench(start=pose_from_rpy((np.pi, 0.0, 0.0), place)).enabled()
    player = TaskPlayer(task)
    status = play(bench, player, 60.0)
    assert status.failed
    assert "no hole found" in status.message
    bench.run(0.5)
    assert bench.force == 0.0
    assert bench.tip_height() > 0.04


def test_a_peg_that_falls_straight_into_its_hole_is_in_it() -> None:
    """Nothing was touched where the plate can lie: the spiral is left out, and the insertion goes on from there."""
    task = load_task("insert_peg")
    place = np.array(task.frame.position) + np.array((0.0, 0.0, 0.02))
    bench = Bench(start=pose_from_rpy((np.pi, 0.0, 0.0), place), table=-0.02).enabled()
    player = TaskPlayer(task)
    play(bench, player, 20.0, until="insert")
    assert bench.force == 0.0
    assert -0.008 < bench.tip_height() < -0.003
    status = play(bench, player, 20.0)
    assert status.done
    assert not status.failed


def test_a_peg_is_pulled_from_where_it_is_over_some_images() -> None:
    """One image alone said where it was: pulled from 2 mm beside that, a peg jammed in its hole."""
    task, off = load_task("insert_peg"), []
    place = np.array(task.frame.position) + np.array((0.0, 0.0, 0.02))
    for seed in range(6):
        bench = Bench(start=pose_from_rpy((np.pi, 0.0, 0.0), place), table=-0.02, noise=2e-4)
        bench._image_rng = np.random.default_rng(seed)
        bench.enabled()
        player = TaskPlayer(task)
        play(bench, player, 20.0, until="insert")
        status = play(bench, player, 20.0, until="pull")
        assert status.phase == "pull"
        assert status.setpoint is not None
        tip = bench.X_WE @ bench.hand.X_EC @ bench.tool.X_Ttip
        off.append(float(np.linalg.norm((status.setpoint.X_W_tip - tip)[:2, 3]) / 2e-4))
    assert np.mean(off) < 0.9  # [noise]; 1.07 from the last image alone


def test_a_way_in_that_is_none_is_searched_again_and_then_given_up() -> None:
    """A step of 1 mm looks like a hole; nothing goes in there."""
    task = load_task("insert_peg")
    small = [
        replace(p, search=replace(p.search, radius=1.5e-3, rim=50.0, drop=3e-4) if p.search else None)
        for p in task.phases
    ]
    small = [replace(p, insert=replace(p.insert, searches=1, tries=1)) if p.insert else p for p in small]
    bench = Bench(start=pose_from_rpy((np.pi, 0.0, 0.0), (0.5, 0.0, 0.02)), bumps=(8e-4, 0.02)).enabled()
    player = TaskPlayer(replace(task, phases=tuple(small)))
    seen = []
    for _ in range(round(60.0 / DT)):
        status = play(bench, player, DT)
        if not seen or status.phase != seen[-1]:
            seen.append(status.phase)
        if status.done:
            break
    assert status.failed
    assert seen.count("search") == 2
    assert "no hole found" in status.message


def test_contact_that_is_known_needs_no_force() -> None:
    detector = ContactDetector(ControllerParameters())
    assert detector.update(np.zeros(3), np.array((0.0, 0.0, -4.0)), 0.2) == ()
    assert detector.update(np.zeros(3), np.array((0.0, 0.0, -4.0)), 0.2, known=True) == (0, 1, 2)
    assert detector.made
    assert detector.update(np.zeros(3), np.array((0.0, 0.0, -4.0)), 0.2, known=True) == ()


def test_what_presses_sideways_as_it_is_to_be_let_go_may_fall_and_must() -> None:
    for rate, holds in ((20.0, False), (0.0, True)):
        watch = ForceWatch(3.0)
        for i in range(40):
            sideways = max(6.0 - rate * i / 45.0, 0.0)
            watch.update(i / 45.0, [sideways, 0.0, -4.0], [0.0, 0.0, -4.0], 0.1, False)
        assert bool(watch.reason) == holds

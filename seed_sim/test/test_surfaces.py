# SPDX-License-Identifier: Apache-2.0
"""Tables that are not flat: distances are exact, and the simulated contact obeys friction along the true normal."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_control.tasks import read_task, shipped_tasks
from seed_core.spatial import Array, inverse_pose, make_pose, pose_from_rpy
from seed_sim.closed_loop.evaluate import evaluate
from seed_sim.closed_loop.surfaces import MOST_NORMAL, MOST_PEAK, WORST_FORCE, failure, summary, surfaces, table
from seed_sim.plant.plant import Plant
from seed_sim.plant.surfaces.draw import draw_shapes
from seed_sim.plant.surfaces.section import KINDS, SurfaceSection
from seed_sim.plant.surfaces.shapes import Corner, Ridge, Round, Saddle, Shape
from seed_sim.plant.table import draw_surface
from seed_sim.replay.fixtures import table_mesh
from seed_sim.scenario import Scenario, ServoSection, TableSection, load_scenario

WORK = make_pose(None, (0.45, 0.0, 0.0))
LEVEL = TableSection(tilt_x=(0.0, 0.0), tilt_y=(0.0, 0.0), height=(0.0, 0.0))
AHEAD = 0.05  # [m/s]
FIND = shipped_tasks()["find_edge"].read_text()


def on(**surface: object) -> Scenario:
    """A ball on a level table of that shape, and an arm without errors."""
    table = replace(LEVEL, surface=SurfaceSection(turn=(0.0, 0.0), **surface))  # type: ignore[arg-type]
    return replace(load_scenario("ball"), table=table, servo=ServoSection(repeatability=0.0))


def flange(scenario: Scenario, x: float, z: float) -> Array:
    X_W_tip = WORK @ pose_from_rpy((np.pi, 0.0, 0.0), (x, 0.0, z))
    return np.asarray(X_W_tip @ inverse_pose(scenario.tool.X_Ttip) @ inverse_pose(scenario.hand.X_EC))


def slide(scenario: Scenario, seconds: float, depth: float = 0.005) -> tuple[Plant, list[Array]]:
    """Follow the surface's height from above; the last plant and rows of (t, x, along normal, across, force)."""
    plant, rows = Plant(scenario, 3, WORK, flange(scenario, 0.0, 0.005)), []
    while plant.time < seconds:
        x = AHEAD * max(plant.time - 0.5, 0.0)
        down = min(0.005 + depth, 0.03 * plant.time)
        z = float(plant.surface.height(np.array([x]), np.array([0.0]))[0]) + plant.surface.moved(plant.time)[0]
        plant.command(flange(scenario, x, z + 0.005 - down))
        plant.advance(plant.time + 0.004)
        force, n = -plant.contact_wrench.force, plant.true_normal
        along = float(force @ n)
        rows.append(np.array((plant.time, x, along, np.linalg.norm(force - along * n), np.linalg.norm(force))))
    return plant, rows


@pytest.mark.parametrize("shape", [
    Round(0.08, 0.01), Round(0.1, 0.0, hollow=True), Round(0.2, 0.0, ball=True), Saddle(0.08, 0.02),
    *draw_shapes(SurfaceSection(kind="relief"), 2.0, np.random.default_rng(3))[0], Ridge(0.05, 0.02, 0.35),
])  # fmt: skip
def test_distance_and_normal_are_those_of_the_nearest_of_many_points(shape: Shape) -> None:
    x = np.linspace(-0.06, 0.075, 1081)
    u, v = np.meshgrid(x, np.linspace(-0.02, 0.02, 321), indexing="ij")
    points = np.stack([u, v, shape.height(u, v)], axis=-1).reshape(-1, 3)
    for p in ((0.005, 0.003, 0.02), (-0.03, -0.006, 0.012), (0.012, 0.0, float(shape.height(0.012, 0.0)) - 0.001)):
        away = np.linalg.norm(points - p, axis=1)
        distance, normal = shape.nearest(p)
        assert abs(abs(distance) - away.min()) < 4e-6  # [m], of a grid of 0.125 mm at 1 mm
        assert_allclose(np.array(p) - distance * np.array(normal), points[away.argmin()], atol=2e-4)
        assert np.linalg.norm(normal) == pytest.approx(1.0)


def test_around_the_edge_of_a_step_the_distance_is_that_of_its_corner() -> None:
    corner = Corner(0.05, 0.002, -1.0)  # a block from x = 0.05 on
    for place, away, normal in (
        ((0.047, 0.0, 0.006), 0.005, (-0.6, 0.0, 0.8)),
        ((0.06, 0.0, 0.001), -0.001, (0.0, 0.0, 1.0)),
        ((0.04, 0.0, -0.01), 0.01, (-1.0, 0.0, 0.0)),
    ):
        found = corner.nearest(place)
        assert found[0] == pytest.approx(away)
        assert_allclose(found[1], normal, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_draws_one_table_and_its_height_is_where_its_distance_is_zero(kind: str) -> None:
    table = replace(LEVEL, surface=SurfaceSection(kind=kind, swing=1.0))
    one, again, other = (draw_surface(table, WORK, np.random.default_rng(s), 1, s) for s in (4, 4, 5))
    x, y = np.array([0.02, 0.07]), np.array([0.01, -0.01])
    assert_allclose(one.height(x, y), again.height(x, y))
    assert one.phase != other.phase
    for t in (0.0, 0.3):
        for a, b, z in zip(x, y, one.height(x, y), strict=True):
            p = one.X_WS @ np.array((a, b, z + one.moved(t)[0], 1.0))
            assert one.nearest(p[:3], t).distance == pytest.approx(0.0, abs=1e-8)
    vertices = table_mesh(one).vertices
    assert np.isfinite(vertices).all()


@pytest.mark.parametrize("surface", [
    {"kind": "cylinder", "radius": (0.08, 0.08), "at": (0.04, 0.04)}, {"kind": "sphere", "hollow": True},
    {"kind": "relief"}, {"kind": "plane", "swing": 2.0},
], ids=lambda s: s["kind"])  # fmt: skip
def test_a_sliding_ball_feels_the_surface_without_facets(surface: dict[str, object]) -> None:
    _, rows = slide(on(**surface), 1.8)
    t, _, along, across, _ = np.array(rows).T
    sliding = t > 0.9
    assert_allclose(across[sliding] / along[sliding], 0.4, atol=0.01)  # the friction cone about the true normal
    roughness = np.diff(along[sliding], 2)
    assert np.abs(roughness).max() < 0.02  # [N] from one step of 4 ms to the next: no edge of a triangle


def test_a_ball_climbs_a_step_by_its_corner_and_falls_off_one() -> None:
    _, up = slide(on(kind="step", step=2.0, at=(0.03, 0.03)), 2.0)
    before = [r[2] for r in up if 0.01 < r[1] < 0.02]
    after = [r[2] for r in up if r[1] > 0.06]
    assert_allclose(before, before[0], atol=0.05)
    assert_allclose(after, before[0], atol=0.05)
    assert max(r[4] for r in up) > before[0] + 0.3  # pushed against the corner
    _, down = slide(on(kind="step", step=-5.0, at=(0.03, 0.03)), 2.0)
    assert_allclose([r[2] for r in down if r[1] > 0.05], before[0], atol=0.05)


def test_a_table_that_moves_carries_the_ball_and_repeats_exactly() -> None:
    scenario = on(kind="plane", swing=2.0, frequency=1.0)
    plant = Plant(scenario, 3, WORK, flange(scenario, 0.0, 0.005))
    forces = []
    for _ in range(2):
        plant.reset(flange(scenario, 0.0, 0.005))
        plant.command(flange(scenario, 0.0, -0.006))
        heights, force = [], []
        for _ in range(400):
            plant.advance(plant.time + 0.004)
            heights.append(plant.surface.moved(plant.time)[0])
            force.append(-plant.contact_wrench.force[2])
        forces.append(force)
    assert_allclose(forces[0], forces[1], atol=0.0)
    # what stands still is pressed by the springs in series, in step with the table
    rise = np.polyfit(heights[150:], forces[0][150:], 1)[0]
    assert rise == pytest.approx(1.0 / (1.0 / 800.0 + 1.0 / 8000.0), rel=0.05)


def test_a_task_follows_a_cylinder_that_it_does_not_know() -> None:
    result = evaluate("follow", scenario="cylinder", estimator="noisy", seed=2).result
    assert result["finished"], result["message"]
    score = result["surface"]
    assert score["force_rms"] < WORST_FORCE
    assert score["normal_rms_deg"] < MOST_NORMAL
    assert score["peak"] < MOST_PEAK
    assert failure({**result}) == ""
    assert "cylinder" in table([result])


@pytest.mark.parametrize(("kind", "seed"), [("cylinder", 8100), ("sphere", 8107)])
def test_a_soft_surface_is_no_slope(kind: str, seed: int) -> None:
    """One that gives way as the grasp does; with its softness told by the law's observer the arm held."""
    scenario = load_scenario(kind)
    soft = replace(scenario, table=replace(scenario.table, total_stiffness=800.0))
    result = evaluate("follow", scenario=soft, estimator="noisy", seed=seed).result
    assert result["finished"], result["message"]
    assert result["surface"]["force_rms"] < WORST_FORCE
    assert result["surface"]["normal_rms_deg"] < 4.0


def test_a_surface_that_falls_away_makes_the_arm_hold_with_a_reason() -> None:
    result = evaluate("follow", scenario="edge", estimator="noisy", seed=1).result
    assert not result["finished"]
    assert "arm holds: " in result["message"]
    assert "contact was lost" in result["message"]
    assert result["surface"]["peak"] < 1.6  # issue 16: of the wanted force


def test_a_campaign_goes_on_where_it_stopped(tmp_path: Path) -> None:
    kept, score = tmp_path / "runs.jsonl", {"peak": 1.2, "force_rms": 0.2, "normal_rms_deg": 2.0}
    worse = {"peak": 1.7, "force_rms": 0.5, "normal_rms_deg": 4.0}
    runs = [
        {"task": "follow", "scenario": kind, "seed": seed, "finished": True, "message": "finished",
         "surface": {**figures, "force_mean": 10.0, "normal_max_deg": 5.0}}
        for kind, seed, figures in (("cylinder", 7, score), ("sphere", 8, worse))
    ]  # fmt: skip
    lines = "".join(json.dumps(run) + "\n" for run in runs)
    kept.write_text(lines + '{"task": "fol')
    assert surfaces(2, 7, ("cylinder", "sphere"), keep=kept) == runs
    assert kept.read_text() == lines  # nothing was run again, and the line that was cut off is gone
    found = summary(runs)
    assert found["smooth"]["peak"] == pytest.approx([1.45, 1.65, 1.7])
    assert found["smooth"]["force_rms_mean"] == pytest.approx(0.35)
    assert found["beyond"] == 1
    assert "BEYOND: peak" in table(runs)


def test_a_run_that_broke_off_counts_in_its_group() -> None:
    figures = {"peak": 1.2, "force_rms": 0.2, "normal_rms_deg": 2.0, "force_mean": 10.0, "normal_max_deg": 5.0}
    whole = {"scenario": "cylinder", "seed": 1, "finished": True, "message": "finished", "surface": figures}
    broken = {"scenario": "sphere", "seed": 2, "finished": False, "message": "no path", "surface": None}
    found = summary([whole, broken])
    assert [found["smooth"][k] for k in ("runs", "finished", "broke")] == [2, 1, 1]
    assert found["smooth"]["peak"] == [1.2, 1.2, 1.2]
    assert found["beyond"] == 1
    told = table([whole, broken])
    assert "no path  BEYOND: broke" in told
    assert "smooth, 2 runs, 1 finished, 1 broke off without figures" in told
    alone = table([broken])
    assert "smooth, 1 runs, 0 finished, 1 broke off without figures" in alone
    assert "force_rms" not in alone


CORNER = """
name: corner
tool: ball
frame: {position: 0.45 0.0 0.0 m}
phases:
  - {name: approach, to: 0 0 0.008 m, speed: 0.1 m/s}
  - {name: floor, contact_stop: {towards: -z, force: 3 N}, speed: 0.03 m/s}
  - {name: rise, to: 0 0 0.004 m}
  - {name: wall, contact_stop: {towards: x, force: 3 N}, speed: 0.03 m/s}
  - {name: back, to: 0 0 0.02 m}
"""


def test_two_contact_stops_find_a_corner_within_their_deviations() -> None:
    scenario = on(kind="step", step=20.0, at=(0.03, 0.03))
    run = evaluate(read_task(CORNER), scenario=scenario, estimator="noisy", seed=4)
    assert run.result["finished"], run.result["message"]
    floor, wall = run.recording.found
    assert [floor.name, wall.name] == ["floor", "wall"]
    pressed = 3.0 / 8000.0  # [m] that the tip sinks in
    assert abs(floor.X_W_tip[2, 3] + pressed) < max(3.0 * floor.deviation[2], 2e-4)
    # the ball's side touches, 8 mm before its tip's axis
    assert abs(wall.X_W_tip[0, 3] - (0.45 + 0.03 - 0.008 + pressed)) < max(3.0 * wall.deviation[0], 5e-4)
    assert_allclose(wall.towards, (1.0, 0.0, 0.0))


def test_an_edge_is_told_and_one_that_is_not_there_is_missed_by_name() -> None:
    there = evaluate("find_edge", scenario="edge", estimator="noisy", seed=1)
    edge = there.recording.found[-1]
    assert there.result["finished"], there.result["message"]
    assert abs(edge.X_W_tip[0, 3] - 0.52) < 3.0 * edge.deviation[0]
    assert "edge at (0.52" in there.result["message"]
    short = FIND.replace("0.12 m", "0.02 m")
    assert short != FIND
    missed = evaluate(read_task(short), scenario="ball", estimator="noisy", seed=1).result
    assert not missed["finished"]
    assert missed["message"].startswith("phase 'edge' found no edge within reach = 0.02 m along x")

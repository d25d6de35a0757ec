# SPDX-License-Identifier: Apache-2.0
"""Hidden worlds: what is drawn, what it does to images and force, and what the procedures find of it."""

import re
import sys
from dataclasses import asdict, replace

import numpy as np
import pytest

from seed_control.tasks import load_task
from seed_control.tasks.task import Task
from seed_core.errors import SeedError
from seed_core.program.command_line import to_json
from seed_core.spatial import make_pose, so3_log
from seed_core.wrench_settings import WRENCH_MODELS
from seed_sim.campaigns import spread
from seed_sim.closed_loop import command
from seed_sim.closed_loop.recording import Recording
from seed_sim.closed_loop.run import start_pose
from seed_sim.identification import session
from seed_sim.plant.plant import Plant
from seed_sim.scenario import Scenario, load_scenario, on_membrane
from seed_sim.world import draw, perturb, score
from seed_sim.world.belief import Belief
from seed_sim.world.cameras import WorldCameras, true_hand
from seed_sim.world.cell import true_scenario
from seed_sim.world.parameters import CameraWorld, CellWorld, ImageWorld, ProcedureWorld, SpringWorld, World
from seed_sim.world.poses import WorldPoses
from seed_sim.world.procedures import find_out, membranes
from seed_sim.world.procedures.clocks import motion
from seed_sim.world.procedures.find_out import told
from seed_sim.world.procedures.identify import identify, identify_draws
from seed_sim.world.procedures.identify import table as identify_table
from seed_sim.world.score import score_draws, summarised
from seed_sim.world.trial import beliefs, run_trial
from seed_sysid.parameters import Procedure

NOMINAL = load_scenario("nominal")
AS_BELIEVED = Belief(told(NOMINAL, World()))


def numbers(value):
    """All numbers of nested plain data."""
    if isinstance(value, dict):
        return [n for v in value.values() for n in numbers(v)]
    if isinstance(value, list | tuple):
        return [n for v in value for n in numbers(v)]
    return [float(value)] if isinstance(value, int | float) else []


# -- the draw


def test_a_draw_is_the_same_on_every_call_and_another_for_every_seed():
    assert draw.draw_world(11) == draw.draw_world(11)
    assert draw.draw_world(11).spring.scale != draw.draw_world(12).spring.scale


def test_draws_fill_their_ranges_and_do_not_leave_them():
    worlds = [draw.draw_world(seed) for seed in range(400)]

    def within(values, low, high):
        v = np.array(values)
        assert low <= v.min() < low + 0.05 * (high - low)
        assert high >= v.max() > high - 0.05 * (high - low)

    within([w.spring.scale[5] for w in worlds], 0.95, 1.05)
    within([w.spring.centre_mm[0] for w in worlds], -3.0, 3.0)
    within([w.images.left.turn_deg[1] for w in worlds], -0.5, 0.5)
    within([w.images.right.shift_mm[2] for w in worlds], -0.5, 0.5)
    within([w.images.left.focal for w in worlds], -0.01, 0.01)
    within([w.images.right.depth_scale for w in worlds], -0.01, 0.01)
    within([w.images.depth_lag for w in worlds], 0.0, 0.04)
    within([w.images.clock for w in worlds], -0.01, 0.01)
    within([draw.draw_world(s, late_stamps=True).images.clock for s in range(400)], 0.0, 0.1)
    within([w.images.skew for w in worlds], 0.0, 0.015)
    within([w.images.slip for w in worlds], 0.0, 0.1)
    within([w.cell.mass for w in worlds], -0.03, 0.03)
    within([w.cell.friction for w in worlds], 0.1, 0.8)
    within([w.cell.flange_turn_deg[2] for w in worlds], -0.25, 0.25)
    within([w.procedures.dome[2] for w in worlds], -0.02, 0.02)


def test_a_world_without_deviations_has_none():
    world = World()
    assert set(numbers(asdict(world.images))) == {0.0}
    np.testing.assert_allclose(true_hand(NOMINAL.hand, world).X_CL, NOMINAL.hand.X_CL, atol=1e-12)
    assert true_scenario(NOMINAL, world).table == NOMINAL.table


def test_an_unknown_kind_is_refused_by_name():
    with pytest.raises(SeedError, match=r"kind 'rubber'.*spring, membrane"):
        draw.draw_world(1, "rubber")


# -- images


def test_mounts_are_off_by_what_the_world_says():
    world = World(images=ImageWorld(left=CameraWorld(turn_deg=(0.0, 0.5, 0.0), shift_mm=(0.0, 0.0, -0.4))))
    hand = true_hand(NOMINAL.hand, world)
    turn = np.rad2deg(so3_log(hand.X_CL[:3, :3] @ NOMINAL.hand.X_CL[:3, :3].T))
    np.testing.assert_allclose(turn, (0.0, 0.5, 0.0), atol=1e-9)
    np.testing.assert_allclose(1e3 * (hand.X_CL - NOMINAL.hand.X_CL)[:3, 3], (0.0, 0.0, -0.4), atol=1e-9)
    np.testing.assert_allclose(hand.X_CR, NOMINAL.hand.X_CR, atol=1e-12)


def quiet(**images) -> WorldCameras:
    tactile = replace(NOMINAL.tactile, noise=0.0, pattern=0.0, dropouts=0.0)
    return WorldCameras(replace(NOMINAL, tactile=tactile), World(images=ImageWorld(**images)), 1)


def test_depth_is_scaled_and_stamps_are_off_but_infrared_is_as_it_was():
    same, world = quiet(), quiet(left=CameraWorld(depth_scale=0.01), clock=0.007, skew=0.009, skew_stamped=True)
    one, other = same.no_contact(1.0), world.no_contact(1.0)
    seen = np.isfinite(one["left"].depth)
    np.testing.assert_allclose(other["left"].depth[seen], 1.01 * one["left"].depth[seen], rtol=1e-5)
    np.testing.assert_array_equal(other["left"].ir, one["left"].ir)
    assert other["left"].stamp == pytest.approx(1.007)
    assert other["right"].stamp == pytest.approx(0.998)


def test_images_that_tell_their_times_are_paired_with_the_nearest():
    period = 1.0 / NOMINAL.measurement.rate
    assert quiet(skew=0.014, skew_stamped=True).early == pytest.approx({"left": period - 0.014, "right": 0.0})
    assert quiet(skew=0.014).early == pytest.approx({"left": 0.0, "right": 0.014})


@pytest.mark.parametrize("skew", [0.011, 0.03, 0.1])
def test_fingers_are_seen_as_far_apart_as_the_world_says_beyond_a_period_too(skew, monkeypatch):
    """45 pairs a second: of 30 ms one more image of the early finger is on its way, of 100 ms four or five."""
    task = load_task("squeegee")
    plant = Plant(NOMINAL, 1, task.frame.pose, start_pose(NOMINAL, task))
    poses = WorldPoses(NOMINAL, World(images=ImageWorld(skew=skew)), 1)
    seen = {"left": [], "right": []}
    finger = poses._cameras.finger
    monkeypatch.setattr(
        poses._cameras, "finger", lambda name, X, t: seen[name].append(plant.time) or finger(name, X, t)
    )
    while len(seen["left"]) < 12:
        plant.advance(poses.next_image())
        pairs = len(seen["left"])
        poses.take_image(plant)
        if len(seen["left"]) > pairs:
            assert poses.images["right"].stamp == pytest.approx(poses.images["left"].stamp, abs=1e-9)
    apart = np.subtract(seen["left"], seen["right"][:12])
    np.testing.assert_allclose(apart[6:], skew, atol=1e-6)  # before, the tool rests: there is nothing to see
    assert apart[0] == 0.0
    assert (np.diff(seen["right"]) >= 0.0).all()


def test_a_longer_lens_shows_the_same_thing_larger_while_nobody_knows():
    world = quiet(left=CameraWorld(focal=0.03))
    assert world.renderer.cameras["left"].K[0, 0] == pytest.approx(1.03 * world.cameras["left"].K[0, 0])
    assert world.renderer.cameras["right"].K[0, 0] == world.cameras["right"].K[0, 0]


def test_depth_follows_a_step_within_its_time_constant_and_infrared_at_once():
    world, now = quiet(depth_lag=0.04), quiet()
    start, end = np.eye(4), make_pose(None, (0.0, -0.002, 0.0))
    period = 1.0 / 45.0
    before = world.render(start, 0.0)["left"].depth
    final = now.render(end, 1.0)["left"]
    moved = np.isfinite(before) & (np.abs(final.depth - before) > 0.0015)
    for n in (1, 2, 4):
        seen = world.render(end, n * period)["left"]
        share = np.median((seen.depth - before)[moved] / (final.depth - before)[moved])
        assert share == pytest.approx(1.0 - np.exp(-n * period / 0.04), abs=0.01)
        np.testing.assert_allclose(np.median(seen.ir), np.median(final.ir), rtol=1e-3)


def test_an_image_dated_before_the_last_one_is_no_noisier_than_another():
    world, there = quiet(depth_lag=0.01), make_pose(None, (0.0, -0.002, 0.0))
    fresh = world.render(there, 0.0)["left"].depth
    world.render(np.eye(4), 1.0)
    again = world.render(there, 0.9)["left"].depth  # as for a grasp taken anew at 1 s
    seen = np.isfinite(fresh) & np.isfinite(again)
    assert seen.mean() > 0.5
    assert np.abs(again - fresh)[seen].max() < 0.005


def test_membranes_rise_after_the_reference():
    world = quiet(left=CameraWorld(shape_mm=0.2))
    reference = world.no_contact(0.0)["left"].depth
    world.age()
    membrane = world.renderer.membranes["left"]
    rise = membrane.rest.depth - membrane.dome  # towards the camera that sits behind it, or away
    h, w = rise.shape
    assert abs(rise[h // 2, w // 2]) == pytest.approx(2e-4, abs=2e-5)  # at the apex
    assert np.abs(rise).max() < 3e-4
    assert np.isfinite(reference).any()


# -- what the procedures find


def test_identification_finds_the_linear_spring_of_a_world_within_its_intervals():
    world = World(spring=SpringWorld(scale=(1.04, 0.96, 1.02, 0.97, 1.03, 0.95)))
    found = identify(NOMINAL, world, 5)
    assert sum(found.figures["covered"].values()) >= 5
    assert max(abs(e) for e in found.figures["error"].values()) < 0.02  # repeatability


def test_the_motion_for_the_clocks_keeps_the_limits_of_the_procedure():
    times, poses = motion(Procedure())
    speeds = [
        np.linalg.norm(b[:3, 3] - a[:3, 3]) / (t - s)
        for s, t, a, b in zip(times, times[1:], poses, poses[1:], strict=False)
    ]
    assert max(speeds) < 1.1 * Procedure().motion.speed
    assert max(speeds) > 0.5 * Procedure().motion.speed


# -- in closed loop, on exact poses


def short_wipe() -> Task:
    *before, wipe, lift = load_task("squeegee").phases
    end = (replace(wipe, to=(0.06, 0.0, 0.0)), replace(lift, to=(0.06, 0.0, 0.05)))
    return replace(load_task("squeegee"), phases=(*before, *end))


def force_error(world: World, seed: int = 3, **more) -> dict:
    return run_trial(short_wipe(), world, seed, estimator="truth", belief=AS_BELIEVED, **more).result


@pytest.fixture(scope="module")
def undisturbed() -> dict:
    return force_error(World())


def test_a_world_as_believed_is_wiped_as_well_as_a_known_one(undisturbed):
    assert undisturbed["finished"]
    assert undisturbed["force_z"]["rmse"] < 0.05
    assert undisturbed["believed_z"]["error"] < 0.05
    assert not undisturbed["swing"]["seen"]


def test_a_weight_that_nobody_knows_costs_its_own():
    result = force_error(World(cell=CellWorld(mass=0.1)))
    assert result["force_z"]["mean"] == pytest.approx(-10.0 - 0.1 * NOMINAL.tool.mass * 9.81, abs=0.05)


def test_a_run_in_a_world_is_the_same_every_time_and_tells_phase_and_simulated_time(undisturbed):
    said: list[str] = []
    again = force_error(World(), progress=lambda _, what: said.append(what))
    phases = dict.fromkeys(what.partition(",")[0] for what in said)
    looks = ["look", "look tilted", "look upright"]
    assert list(phases) == ["waiting", "start", *looks, "approach", "press", "wipe", "lift", "done"]
    times = [float(what.split()[-3]) for what in said if what.endswith(" s simulated")]
    assert len(times) == len(said)
    assert times == sorted(times)
    assert to_json(again | {"seconds": 0}) == to_json(undisturbed | {"seconds": 0})


# -- the score


def run_of(draw_: int, force: float, **more) -> dict:
    return {"draw": draw_, "finished": True, "samples": 9, "force_z": {"rmse": force}, **more}


def test_the_summary_is_over_draws_and_names_what_went_wrong():
    runs = [run_of(i, 0.1 * i, within=i < 9) for i in range(10)]
    runs.append({"draw": 10, "finished": False, "error": "no"})
    out = summarised(runs)
    assert out["force_z"] == pytest.approx({"median": 0.45, "p90": 0.81, "worst": 0.9})
    assert (out["draws"], out["scored"], out["not_finished"]) == (11, 10, [10])
    assert out["within_two_deviations"] == pytest.approx(0.9)
    assert spread([3.0]) == {"median": 3.0, "p90": 3.0, "worst": 3.0}


SETTINGS = {
    "task": "squeegee",
    "law": "seed",
    "estimator": "truth",
    "model": "bushing",
    "force": None,
    "scenario": None,
    "world": "spring",
    "late_stamps": False,
    "arm_sensor": False,
}


def test_draws_in_a_file_are_not_repeated_and_those_of_another_score_are_refused(tmp_path):
    file = tmp_path / "draws.jsonl"
    file.write_text(to_json(run_of(3, 0.5, message="as it stood") | SETTINGS) + "\n", encoding="utf-8")
    result = score_draws(SETTINGS, [3], out=file)
    assert [r["message"] for r in result["draws"]] == ["as it stood"]
    with pytest.raises(SeedError, match=r"draws\.jsonl:1: not a draw of this score \(one with law seed\)"):
        score_draws(SETTINGS | {"law": "plain"}, [3], out=file)
    whole = file.read_text(encoding="utf-8")
    file.write_text(whole + whole[:70], encoding="utf-8")  # interrupted while it was written
    assert len(score_draws(SETTINGS, [3], out=file)["draws"]) == 1
    assert file.read_text(encoding="utf-8") == whole


def test_belief_is_told_from_truth_and_swing_from_a_slow_error():
    t = np.arange(0.0, 8.0, 0.004)
    recording = Recording(["wipe"])
    true = -10.0 - 0.5 * np.sin(0.5 * t) + 0.9 * np.sin(2.0 * np.pi * 3.0 * t) * (t > 1.0)
    for i, now in enumerate(t):
        force = np.array((0.0, 0.0, true[i]))
        recording.add(t=now, phase=0, force=force, believed_force=np.array((0.0, 0.0, -10.0)))
        recording.add(wanted_force=np.array((0.0, 0.0, -10.0)), stated_force=np.full(3, 0.5), mode="contact")
        recording.add(wrench_error=np.zeros(6), wrench_covariance=np.eye(6), told=("slow",) if now > 5.0 else ())
    out = beliefs(recording, "wipe")
    assert out["believed_z"]["rmse"] == 0.0
    assert out["swing"]["rms"] == pytest.approx(0.9 / np.sqrt(2.0), rel=0.1)
    assert out["swing"]["seen"]
    assert out["within"]
    assert [round(r["after"], 1) for r in out["reports"]] == [5.0]


def test_one_draw_tells_what_it_does_and_several_are_counted(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)

    def one_draw(settings, draw_, progress=None):
        if progress is not None:
            progress(0.5, "wipe, 9.4 s simulated")
        return run_of(draw_, 0.1) | settings

    monkeypatch.setattr(score, "one_draw", one_draw)
    for draws, shown, seen in (([3], True, True), ([3], False, False), ([3, 4], True, False)):
        assert len(score_draws({}, draws, shown=shown)["draws"]) == len(draws)
        assert ("draw 3:  50%" in (said := capsys.readouterr().err)) == seen
        assert ("wipe, 9.4 s simulated" in said) == seen


def test_finding_out_tells_which_procedure_runs_and_how_far_the_identification_is(monkeypatch):
    told_: list[tuple[float, str]] = []
    monkeypatch.setattr(find_out, "STEPS", {"spring": ("identify",)})
    monkeypatch.setattr(session, "_SHOW", 0.0)
    world = World(procedures=ProcedureWorld(run=True))
    belief = find_out.find_out(NOMINAL, world, 3, progress=lambda share, what: told_.append((share, what)))
    assert belief.problems == ()
    assert told_[0] == (0.0, "identify")
    shares = [share for share, _ in told_]
    assert shares == sorted(shares)
    assert shares[-1] > 0.9
    assert all(re.fullmatch(r"identify: pose \d+ of \d+, \d+ s simulated", what) for _, what in told_[1:])


def test_a_draw_whose_identification_fails_is_not_wiped_but_counts_as_not_finished(monkeypatch):
    def fails(*_args, **_keywords):
        raise SeedError("the tool slid out at pose 3")

    monkeypatch.setattr(find_out, "STEPS", {"spring": ("identify",)})
    monkeypatch.setattr(find_out, "identify", fails)
    run = score.one_draw(SETTINGS, 3)
    assert (run["finished"], run["error"]) == (False, "identify: the tool slid out at pose 3")
    assert "force_z" not in run


# -- the command


def test_the_command_keeps_single_runs_known_and_refuses_what_would_be_ignored(capsys):
    for arguments, words in (
        (["squeegee", "--world", "known", "--draws", "3"], "belongs to hidden worlds"),
        (["squeegee", "--draws", "3", "--scenarios", "2"], "belongs to known worlds"),
    ):
        with pytest.raises(SystemExit):
            command.main(arguments)
        assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--perturb", "mass", "--model", "bushing"], "--model has no part in --perturb"),
        (["--perturb", "mass", "--out", "draws.jsonl"], "--out has no part in --perturb"),
        (["--perturb", "mass", "--membrane", "0"], "--membrane has no part in --perturb"),
        (["--perturb", "mass", "--scenarios", "2"], "--scenarios has no part in --perturb"),
        (["--model", "bushing"], "--model belongs to hidden worlds: give --world hidden"),
        (["--draws", "2", "--column", "nominal"], "--column belongs to known worlds: give --scenario NAME"),
        (["--draws", "2", "--membrane", "0"], "--membrane belongs to known worlds: give --membranes"),
        (["--draws", "2", "--late-stamps", "--estimator", "noisy"], "--late-stamps is of images"),
        (["--scenarios", "1", "--membrane", "2"], "--membrane is of one run"),
        (["--scenarios", "1", "--scenario", "slip20", "--column", "nominal"], "give one of them"),
    ],
)
def test_an_option_that_would_have_no_effect_is_refused(arguments, words, capsys):
    with pytest.raises(SystemExit, match="2"):
        command.main(["squeegee", *arguments])
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("where", [["--draws", "1"], ["--perturb", "stiffness_-20"]])
def test_a_spring_is_not_identified_where_membranes_hold_the_tool(where, capsys):
    assert command.main(["squeegee", "--scenario", "membrane", *where]) == 2
    assert "scenario 'membrane': grasp.kind = membrane: the grasp of this world is a spring" in capsys.readouterr().err


@pytest.mark.parametrize("where", [["--draws", "1"], ["--perturb", "none"]])
def test_a_task_for_another_tool_is_refused_in_a_world_too(where, capsys):
    assert command.main(["pen", "--scenario", "nominal", *where]) == 2
    assert "task 'pen' is made for the tool 'pen', and the hand holds 'squeegee'" in capsys.readouterr().err


def test_a_grasp_taken_under_load_is_refused_where_it_would_have_no_effect():
    loaded = replace(NOMINAL, grasp=replace(NOMINAL.grasp, taken_under=(0.0, 0.0, -1.96)))
    with pytest.raises(SeedError, match=r"grasp.taken_under = \[0.0, 0.0, -1.96\] N: a hidden world's grasp"):
        run_trial("squeegee", World(), 3, scenario=loaded)


def test_a_map_of_membranes_is_not_asked_of_a_spring(capsys):
    assert command.main(["squeegee", "--draws", "1", "--model", "membrane"]) == 2
    assert "model = membrane: the grasp of this world is a spring; give --membranes" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["spring", "membrane"])
def test_a_model_that_no_identification_is_made_into_is_refused_not_replaced(kind):
    """Once it is among the names that `wrench.model` may have, the command takes it, too."""
    words = "model = mine: no identification of a hidden world is made into it; those that are: bushing, hysteretic"
    with pytest.raises(SeedError, match=words):
        run_trial("squeegee", draw.draw_world(1, kind), 1, model="mine")
    with pytest.raises(SeedError, match=words):
        find_out.find_out(NOMINAL, draw.draw_world(1, kind), 1, model="mine")


def test_every_model_that_may_be_asked_for_is_made_of_membranes():
    assert find_out.MODELS["membrane"] == WRENCH_MODELS


@pytest.mark.parametrize("name", ["mounts", "hanging", "late_60", "all"])
@pytest.mark.parametrize("estimator", ["truth", "noisy"])
def test_what_images_alone_show_is_not_perturbed_without_them(name, estimator, capsys):
    assert command.main(["squeegee", "--perturb", name, "--estimator", estimator]) == 2
    assert f"is of images, which the estimator '{estimator}' does not look at" in capsys.readouterr().err


def test_perturbations_and_baselines_that_are_none_are_refused(capsys):
    assert command.main(["squeegee", "--perturb", "gravity"]) == 2
    assert "perturbation 'gravity' is unknown; known: all, none" in capsys.readouterr().err
    assert command.main(["squeegee", "--draws", "1", "--law", "welded"]) == 2
    assert "baseline" in capsys.readouterr().err


def test_a_stiffness_that_nobody_knows_costs_its_share_of_the_spring_force_and_is_told_in_its_row():
    how = {"law": "seed", "estimator": "truth", "force": None, "scenario": "nominal"}
    (row,) = perturb.perturbed(["stiffness_-20"], "squeegee", [3], **how)
    weight = NOMINAL.tool.mass * 9.81
    assert row["force_z"]["rmse"] == pytest.approx(0.2 * (10.0 - weight), rel=0.05)  # the spring bears 10 N less it
    assert row["believed_z"]["rmse"] < 0.05
    assert row["believed_z"]["error"] == pytest.approx(row["force_z"]["rmse"], abs=0.05)
    text = perturb.table([row])
    assert "stiffness of the force axis x0.8" in text
    assert "finished; before contact: while the tool hangs free or is still carried, the grasp's wrench differs" in text


def test_of_several_seeds_median_90_per_cent_and_worst_are_told():
    how = {"law": "seed", "estimator": "truth", "force": None, "scenario": "nominal"}
    rows = perturb.perturbed(["mass"], "squeegee", [3, 4], **how)
    assert [(r["perturbation"], r["seed"]) for r in rows] == [("mass", 3), ("mass", 4)]
    head, names, mass = perturb.table(rows).splitlines()
    assert head == "median / 90 % / worst"
    assert "true force [N]" in names
    median, _, worst = (float(v) for v in re.findall(r"[\d.]{5}", mass)[:3])
    assert 0.05 < median <= worst < 0.3
    assert mass.endswith("2 of 2; 0 of 2")


def test_a_pose_that_is_told_is_off_by_what_the_world_says():
    task = load_task("squeegee")
    plant = Plant(NOMINAL, 1, task.frame.pose, start_pose(NOMINAL, task))
    poses = WorldPoses(NOMINAL, World(images=ImageWorld(zero_mm=(0.0, 0.0, 0.3))), 1)
    assert 1e3 * poses.measure(plant, plant.time).X_CT[:3, 3] == pytest.approx([0.0, 0.0, 0.3], abs=0.03)


def test_identified_in_draws_the_hysteretic_spring_presses_truer_than_the_linear_one():
    result = identify_draws([31])
    error = result["summary"]["force_error"]
    assert error["hysteretic"]["worst"] < 0.3 * error["linear"]["worst"]
    assert result["summary"]["within_two_deviations"] == 1.0
    assert "31" in identify_table(result)


class Found:
    """An analysis that has the tool lost at poses of the work, or not; with a map, or without."""

    def __init__(self, lost: bool, refused: str = "") -> None:
        self.not_borne = ("0/053-work",) if lost else ()
        self.membrane, self.membrane_refused = None if refused else "map", refused


@pytest.mark.parametrize(("found_from", "closed"), [(0.002, 0.002), (0.006, 0.006), (np.inf, None)])
def test_a_gripper_is_closed_further_while_the_tool_is_lost(found_from: float, closed: float | None) -> None:
    scenario = on_membrane(load_scenario("nominal"), 7400, firm=True)

    def identified(at: Scenario) -> tuple[Found, str]:
        if at.membrane.squeeze - scenario.membrane.squeeze < found_from - 1e-9:
            raise session.ToolLostError("the estimator has not followed the tool")
        return Found(lost=False), "map"

    if closed is None:
        with pytest.raises(session.ToolLostError):
            membranes.closed_until_borne(scenario, identified)
        return
    at, _, _ = membranes.closed_until_borne(scenario, identified)
    assert at.membrane.squeeze - scenario.membrane.squeeze == pytest.approx(closed)


@pytest.mark.parametrize(("shows_from", "closed"), [(0.0, 0.0), (0.003, 0.004), (np.inf, None)])
def test_a_gripper_is_closed_further_until_its_grasp_shows_a_map(shows_from: float, closed: float | None) -> None:
    scenario = on_membrane(load_scenario("nominal"), 7400)

    def identified(at: Scenario) -> tuple[Found, float]:
        further = at.membrane.squeeze - scenario.membrane.squeeze
        return Found(lost=False, refused="" if further >= shows_from else "hardly moved along pitch"), further

    if closed is None:
        with pytest.raises(SeedError, match="no membrane map: hardly moved along pitch"):
            membranes.closed_until_borne(scenario, identified)
        return
    assert membranes.closed_until_borne(scenario, identified)[2] == pytest.approx(closed)


@pytest.mark.parametrize(
    ("bears_from", "tears_at", "closed"),
    [
        (0.0, np.inf, 0.0),
        (0.001, np.inf, 0.002),
        (0.003, np.inf, 0.004),
        (np.inf, np.inf, 0.006),
        (0.003, 0.004, 0.002),
    ],
)
def test_a_gripper_is_closed_further_until_the_grasp_bears_its_work(
    bears_from: float, tears_at: float, closed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = on_membrane(load_scenario("nominal"), 7400, firm=True)
    squeeze = scenario.membrane.squeeze

    def identified(believed: Scenario, *_: object) -> Found:
        further = believed.membrane.squeeze - squeeze
        if further >= tears_at:
            raise SeedError("the tool pierces the left membrane")
        return Found(lost=further < bears_from)

    monkeypatch.setattr(membranes, "_identified", identified)
    believed, found = membranes.identify_membranes(scenario, World(), 7400)
    assert believed.membrane.squeeze - squeeze == pytest.approx(closed)
    assert bool(found.not_borne) == (closed < bears_from)

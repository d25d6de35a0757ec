# SPDX-License-Identifier: Apache-2.0
"""The closed loop without ROS: what it achieves, that it repeats, and what the command line says."""

import contextlib
import inspect
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_control.state import ControllerState
from seed_control.tasks import load_task
from seed_core.bushing import Bushing, Stiffness
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Frame
from seed_core.wrench_model import BushingModel, SpringWrench
from seed_sim import PoseSource, evaluate
from seed_sim.closed_loop.command import _parser, _table, _text, main
from seed_sim.closed_loop.evaluate import load_both
from seed_sim.closed_loop.recording import Recording, score, scored_phase, torque_axes_of
from seed_sim.closed_loop.relative_poses import pose_source
from seed_sim.closed_loop.run import SeedSteering, play, start_pose
from seed_sim.closed_loop.surface_score import surface_score
from seed_sim.closed_loop.sweep import column_summary, plot, summary
from seed_sim.comparison.score import scores_of
from seed_sim.membrane import MembraneParameters
from seed_sim.plant.plant import Plant
from seed_sim.replay.plots import run_figure
from seed_sim.scenario import load_scenario
from seed_sim.world.trial import beliefs

SHORT = """
name: squeegee
tool: squeegee
frame: {position: 0.45 0.0 0.0 m, rpy: 0 0 0 deg}
phases:
  - name: approach
    to: 0 0 0.015 m
    speed: 0.1 m/s
  - name: press
    control: &pressing
      force: 0 0 -10 N
      force_directions: [z]
      torque: 0 0 0 N m
      torque_axes: [x]
      contact_resists: [x]
    until: settled
    dwell: 0.3 s
  - name: wipe
    to: 0.1 0 0 m
    speed: 0.05 m/s
    control: *pressing
  - name: lift
    to: 0.1 0 0.05 m
    speed: 0.1 m/s
"""


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A task file whose wipe is short enough for a test: two seconds."""
    file: Path = tmp_path_factory.mktemp("tasks") / "short.yaml"
    file.write_text(SHORT)
    return str(file)


def printed(arguments: list[str]) -> dict:
    """The one JSON object that the command line prints."""
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main([*arguments, "--json"]) == 0
    return json.loads(out.getvalue())


@pytest.fixture(scope="module")
def held(short: str) -> dict:
    """SEED with exact poses."""
    return printed([short, "--scenario", "nominal", "--force", "8", "--seed", "1003"])


@pytest.fixture(scope="module")
def swept(short: str, tmp_path_factory: pytest.TempPathFactory) -> dict:
    """The welded baseline over two seeds, as a sweep."""
    plot = tmp_path_factory.mktemp("plots") / "sweep.png"
    result = printed(
        [
            short,
            "--law",
            "welded",
            "--force",
            "8",
            "--scenarios",
            "2",
            "--seed",
            "1003",
            "--column",
            "nominal",
            "--plot",
            str(plot),
        ]
    )
    assert plot.stat().st_size > 1000
    return result["columns"]["nominal"]


def test_json_has_the_documented_keys(held):
    for key in ("force_z", "torque_x"):
        assert set(held[key]) == {"rmse", "mean", "max_abs_error"}
    assert set(held["lean_deg"]) == {"rms", "max"}
    assert {"path_rmse_mm", "real_time_factor", "contact"} <= set(held)
    assert held["real_time_factor"] > 0.0


def test_the_seed_is_the_command_lines_where_none_is_named():
    assert inspect.signature(evaluate).parameters["seed"].default == _parser().get_default("seed") == 7


def test_a_task_is_named_by_its_path_too(short):
    assert load_both(Path(short), "nominal", 8.0) == load_both(short, "nominal", 8.0)


def test_force_and_equal_pressure_are_held_with_exact_poses(held):
    assert held["finished"]
    assert held["contact"]["made"]
    assert_allclose(held["force_z"]["mean"], -8.0, atol=0.2)
    assert held["force_z"]["rmse"] < 0.2  # [N]
    assert held["torque_x"]["rmse"] < 0.04  # [N m]


def test_result_repeats_to_the_last_bit_but_for_the_clock(short, held):
    again = evaluate(short, force=8.0, seed=1003, scenario="nominal").result
    assert {k: v for k, v in again.items() if k != "real_time_factor"} == {
        k: v for k, v in held.items() if k != "real_time_factor"
    }


def test_welded_tool_presses_unevenly_where_the_grasp_gives_way(held, swept):
    welded = swept["runs"][0]
    assert welded["contact"]["made"]
    assert welded["seed"] == held["seed"]
    assert welded["torque_x"]["rmse"] > 5.0 * held["torque_x"]["rmse"]


def test_a_bolted_tool_keeps_no_force_error_on_a_slope(swept):
    for run in swept["runs"]:
        assert_allclose(run["force_z"]["mean"], -8.0, atol=0.1)  # a pure integrator would be off by 0.46


@pytest.mark.parametrize(("axes", "roll"), [((False, False, False), 10.0), ((True, False, False), 0.0)])
def test_roll_is_lean_where_no_torque_turns_it(axes, roll):
    n = 10
    rows = {
        "t": np.arange(n, dtype=float),
        "phase": np.zeros(n, dtype=int),
        "lean": np.tile((np.deg2rad(10.0), 0.0, 0.0), (n, 1)),
        **{name: np.zeros((n, 3)) for name in ("torque_T", "wanted_torque_T", "tip", "reference")},
        **{name: np.tile((0.0, 0.0, -8.0), (n, 1)) for name in ("force", "wanted_force")},
    }
    recording = Recording(["wipe"], axes, {name: list(row) for name, row in rows.items()})
    assert_allclose(score(recording, "wipe")["lean_deg"]["max"], roll, atol=1e-9)


def test_a_task_without_torque_turns_no_axis():
    task = load_task("squeegee")
    assert torque_axes_of(task) == (True, False, False)
    without = [replace(p, control=replace(p.control, torque_axes=()) if p.control else None) for p in task.phases]
    assert torque_axes_of(replace(task, phases=tuple(without))) == (False, False, False)


def test_sweep_reports_every_seed_and_summaries(swept):
    assert [r["seed"] for r in swept["runs"]] == [1003, 1004]
    assert swept["runs"][0]["contact"]["time"] != swept["runs"][1]["contact"]["time"]  # another seed, another table
    rmse = [r["force_z"]["rmse"] for r in swept["runs"]]
    assert_allclose(swept["force_z_rmse"]["mean"], np.mean(rmse))
    assert_allclose(swept["force_z_rmse"]["max"], max(rmse))
    assert set(swept["lean_deg_max"]) == {"mean", "p95", "max"}


@pytest.mark.parametrize("up", [(0.0, 0.0, -1.0), (0.0, 1.0, 0.0)])
def test_an_arm_on_a_ceiling_or_a_wall_holds_the_force(up, short):
    cell = load_scenario("nominal")
    done = evaluate(short, scenario=replace(cell, hand=replace(cell.hand, up=up)), seed=3)
    assert done.result["finished"]
    assert done.result["force_z"]["rmse"] < 0.01  # [N]; 4 N with gravity along -z


@pytest.mark.parametrize(("aside", "force", "most"), [(0.1, 6.0, 0.4), (0.15, 4.0, 0.6)])
def test_a_tip_beside_the_axis_of_the_grasp_is_pressed_without_overshoot(aside, force, most):
    """The press turns the grasp; where the gripper turns back, the tip must not be pressed on by that."""
    cell = load_scenario("pen")
    cell = replace(cell, tool=replace(cell.tool, T_tip=Frame((aside, 0.0, 0.05))))
    exact, noisy = (evaluate("pen", scenario=cell, force=force, seed=3, estimator=e) for e in ("truth", "noisy"))
    rows = exact.recording.rows
    touching = [exact.recording.phases[i].endswith("touch") for i in rows["phase"]]
    assert -np.array(rows["force"])[touching, 2].min() < 1.02 * force  # was 1.24 times it at 150 mm
    assert exact.result["finished"]
    assert noisy.result["finished"]  # the arm held at 150 mm
    assert noisy.result["force_z"]["rmse"] < most


def test_late_noisy_poses_on_an_arm_with_joints_still_hold_the_force(short, tmp_path):
    file = tmp_path / "arm.yaml"
    file.write_text("servo: {arm: ur10e}\ntable: {tilt_x: 0.5, tilt_y: 0, height: 1}")
    done = evaluate(short, estimator="noisy", seed=1000, scenario=file)
    assert len(done.plant.arm.q) == 6
    assert done.result["finished"]
    assert 0.01 < done.result["force_z"]["rmse"] < 1.0  # [N]; noise costs something, not contact


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["squeegee", "--scenario", "calm"], "scenario 'calm' is unknown"),
        (["sqeegee"], "no task 'sqeegee'"),
        (["squeegee", "--scenario", "missing.yaml"], "cannot be read"),
    ],
)
def test_wrong_arguments_are_named(arguments, words, capsys):
    assert main(arguments) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("force", ["-5", "0", "201"])
def test_a_force_that_no_task_can_have_is_refused_in_one_way(force, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["squeegee", "--force", force])
    assert f"argument --force: {force} must be a number from 0.1 to 200 N;" in capsys.readouterr().err
    with pytest.raises(SeedError, match=f"^force = {force} N must be from 0.1 to 200 N$"):
        evaluate("squeegee", force=float(force))


@pytest.mark.parametrize(
    "arguments",
    [
        ["squeegee", "--law", "best"],
        ["squeegee", "--estimator", "guess"],
        ["squeegee", "--seed", "x"],
        ["squeegee", "--column", "nominal"],
    ],
)
def test_unknown_choices_are_named_in_one_line(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert arguments[1] in told
    assert told.endswith("seed evaluate --help tells more\n")
    assert told.count("\n") == 1


def test_summary_of_known_numbers():
    assert summary([1.0, 2.0, 3.0]) == {"mean": 2.0, "p95": 2.9, "max": 3.0}


def stopped_early(contact: bool) -> Recording:
    """A run that ended in its approach, or as it touched."""
    recording = Recording(["approach", "press", "wipe"])
    pressing = np.array((0.0, 0.0, -8.0)) if contact else np.zeros(3)
    still = {name: np.zeros(3) for name in ("torque_T", "wanted_torque_T", "tip", "reference", "lean")}
    for k in range(10):
        recording.add(t=0.004 * k, phase=int(contact), force=pressing, wanted_force=pressing, **still)
    return recording


@pytest.mark.parametrize("contact", [False, True])
def test_a_run_that_stops_before_it_is_scored_has_no_figures(held, contact):
    scored = score(stopped_early(contact), "wipe")
    assert scored["samples"] == 0
    figures = [*scored["force_z"].values(), *scored["torque_x"].values(), *scored["lean_deg"].values()]
    assert np.isnan([*figures, scored["path_rmse_mm"]]).all()
    told = _text({**held, **scored, "message": "the estimate is stale"})
    assert "nothing to score" in told
    assert "the estimate is stale" in told
    assert "0.000" not in told
    assert "rmse" not in told


def test_a_tool_that_is_lost_before_the_first_set_point_is_a_run_that_is_not_scored(short):
    """Eight kilograms, of which the controller knows one, tear the tool out as the holder lets go."""
    squeegee = load_scenario("nominal").tool
    scenario = replace(
        load_scenario("membrane"),
        tool=replace(squeegee, mass=1.0, center_of_mass=(0.0, 0.2, 0.0)),
        true_mass=8.0,
        membrane=MembraneParameters(spacing=0.008, squeeze=0.0125),
    )
    done = evaluate(short, scenario=scenario, seed=1)
    assert not done.recording.rows
    assert (done.result["finished"], done.result["samples"]) == (False, 0)
    assert "the tool pierces the left membrane" in done.result["message"]
    run_figure(done.recording, "wipe", "a wipe")  # nothing to draw is no error either


def test_every_score_takes_a_run_without_rows():
    empty, follow = Recording(["press", "along"]), load_task("follow")
    assert surface_score(empty, follow)["force_rms"] == -follow.phases[-2].control.force[2]
    assert beliefs(empty, "along")["believed_z"] is None
    assert scores_of(empty, 10.0)["rms"] == 10.0
    with pytest.raises(KeyError):
        empty["forces"]


@pytest.fixture(scope="module")
def missed(short: str, tmp_path_factory: pytest.TempPathFactory) -> dict:
    """A sweep of one run, whose table lies deeper than the tool may go in search of it."""
    file = tmp_path_factory.mktemp("low") / "low.yaml"
    file.write_text("table: {tilt_x: 0, tilt_y: 0, height: -50}")
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main([short, "--scenarios", "1", "--scenario", str(file), "--json"]) == 1
    return json.loads(out.getvalue())


def test_a_sweep_in_which_no_run_was_scored_fails_and_says_why(missed):
    (column,) = missed["columns"].values()
    assert (column["scored"], column["failed"]) == (0, [7])
    assert column["runs"][0]["force_z"]["rmse"] is None
    assert "no run was scored: arm holds: no contact within" in _table(missed)


def test_a_run_that_was_not_scored_counts_in_no_mean(held, missed, tmp_path):
    (column,) = missed["columns"].values()
    both = column_summary([held, *column["runs"]])
    assert (both["scored"], both["failed"]) == (1, [7])
    assert both["force_z_rmse"]["mean"] == held["force_z"]["rmse"]
    assert both["lean_deg_rms"]["mean"] == held["lean_deg"]["rms"]
    swept = {**missed, "columns": {"low": column, "both": both}}
    assert "1 of 2  [7]" in _table(swept)
    plot(swept, tmp_path / "sweep.png")
    assert (tmp_path / "sweep.png").stat().st_size > 1000
    (tmp_path / "full.png").symlink_to("/dev/full")
    with pytest.raises(OSError, match=r"No space left on device: '.*full\.png'"):
        plot(swept, tmp_path / "full.png")


def test_failed_run_is_told_and_not_averaged():
    good = {
        "seed": 1,
        "finished": True,
        "samples": 500,
        "force_z": {"rmse": 0.1},
        "torque_x": {"rmse": 0.0},
        "lean_deg": {"rms": 1.0, "max": 2.0},
    }
    out = column_summary([good, {"seed": 2, "finished": False, "error": "diverged"}])
    assert out["failed"] == [2]
    assert out["force_z_rmse"]["mean"] == 0.1
    assert len(out["runs"]) == 2


def test_a_recording_tells_phases_of_one_name_apart_and_scores_the_pieces_of_a_wipe(tmp_path: Path) -> None:
    file = tmp_path / "task.yaml"
    names = ("go", "back", "go")
    phases = "".join(f"  - {{name: {n}, to: {0.01 * (i % 2)} 0 0.05 m}}\n" for i, n in enumerate(names))
    file.write_text(f"name: small\nframe: {{position: 0.45 0 0 m}}\nphases:\n{phases}")
    task, scenario = load_task(file), load_scenario("nominal")
    plant = Plant(scenario, 0, task.frame.pose, start_pose(scenario, task))
    recording = play(task, plant, SeedSteering(plant, scenario, "seed", "truth", 0))
    assert recording.finished
    assert list(dict.fromkeys(recording["phase"])) == [0, 1, 2]
    rows = {"t": [0.0, 3.0, 4.0, 5.0], "phase": [0, 1, 2, 3], "force": [(0.0, 0.0, -1.0)] * 4}
    assert list(Recording(["press", "wipe", "wipe 2", "wiper"], rows=rows).scored("wipe")) == [False, True, True, False]


def test_phase_that_counts_is_the_wipe_the_strokes_or_the_last_force():
    from seed_control.tasks import load_task

    assert [scored_phase(load_task(n)) for n in ("squeegee", "pen", "peg", "torque_driver")] == [
        "wipe",
        "draw",
        "press",
        "tighten",
    ]


@pytest.mark.parametrize("seed", [1, 2, 108, 141, 145])
def test_a_grasp_that_is_stiff_but_turns_easily_wipes_a_rough_table(seed: int) -> None:
    """As membranes on flat sides hold: what its place is off by presses a blade sideways, and it sticks and slips."""
    nominal = load_scenario("nominal")
    held = Stiffness(rotation=(1.0, 4.0, 0.8), translation=(4500.0, 7000.0, 2900.0))
    scenario = replace(
        nominal,
        grasp=replace(nominal.grasp, stiffness=held),
        table=replace(nominal.table, friction=0.7),
        measurement=replace(nominal.measurement, position_noise=0.04, rotation_noise=0.08),
    )
    result = evaluate("squeegee", estimator="noisy", seed=seed, scenario=scenario).result
    assert result["finished"]
    # [N]; 1.6 at seed 2 when all of the turn was fed forward, 0.3 to 0.7 at the last three when roll answered yaw
    assert result["force_z"]["rmse"] < 0.2
    assert result["torque_x"]["rmse"] < 0.1  # [N m]
    assert result["lean_deg"]["max"] < 4.0


def test_exact_poses_of_a_grasp_that_lifts_its_tip_as_it_is_pressed_keep_the_force(tmp_path: Path) -> None:
    """A tilted table and a turning grasp: the tip rises while the gripper goes down, which no soft table does."""
    file = tmp_path / "tilted.yaml"
    file.write_text(
        "name: tilted\ngrasp: {stiffness: {rotation: [3.2, 2.4, 3.2], translation: [640.0, 960.0, 640.0]}}\n"
        "table: {tilt_x: [3.0, 3.0], tilt_y: [-2.0, -2.0], friction: 0.6, total_stiffness: 3000.0}\n"
    )
    result = printed(["squeegee", "--scenario", str(file)])
    assert result["force_z"]["rmse"] < 0.05


class _Late(SeedSteering):
    """The controller's picture with the true wrench of 20 steps ago in place of its own."""

    def sense(self, t: float) -> ControllerState:
        state, kept = super().sense(t), self.__dict__.setdefault("kept", [])
        kept.append((t, self._plant.contact_wrench))
        then, load = kept[max(len(kept) - 21, 0)]
        return state._replace(stamp=t, image_age=t - then, estimated=load.rotated(state.R_W_task.T))


def test_the_error_of_a_wrench_is_the_one_at_its_stamp(short: str) -> None:
    task, scenario = load_task(short, 8.0), load_scenario("nominal")
    plant = Plant(scenario, 3, task.frame.pose, start_pose(scenario, task))
    recording = play(task, plant, _Late(plant, scenario, "seed", "truth", 3))
    assert np.abs(recording["believed_force"][:, 2] - recording["force"][:, 2]).max() > 1.0  # [N]; it is late
    assert_allclose(recording["wrench_error"], 0.0, atol=1e-9)


class Mine(PoseSource):
    """An estimator of one's own: it takes a fifth of the tool's motion for none."""

    def measure(self, plant: Plant, stamp: float) -> RelativePoseEstimate:
        X_CT = plant.X_CT.copy()
        X_CT[:3, 3] *= 0.8
        return RelativePoseEstimate(stamp, X_CT, 1e-8 * np.eye(6))


class Harder:
    """A wrench model of one's own: a spring harder by a quarter than it is."""

    name = "harder"

    def __init__(self, stiffness: Stiffness) -> None:
        self.stiffness = stiffness.scaled(1.25)
        self._map = BushingModel(Bushing(self.stiffness))

    def spring(self, estimate: RelativePoseEstimate) -> SpringWrench:
        return self._map.spring(estimate)


def test_an_estimator_and_a_wrench_model_of_ones_own_are_scored(short: str) -> None:
    """What either gets wrong shows in the force: a spring that is believed to be too soft or too hard by a fifth."""
    scenario = load_scenario("nominal")
    how = {"force": 8.0, "seed": 1003, "scenario": scenario}
    run = evaluate(short, poses=Mine(scenario, 250.0, 0.0, np.eye(4)), **how)
    assert run.result["finished"]
    assert run.result["estimator"] == "Mine"
    weight = 9.81 * scenario.tool_mass
    assert run.result["force_z"]["mean"] == pytest.approx(-8.0 - (8.0 - weight) * 0.25, abs=0.15)
    run = evaluate(short, wrench_model=Harder(scenario.grasp.stiffness), **how)
    assert run.result["finished"]
    assert run.result["force_z"]["mean"] == pytest.approx(-8.0 + (8.0 - weight) * 0.2, abs=0.15)


def test_a_baseline_takes_neither(short: str) -> None:
    poses = Mine(load_scenario("nominal"), 250.0, 0.0, np.eye(4))
    with pytest.raises(SeedError, match="goes by neither poses nor a wrench_model"):
        evaluate(short, law="welded", poses=poses)


def test_a_known_world_has_the_estimator_of_its_scenario() -> None:
    scenario = replace(load_scenario("nominal"), estimator={"erosion": 6})
    source = pose_source("rigid_fit", scenario, 0, 250.0)
    assert source.estimator.parameters.erosion == 6
    assert source.estimator.parameters.method == "rigid_fit"


@pytest.mark.parametrize("estimator", ["truth", "noisy", "rigid_fit"])
def test_a_mistake_in_the_section_estimator_is_named_whatever_the_estimator(estimator, tmp_path, capsys) -> None:
    file = tmp_path / "mistaken.yaml"
    file.write_text("name: mistaken\nestimator: {erosoin: 6}")
    assert main(["squeegee", "--scenario", str(file), "--estimator", estimator]) == 2
    assert "scenario mistaken: estimator: unknown key 'erosoin'" in capsys.readouterr().err


def test_a_calibration_is_refused_where_none_is_carried_out(tmp_path, capsys) -> None:
    file = tmp_path / "calibrated.yaml"
    file.write_text("name: calibrated\ncalibrate: true")
    asked = ["squeegee", "--scenario", str(file)]
    for where in ([], ["--perturb", "mass"]):
        assert main([*asked, "--estimator", "rigid_fit", *where]) == 2
        assert "carries out no calibration: leave it out" in capsys.readouterr().err


def test_a_task_that_never_touched_is_not_scored(held):
    missed = {**held, "contact": {"made": False}, "message": "no table"}
    assert _text(missed).splitlines()[1:] == ["  no contact, so nothing to score; no table"]
    assert "force z" in _text(held)


def test_one_run_is_drawn_into_the_folder_that_is_named(short: str, tmp_path: Path) -> None:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
        assert main([short, "--force", "8", "--seed", "1003", "--plot", str(tmp_path)]) == 0
    (file,) = tmp_path.iterdir()
    assert said.getvalue().endswith(f"plot: {file}\n")
    assert file.stat().st_size > 10_000


def test_a_recording_is_shown_without_its_rows() -> None:
    assert repr(Recording(["wipe"], rows={"t": [0.0] * 1000})) == repr(Recording(["wipe"]))


def test_a_run_is_drawn_from_above_beside_its_force_over_time() -> None:
    t = np.linspace(0.0, 6.0, 61)
    pressing = np.where(t > 1.0, -8.0, 0.0)[:, None] * (0.0, 0.0, 1.0)
    path = np.column_stack([0.02 * t, 0.0 * t, 0.0 * t])
    rows = {
        "t": t,
        "phase": np.where(t > 1.0, 1, 0),
        "force": pressing,
        "wanted_force": pressing,
        "torque_T": pressing[:, ::-1],
        "wanted_torque_T": 0.0 * pressing,
        "tip": path,
        "reference": path,
    }
    figure = run_figure(Recording(["approach", "wipe"], rows={k: list(v) for k, v in rows.items()}), "wipe", "a wipe")
    from_above, over_time = figure.subfigs
    force, torque = over_time.axes
    drawn = {line.get_label(): line for line in force.lines + from_above.axes[0].lines}
    assert_allclose(drawn["true"].get_ydata(), -pressing[:, 2])
    assert_allclose(torque.lines[0].get_ydata(), pressing[:, 2])
    assert torque.get_ylabel() == "torque about the tool's x [N m]"
    assert [text.get_text() for text in force.texts] == ["approach", "wipe"]


@pytest.mark.parametrize("more", [[], ["--scenarios", "1"]])
def test_a_plot_that_is_no_picture_is_refused_before_the_run(more, tmp_path: Path, capsys) -> None:
    file = tmp_path / "new" / "plot.txt"
    assert main(["squeegee", "--plot", str(file), *more]) == 2
    words = f"seed evaluate: --plot {file}: name a folder, or a file that ends in one of: .png, .jpg, .svg, .pdf\n"
    assert capsys.readouterr().err == words
    assert not list(tmp_path.iterdir())


def test_a_plot_of_hidden_worlds_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["squeegee", "--draws", "2", "--plot", "x.png"])
    assert "--plot is of one run" in capsys.readouterr().err

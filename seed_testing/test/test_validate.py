# SPDX-License-Identifier: Apache-2.0
"""Scores against sums done by hand, trajectories as promised, and the command's JSON."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.config import ConfigError
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import pose_from_rpy, so3_exp
from seed_sim.scenario import load_scenario, on_membrane, shipped_scenarios, tactile_of
from seed_sim.tactile import TactileParameters
from seed_sim.tactile.trajectory import TrajectorySection, poses
from seed_testing.validation import command as validate
from seed_testing.validation import run, slip
from seed_testing.validation.scores import AXES, NAMED, Series, components, errors, scores

SHIPPED = ("long_cylinder", "short_handle", "box", "marker", "large_rotation", "slip05", "slip20", "bright30", "d405",
           "noise2x", "one_finger", "range_offset")  # fmt: skip


def series(noise=0.0, gain=1.0, offset=0.0, invalid=0, sigma=1e-3, seed=0):
    """A made-up run: estimate = gain truth + offset [mm, deg] + white noise of sigma."""
    rng, out = np.random.default_rng(seed), Series()
    for i, (stamp, X) in enumerate(poses(TrajectorySection(duration=20.0), 3)):
        v = gain * components(X) + offset
        X_est = pose_from_rpy(np.deg2rad(v[3:]), 1e-3 * v[:3])
        X_est[:3, :3] = so3_exp(noise * sigma * rng.standard_normal(3)) @ X_est[:3, :3]
        X_est[:3, 3] += noise * sigma * rng.standard_normal(3)
        out.add(X, RelativePoseEstimate(stamp, X_est, np.eye(6) * sigma**2, valid=i >= invalid), 2.0)
    return out


def test_trajectory_has_the_promised_size_on_every_axis():
    values = np.array([components(X) for _, X in poses(TrajectorySection(), 1000)])
    assert_allclose(np.sqrt((values**2).mean(axis=0)), (4.5, 2.1, 3.0, 8.0, 6.0, 6.0), rtol=1e-6)
    assert_allclose(values[0], 0.0, atol=0.05)
    assert np.abs(np.diff(values, axis=0)).max() < 1.5  # [mm or deg] per frame


def test_trajectory_moves_axes_independently():
    values = np.array([components(X) for _, X in poses(TrajectorySection(duration=60.0), 7)])
    assert np.abs(np.corrcoef(values.T) - np.eye(6)).max() < 0.5


def test_peaks_replace_rms():
    section = TrajectorySection(peak_deg=(20.0, 30.0, 10.0))
    values = np.array([components(X) for _, X in poses(section, 5)])
    assert_allclose(np.abs(values[:, 3:]).max(axis=0), (20.0, 30.0, 10.0), rtol=1e-6)


def test_other_seed_other_trajectory():
    (_, a), (_, b) = (list(poses(TrajectorySection(duration=3.0), seed))[-1] for seed in (1, 2))
    assert np.abs(a - b).max() > 1e-3


def test_perfect_estimate_scores_zero():
    out = scores(series())
    for name in NAMED:
        assert_allclose(out["rmse"][name], 0.0, atol=1e-9)
    for axis in AXES:
        assert_allclose((out["gain"][axis], out["correlation"][axis]), 1.0)
    assert out["valid_fraction"] == 1.0


def test_gain_and_bias_are_told_apart():
    out = scores(series(gain=0.9))
    assert_allclose([out["gain"][a] for a in AXES], 0.9)
    out = scores(series(offset=np.array((0.5, 0, 0, 0, 0, 0))))
    assert_allclose((out["bias"]["x_mm"], out["rmse"]["x_mm"], out["gain"]["x"]), (0.5, 0.5, 1.0))


def test_rotation_error_is_the_rotation_vector_in_C():
    X = pose_from_rpy((0.3, -0.2, 0.5), (0, 0, 0))
    turned = X.copy()
    turned[:3, :3] = so3_exp((0.0, 0.01, 0.0)) @ X[:3, :3]
    assert_allclose(errors(RelativePoseEstimate(0.0, turned), X)[3:], (0.0, np.rad2deg(0.01), 0.0), atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_honest_covariance_lies_within_its_bounds(seed):
    out = scores(series(noise=1.0, seed=seed))
    assert_allclose(out["nees"], 6.0, atol=0.6)
    assert_allclose(out["nees_frames_within_95_percent"], 0.95, atol=0.03)


def test_boastful_covariance_leaves_its_bounds():
    assert not scores(series(noise=2.0))["nees_within_bounds"]
    assert not scores(series(noise=0.5))["nees_within_bounds"]


def test_invalid_frames_count_and_are_not_scored():
    out = scores(series(invalid=90))
    assert_allclose(out["valid_fraction"], 1.0 - 90 / 900)
    assert scores(series(invalid=900))["rmse"]["x_mm"] is None
    json.dumps(scores(series(invalid=900)), allow_nan=False)


def test_scoring_starts_when_it_should():
    assert scores(series(), score_from=10.0)["frames"] == 451


def test_scenario_file_of_the_documentation_loads(tmp_path):
    text = Path(__file__).parents[2].joinpath("docs", "tactile_simulation.md").read_text(encoding="utf-8")
    file = tmp_path / "my_tool.yaml"
    (of_validate,) = (block for block in text.split("```yaml\n")[1:] if block.startswith("name: my_tool"))
    file.write_text(of_validate.split("```")[0], encoding="utf-8")
    scenario = load_scenario(file, *run.FOLDERS)
    assert tactile_of(scenario).tool.kind == "box"
    assert scenario.trajectory.rotation_deg == (5.0, 10.0, 5.0)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenario_loads_and_renders(name):
    scenario = load_scenario(name, *run.FOLDERS)
    assert scenario.name == name
    assert name in shipped_scenarios(run.VALIDATE)
    tactile_of(scenario)


def test_scenarios_change_what_their_names_say():
    assert tactile_of(load_scenario("slip20", *run.FOLDERS)).slip == 0.2
    assert load_scenario("slip20", *run.FOLDERS).trajectory.score_from == 2.0
    assert tactile_of(load_scenario("bright30", *run.FOLDERS)).brightness_change == 0.3
    assert tactile_of(load_scenario("noise2x", *run.FOLDERS)).noise == 2.0
    assert load_scenario("range_offset", *run.FOLDERS).calibrate
    assert max(load_scenario("large_rotation", *run.FOLDERS).trajectory.peak_deg) == 30.0


def test_unknown_scenario_names_those_there_are():
    with pytest.raises(ConfigError, match="long_cylinder"):
        load_scenario("nowhere", *run.FOLDERS)


def test_rigid_fit_sees_all_six_axes_of_a_long_cylinder():
    scenario = load_scenario("long_cylinder", *run.FOLDERS)
    short = replace(scenario, trajectory=replace(scenario.trajectory, duration=5.0))
    out = scores(run.run(short, "rigid_fit", 4242))
    assert out["valid_fraction"] > 0.99
    bounds = dict(zip(NAMED, (0.10, 0.12, 0.10, 0.35, 0.25, 0.45), strict=True))
    for name, bound in bounds.items():
        assert out["rmse"][name] < bound, name


def test_published_method_is_blind_along_a_long_cylinder_and_sees_y():
    """The paper: y is tracked reliably, x and z are not, and yaw is underestimated."""
    scenario = load_scenario("long_cylinder", *run.FOLDERS)
    short = replace(scenario, trajectory=replace(scenario.trajectory, duration=5.0, rate=15.0))
    out = scores(run.run(short, "published", 4243))
    assert out["correlation"]["y"] > 0.9
    assert abs(out["gain"]["z"]) < 0.5
    assert out["gain"]["yaw"] < 0.8
    assert out["rmse"]["z_mm"] > 3.0 * out["rmse"]["y_mm"]


def test_command_prints_one_json_object(tmp_path, capsys):
    file = tmp_path / "short.yaml"
    file.write_text("name: short\ntrajectory: {duration: 1.2}\n", encoding="utf-8")
    figure = tmp_path / "axes.png"
    arguments = ["estimator", "--scenario", str(file), "--seed", "9", "--json", "--report", str(figure)]
    assert validate.main(arguments) == 0
    out = json.loads(capsys.readouterr().out)
    assert set(out["rmse"]) == set(out["bias"]) == set(NAMED)
    assert set(out["gain"]) == set(out["correlation"]) == set(AXES)
    assert out["ms_per_pair"]["median"] > 0.0
    assert {"nees", "valid_fraction", "method", "scenario", "seed"} <= set(out)
    assert figure.stat().st_size > 10000


def test_pose_is_found_on_membranes_with_mechanics(tmp_path, capsys):
    file = tmp_path / "membrane.yaml"
    file.write_text(
        "grasp: {kind: membrane}\nmembrane: {spacing: 0.006}\ntrajectory: {duration: 1.5, scale: 0.25}\n"
        "tactile: {tool: {kind: box, radius: 0.012, width: 0.03, length: 0.04}}",
        encoding="utf-8",
    )
    assert validate.main(["estimator", "--scenario", str(file), "--seed", "9", "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    assert out["valid_fraction"] == 1.0
    assert max(out["rmse"][f"{axis}_mm"] for axis in "xyz") < 0.15
    assert max(out["rmse"][f"{axis}_deg"] for axis in ("roll", "pitch", "yaw")) < 0.6
    assert 0.0 < out["sliding_share"]["mean"] < out["sliding_share"]["max"] < 0.9
    calibrated = tmp_path / "calibrated.yaml"
    calibrated.write_text(file.read_text() + "\ncalibrate: true")
    assert validate.main(["estimator", "--scenario", str(calibrated)]) != 0
    assert "bushing only" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "word"), [("trajectory: {rate: 0}", "rate"), ("tactile: {squeez: 1}", "squeez"), ("tactile: 3", "tactile")]
)
def test_wrong_scenario_is_refused_by_name(tmp_path, capsys, text, word):
    file = tmp_path / "wrong.yaml"
    file.write_text(text, encoding="utf-8")
    assert validate.main(["estimator", "--scenario", str(file)]) == 2
    assert word in capsys.readouterr().err


def test_missing_bag_is_refused(tmp_path, capsys):
    assert validate.main(["estimator", "--from", str(tmp_path / "none")]) == 2
    assert "not a readable bag" in capsys.readouterr().err


def test_slip_command_prints_alarms_and_delays(capsys):
    assert validate.main(["slip", "--slips", "1", "--minutes", "0.02", "--seed", "5", "--jobs", "1", "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    assert out["slips"] == 1
    assert out["alarm_fraction"] == 1.0
    assert 0.0 < out["alarm_delay_ms"]["max"] <= 100.0
    assert out["false_alarms"] == 0
    assert out["valid_fraction"] == 1.0


def test_no_slip_shares_its_seed_with_another_or_with_a_calm_piece():
    drawn = [slip.drawn_from(s, i, calm) for s in (0, 1, 2, 21) for i in range(1500) for calm in (False, True)]
    assert len(set(drawn)) == len(drawn)
    assert slip.drawn_from(21, 499) == 21499
    assert slip.drawn_from(21, 499, calm=True) == 21999


@pytest.mark.parametrize("fingers", ["both", "right"])
def test_a_pull_aside_is_no_slip_yet(fingers):
    """Seed 7100003 turns the tool and then jerks it along z, back through the middle: displacement falls at once."""
    scenario = replace(load_scenario("long_cylinder", *run.FOLDERS), tactile=TactileParameters(fingers=fingers))
    told = slip.alarm_delay(scenario, 7100003)
    assert not told.early
    assert told.alarm <= slip.IN_TIME


def test_a_slip_on_membranes_with_mechanics_makes_the_estimate_invalid(monkeypatch):
    """A pull along x: depth sees it, the images are not explained any longer."""
    monkeypatch.setattr(slip, "_SPACING", 0.009)
    scenario = on_membrane(load_scenario("long_cylinder", *run.FOLDERS), 1)
    told = slip.alarm_delay(scenario, 31004)
    assert told.invalid <= slip.IN_TIME


def test_a_tool_slides_from_when_its_load_hardly_rises_on():
    pull = slip.Pull(1.0, np.array((0.0, 0.0, 0.0, 0.0, 0.0, -0.05)), 0.0, 0.0)
    load = slip.Plateau(pull)
    for t in np.arange(0.9, 1.5, 0.01):  # 20 N/s up to 4 N, then 1 N/s
        pulled = max(t - 1.0, 0.0)
        load.add(t, np.array((0.0, 0.0, 0.0, 0.0, 0.0, min(20.0 * pulled, 3.8 + pulled))))
    assert load.since == pytest.approx(1.21, abs=0.011)
    assert slip.Plateau(None).since == np.inf


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--world", "hidden", "--membrane", "3"], "leave out --world hidden"),
        (["--world", "hidden", "--renderer", "other"], "leave out --world hidden"),
        (["--renderer", "other", "--membrane", "3"], "leave out --renderer other"),
        (["--astray", "1"], "give --renderer other"),
        (["--larger", "2"], "give --membrane SEED"),
        (["--from", "bag", "--membrane", "3"], "leave out --from"),
    ],
)
def test_an_option_that_would_have_no_effect_is_refused(arguments, words, capsys):
    assert validate.main(["estimator", *arguments]) == 2
    assert words in capsys.readouterr().err

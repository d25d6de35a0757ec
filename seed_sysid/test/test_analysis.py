# SPDX-License-Identifier: Apache-2.0
"""The fit finds what the plant hides: stiffness, frame offset, bias, outliers, friction."""

import re
from dataclasses import replace

import numpy as np
import pytest
from simulated_data import at_rest

from seed_core.bushing import Stiffness
from seed_core.spatial import interpolate_pose, pose_from_rpy
from seed_sim.identification.scenario import HiddenGrasp, IdentificationScenario, SensorFaults, load
from seed_sysid.fit.analysis import analyse, cross_validate, make_problem
from seed_sysid.fit.hysteresis import stop_states
from seed_sysid.parameters import ExcitationParameters, FitParameters, LimitParameters
from seed_sysid.run.excitation import design, information_rows
from seed_sysid.stiffness_map import AXES, stiffness_map


def test_friction_follows_the_way_between_poses() -> None:
    """Straight in space is curved in the axes of the map: against the same way in steps of a percent."""
    data, _ = at_rest(load("default"), 6)
    problem = make_problem(data, "kinematic", FitParameters())
    fine, index = [np.eye(4)], []
    for X in problem.X_TC:
        start = fine[-1]
        fine += [interpolate_pose(start, X, share) for share in np.linspace(0.01, 1.0, 100)]
        index.append(len(fine) - 1)
    xi, xi_fine = (stiffness_map(np.array(way)).xi for way in (problem.path, fine))
    yields = 0.1 * np.abs(xi_fine).max(axis=0)
    states = stop_states(xi, problem.index, yields), stop_states(xi_fine, np.array(index), yields)
    np.testing.assert_allclose(*states, atol=0.05)  # of a friction that is at most 1


def test_friction_forgets_what_was_before_a_new_grasp() -> None:
    """At each grip the tool is gripped anew before the poses along five of the axes."""
    default = load("default")
    friction = dict(zip(AXES, (0.08, 0.08, 0.08, 0.6, 0.6, 0.6), strict=True))  # [N m, N]
    scenario = replace(default, grasp=replace(default.grasp, hysteresis=friction))
    data, cell = at_rest(scenario, 6, anew=("pitch", "yaw", "x", "y", "z"))
    assert data.samples[-1].grasp == 15
    s = analyse(data, "kinematic").solution
    off = s.value.stiffness - cell.truth.stiffness
    assert (np.abs(off) < 4.0 * s.std.stiffness).all()
    assert np.abs(off / cell.truth.stiffness).max() < 0.02
    np.testing.assert_allclose(s.value.friction, list(friction.values()), rtol=0.1)


def test_without_noise_the_fit_is_exact() -> None:
    scenario = IdentificationScenario(
        grasp=HiddenGrasp(pressure_noise=0.0),
        sensor=SensorFaults(
            force_noise=0.0, torque_noise=0.0, force_bias=3.0, torque_bias=0.1, force_drift=0.0, torque_drift=0.0
        ),
        repeatability=0.0,
        repeatability_deg=0.0,
    )
    data, cell = at_rest(scenario, 5)
    a = analyse(data, "kinematic")
    np.testing.assert_allclose(a.solution.value.stiffness, cell.truth.stiffness, rtol=1e-6)
    np.testing.assert_allclose(a.solution.value.offset, cell.truth.offset, atol=1e-7)  # [rad, m]


def test_intervals_contain_the_truth_as_often_as_they_say() -> None:
    """18 stiffnesses of 12 seeds: 216 intervals of 95 %; chance leaves 90 to 99 % once in some hundred draws."""
    covered, errors, offsets = [], [], []
    for seed in range(2000, 2012):
        data, cell = at_rest(load("default"), seed)
        s = analyse(data, "kinematic").solution
        covered.append(np.abs(s.value.stiffness - cell.truth.stiffness) <= s.half_width)
        errors.append(np.abs(s.value.stiffness / cell.truth.stiffness - 1.0))
        offsets.append(s.value.offset - cell.truth.offset)
    assert 0.90 <= np.mean(covered) <= 0.99
    assert np.mean(errors, axis=(0, 1)).max() < 0.02
    o = np.array(offsets)
    assert np.rad2deg(np.linalg.norm(o[:, :3], axis=1)).max() < 0.3
    assert np.linalg.norm(o[:, 3:], axis=1).max() < 0.5e-3


@pytest.mark.parametrize("axis", ["pitch", "x"])
def test_bias_outliers_and_a_hysteretic_axis_are_named_and_do_no_harm(axis: str) -> None:
    weird = load("weird")
    friction = {"pitch": 0.08, "x": 0.6}[axis]
    scenario = replace(weird, grasp=replace(weird.grasp, hysteresis={axis: friction}))
    data, cell = at_rest(scenario, 2020)
    a = analyse(data, "kinematic")
    assert a.hysteretic == (axis,)
    np.testing.assert_allclose(a.solution.value.friction[AXES.index(axis)], friction, rtol=0.2)
    assert np.abs(a.solution.value.stiffness / cell.truth.stiffness - 1.0).max() < 0.05
    assert len(a.outliers) == cell.outliers > 0
    assert any("outliers left out" in w for w in a.warnings)


def test_a_grasp_that_does_not_bear_its_work_is_told_with_the_remedy() -> None:
    data, _ = at_rest(load("default"), 6)
    first = data.samples[0]
    for kind, told in (("work", True), ("pitch", False)):
        lost = replace(data, samples=[replace(first, kind=kind, lost=True), *data.samples[1:]])
        a = analyse(lost, "kinematic")
        assert a.not_borne == ((first.key,) if told else ())
        assert any("does not bear it; close the gripper further" in w for w in a.warnings) == told


@pytest.mark.parametrize(("deg", "told"), [(18.0, False), (22.0, True)])
def test_a_grasp_in_which_the_work_turns_the_tool_far_does_not_bear_it(deg: float, told: bool) -> None:
    data, _ = at_rest(load("default"), 6)
    a = analyse(data, "kinematic")
    poses = a.problem.X_TC.copy()
    poses[3] = pose_from_rpy((np.deg2rad(-10.0), np.deg2rad(deg), 0.0), (0.0, 0.0, 0.0))
    samples = [replace(s, kind="work" if i == 3 else s.kind) for i, s in enumerate(data.samples)]
    turned = replace(a, data=replace(data, samples=samples), problem=replace(a.problem, X_TC=poses))
    assert turned.not_borne == ((data.samples[3].key,) if told else ())


def test_a_clean_grasp_has_no_outliers_no_friction_and_a_diagonal_stiffness() -> None:
    data, _ = at_rest(load("default"), 2030)
    a = analyse(data, "kinematic")
    assert not a.outliers
    assert not a.hysteretic
    assert a.assumption.holds
    assert np.abs(a.assumption.coupling).max() < 0.03
    assert a.left_out_share.max() < 0.06


def test_grips_that_were_visited_by_turns_are_cross_validated_like_others() -> None:
    scenario = load("default")
    widths = [0.026, 0.023, 0.020, 0.017, 0.014]
    data, _ = at_rest(replace(scenario, procedure=replace(scenario.procedure, widths=widths)), 2031)
    poses = len(data.samples) // len(widths)
    by_turns = replace(data, samples=[s for i in range(poses) for s in data.samples[i::poses]])
    (rms, share), (rms_in_turn, _) = (
        cross_validate(make_problem(d, "kinematic", FitParameters())) for d in (by_turns, data)
    )
    np.testing.assert_allclose(rms, rms_in_turn, rtol=0.2)
    assert share.max() < 0.06


def test_a_coupling_between_axes_is_found() -> None:
    """20 % between pitch and x, added to wrenches of a diagonal grasp."""
    data, cell = at_rest(load("default"), 2031)
    problem = make_problem(data, "kinematic", FitParameters())
    m = stiffness_map(problem.X_TC)
    k = cell.truth.stiffness[problem.grip]
    load_ = np.zeros_like(m.xi)
    root = 0.2 * np.sqrt(k[:, 1] * k[:, 3])
    load_[:, 1], load_[:, 3] = root * m.xi[:, 3], root * m.xi[:, 1]
    extra = np.einsum("nij,nj->ni", m.B, load_) @ cell._to_sensor.T
    samples = [replace(s, wrench=tuple(np.array(s.wrench) + e)) for s, e in zip(data.samples, extra, strict=True)]
    a = analyse(replace(data, samples=samples), "kinematic")
    assert not a.assumption.holds
    np.testing.assert_allclose(a.assumption.coupling[1, 3], 0.2, atol=0.03)


def test_designed_poses_beat_single_axes_and_random_ones_stay_within_limits() -> None:
    parameters, limits = ExcitationParameters(), LimitParameters()
    targets = design(parameters, limits)
    xi = np.array([t.xi for t in targets])
    assert len(targets) == 60
    J = information_rows(xi, parameters).reshape(-1, 18)
    assert np.linalg.cond(J / np.linalg.norm(J, axis=0)) < 4.0
    for j, axis in enumerate(AXES):
        own = np.array([t.xi[j] for t in targets if t.kind == axis])
        assert own.min() < 0 < own.max()
        assert len(own) == 6
    k = parameters.guess.vector()
    share = limits.planned_share + 1e-9
    assert np.linalg.norm(k[3:] * xi[:, 3:], axis=1).max() <= share * limits.force
    assert np.linalg.norm(k[:3] * xi[:, :3], axis=1).max() <= share * limits.torque
    assert np.linalg.norm(xi[:, 3:], axis=1).max() <= limits.translation + 1e-12
    assert np.rad2deg(np.linalg.norm(xi[:, :3], axis=1)).max() <= limits.rotation_deg + 1e-9


def test_an_axis_that_hardly_moves_is_reported_as_undetermined() -> None:
    scenario = load("default")
    excitation = replace(scenario.procedure.excitation, rotation_deg=(12.0, 0.6, 12.0))
    scenario = replace(
        scenario,
        procedure=replace(scenario.procedure, excitation=excitation),
        sensor=replace(scenario.sensor, torque_noise=0.2),
    )
    data, _ = at_rest(scenario, 2032)
    a = analyse(data, "kinematic")
    assert "pitch" in a.undetermined
    assert "x" not in a.undetermined


def test_stiffness_file_round_trips_into_the_controllers_loader(tmp_path) -> None:
    from seed_core.stiffness_file import GripStiffness, load_stiffness
    from seed_sysid.report.results import write_results
    from seed_sysid.report.summary import summary

    data, cell = at_rest(load("default"), 2033)
    a = analyse(data, "kinematic")
    (tmp_path / "summary.json").write_text("of before")
    (tmp_path / "before").hardlink_to(tmp_path / "summary.json")
    for date in ("2025-01-01", "2026-01-01"):
        write_results(tmp_path, a, summary(a), date)
    assert (tmp_path / "before").read_text() == "of before"  # it stays until the new one is whole
    assert load_stiffness(tmp_path / "stiffness.previous.yaml").date == "2025-01-01"
    loaded = GripStiffness(load_stiffness(tmp_path / "stiffness.yaml"))
    middle = loaded.at_pressure(float(cell.truth.pressures[1]))
    assert isinstance(middle, Stiffness)
    np.testing.assert_allclose(middle.translation, cell.truth.stiffness[1, 3:], rtol=0.03)


@pytest.mark.parametrize(
    ("pressures", "words"),
    [
        ((), "no pressures in the data of 3 of 3 grips: stiffness is tied to width only"),
        ((1013.25, 1013.25), r"not rise .*\(1013\.2, 1013\.2, 1013\.2 hPa\): a sensor is stuck or .* to width only"),
    ],
)
def test_grips_without_telling_pressures_are_written_by_width(tmp_path, pressures, words) -> None:
    from seed_core.stiffness_file import GripStiffness, load_stiffness
    from seed_sysid.report.results import write_results
    from seed_sysid.report.summary import summary

    data, cell = at_rest(load("default"), 2033)
    a = analyse(replace(data, samples=[replace(s, pressures=pressures) for s in data.samples]), "kinematic")
    assert re.search(words, "; ".join(a.warnings))
    write_results(tmp_path, a, summary(a), "2026-01-01")
    loaded = load_stiffness(tmp_path / "stiffness.yaml")
    assert [g.pressure_hpa for g in loaded.grips] == [0.0] * 3
    for width, true in zip(a.widths, cell.truth.stiffness, strict=True):
        np.testing.assert_allclose(GripStiffness(loaded).at_width(width).translation, true[3:], rtol=0.03)


@pytest.mark.parametrize("noise", [0.0, 5e-5])
def test_where_neither_pressure_nor_width_tells_the_grips_apart_the_middle_one_is_written(noise: float) -> None:
    """Nor does an encoder that only adds noise, or a gripper that is closed by hand to the same place."""
    from seed_sysid.report.summary import stiffness_file

    data, _ = at_rest(load("default"), 2033)
    rng = np.random.default_rng(1)
    alike = [replace(s, pressures=(), width=0.02 + noise * rng.normal()) for s in data.samples]
    a = analyse(replace(data, samples=alike), "kinematic")
    assert any("stiffness is that of the middle grip: widths are alike" in w for w in a.warnings)
    (grip,) = stiffness_file(a, "2026-01-01").grips
    np.testing.assert_allclose(grip.translation, a.solution.value.stiffness[a.nominal, 3:])


def test_a_stiffness_file_says_what_a_bushing_leaves_unexplained_friction_included() -> None:
    """Of the loads at rest about T, whose spring alone is known: 1.5 N of friction along z is a third of that force."""
    from seed_sysid.report.summary import stiffness_file

    default = load("default")
    for friction in (0.0, 1.5):
        scenario = replace(default, grasp=replace(default.grasp, hysteresis={"z": friction}))
        data, _ = at_rest(scenario, 6)
        a = analyse(data, "kinematic")
        file = stiffness_file(a, "2026-01-01")
        assert max(file.torque_unexplained + file.force_unexplained[:2]) < 0.05
        z = a.problem.wrench[:, 5] - a.problem.wrench[:, 5].mean()
        most = friction / z.std()  # while all of it pulls one way
        assert 0.6 * most <= file.force_unexplained[2] <= most + 0.05


def test_grips_whose_width_never_came_are_written_by_pressure(tmp_path) -> None:
    from seed_core.stiffness_file import load_stiffness
    from seed_sysid.report.results import write_results
    from seed_sysid.report.summary import summary

    data, cell = at_rest(load("default"), 2033)
    a = analyse(replace(data, samples=[replace(s, width=0.0) for s in data.samples]), "kinematic")
    assert any("every grip has the width 0 m" in w for w in a.warnings)
    assert summary(a)["pressure_per_width"] is None
    write_results(tmp_path, a, summary(a), "2026-01-01")
    grips = load_stiffness(tmp_path / "stiffness.yaml").grips
    for grip, true in zip(grips, cell.truth.stiffness, strict=True):
        np.testing.assert_allclose(grip.translation, true[3:], rtol=0.03)

# SPDX-License-Identifier: Apache-2.0
"""The membrane map's fit on a toy of its own: what it explains that the tool's pose does not, and what it refuses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from toy_membrane import Toy, combined_motion, toy_dataset

from seed_bringup import identify
from seed_core.estimate import MembraneMotion, RelativePoseEstimate
from seed_core.membrane.map import MembraneMap
from seed_core.membrane.map_file import load_membrane_map
from seed_core.spatial import Array, inverse_pose, make_pose, so3_exp
from seed_sysid.data.dataset import Dataset, DatasetError, Sample
from seed_sysid.data.membrane_sample import mean_membrane, since
from seed_sysid.data.sample_file import header_line, parse, sample_line
from seed_sysid.fit.analysis import Analysis, analyse
from seed_sysid.membrane import result
from seed_sysid.membrane.data import membrane_data
from seed_sysid.membrane.fit import Component, fit_membrane, fit_without_outliers, rms
from seed_sysid.membrane.regression import regress
from seed_sysid.membrane.result import causes, refuse_unexcited, slopes
from seed_sysid.membrane.terms import KINDS, MAIN, WRENCH_PARITY, Group, groups
from seed_sysid.report.results import write_results
from seed_sysid.report.summary import summary
from seed_sysid.stiffness_map import wrench_transform

OFFSET = make_pose(so3_exp(np.deg2rad([1.5, -2.0, 1.0])), [0.003, -0.002, 0.002])


@pytest.fixture(scope="module")
def data() -> Dataset:
    return toy_dataset(np.random.default_rng(0), offset=OFFSET)


@pytest.fixture(scope="module")
def analysis(data: Dataset) -> Analysis:
    return analyse(data, "kinematic")


def unexplained(model: MembraneMap, seed: int, noise: float = 0.0) -> tuple[Array, float, float]:
    """(6,) share of the toy's wrench that the map leaves in a motion it never saw, sliding share, mean nees."""
    toy, rng, loads, errors, slips, nees = Toy(), np.random.default_rng(seed), [], [], [], []
    for X_CT in combined_motion(np.random.default_rng(seed)):
        load = wrench_transform(inverse_pose(X_CT)) @ toy.move(X_CT)
        told = model.spring(
            RelativePoseEstimate(0.0, X_CT, membrane=tuple(noisy(m, noise, rng) for m in toy.membrane()))
        )
        error = told.wrench.vector() - load
        loads.append(load)
        errors.append(error)
        slips.append(toy.slips)
        nees.append(error @ np.linalg.solve(told.covariance, error))
    return rms(np.array(errors)) / rms(np.array(loads)), float(np.mean(slips)), float(np.mean(nees))


def noisy(m: MembraneMotion, noise: float, rng: np.random.Generator) -> MembraneMotion:
    """Errors of 0.3 degrees about the patch's middle and 0.07 mm, times noise."""
    turn, X = noise * np.deg2rad(0.3) * rng.normal(size=3), m.X_CM.copy()
    X[:3, 3] += noise * 7e-5 * rng.normal(size=3)
    X[:3, :3] = so3_exp(turn) @ X[:3, :3]
    X[:3, 3] += m.centroid - so3_exp(turn) @ m.centroid
    covariance = noise**2 * np.diag([np.deg2rad(0.3) ** 2] * 3 + [7e-5**2] * 3)
    return replace(m, X_CM=X, covariance=covariance)


def test_the_map_explains_a_motion_with_sliding_that_the_tools_pose_does_not(analysis: Analysis) -> None:
    assert analysis.membrane is not None
    share, sliding, nees = unexplained(MembraneMap(analysis.membrane.file), 5)
    assert 0.25 < sliding < 0.5
    assert (share[3:] < 0.05).all()
    assert (share[:3] < 0.2).all()
    assert (share[3:] < 0.5 * analysis.left_out_share[3:]).all()  # of the tool's pose
    assert 1.0 < nees < 12.0


def test_noise_of_the_features_is_in_the_covariance(analysis: Analysis) -> None:
    assert analysis.membrane is not None
    _, _, nees = unexplained(MembraneMap(analysis.membrane.file), 6, noise=1.0)
    assert 1.0 < nees < 12.0


def test_the_sensors_frame_is_found_beside_the_map(analysis: Analysis) -> None:
    assert analysis.membrane is not None
    turn, shift = analysis.membrane.fit.nuisance[-6:-3], analysis.membrane.fit.nuisance[-3:]
    assert_allclose(np.rad2deg(turn), [1.5, -2.0, 1.0], atol=0.6)
    assert_allclose(shift, [0.003, -0.002, 0.002], atol=8e-4)


@pytest.mark.parametrize(("shift", "aside"), [((0.003, -0.002, 0.002), 0.008), ((0.001, 0.001, -0.004), 0.0)])
def test_the_lever_of_the_sensor_is_told_from_that_of_the_grasp(shift: tuple[float, ...], aside: float) -> None:
    """Fingers that hold the tool further along z, or a sensor that is off: each gives forces a lever about C."""
    offset = make_pose(OFFSET[:3, :3], shift)
    found = analyse(toy_dataset(np.random.default_rng(0), offset=offset, widths=1, aside=aside), "kinematic").membrane
    assert found is not None
    assert_allclose(found.fit.nuisance[-3:], shift, atol=5e-4)
    model, toy = MembraneMap(found.file), Toy(grip=0, aside=aside)
    told, loads = [], []
    for X_CT in combined_motion(np.random.default_rng(5), size=0.5):
        loads.append(wrench_transform(inverse_pose(X_CT)) @ toy.move(X_CT))
        told.append(model.spring(RelativePoseEstimate(0.0, X_CT, membrane=toy.membrane())).wrench.vector())
    assert (rms(np.array(told) - loads) < 0.055 * rms(np.array(loads))).all()


def test_hysteresis_against_the_pose_is_told_to_be_friction(analysis: Analysis) -> None:
    assert analysis.hysteretic
    assert analysis.membrane is not None
    assert any("friction between patch and tool" in r for r in analysis.membrane.remarks)
    assert not any("the material itself" in r for r in analysis.membrane.remarks)


def test_hysteresis_that_stays_is_told_to_be_the_materials() -> None:
    friction, remaining = np.array([0, 0, 0, 1.0, 0, 0]), np.array([0, 0, 0, 0.9, 0, 0])
    (text,) = causes((3,), friction, remaining)
    assert "x: loading and unloading differ by 2 N against the tool's pose and 1.8 N" in text
    assert "the material itself" in text


def test_curvature_is_told_where_there_is_some_only(analysis: Analysis) -> None:
    assert analysis.membrane is not None
    assert any("is nonlinear" in r for r in analysis.membrane.remarks)
    straight = toy_dataset(np.random.default_rng(2), curvature=0.0, widths=1)
    found = analyse(straight, "kinematic").membrane
    assert found is not None
    assert not [r for r in found.remarks if "force" in r and "is nonlinear" in r]


def test_all_files_are_written_together(analysis: Analysis, tmp_path: Path) -> None:
    found = summary(analysis)
    write_results(tmp_path, analysis, found, "2026-02-03")
    file = load_membrane_map(tmp_path / "membrane_map.yaml")
    assert (file.hand, file.tool, file.date) == ("h", "t", "2026-02-03")
    assert_allclose([g.width_m for g in file.grips], [0.026, 0.020, 0.014])
    assert_allclose([g.pressure_hpa for g in file.grips], [1020.0, 1030.0, 1040.0], atol=0.1)
    assert "What the membranes" in (tmp_path / "report.html").read_text()
    assert found["membrane_map"]["left_out_share"]["force x"] < 0.05
    without = replace(analysis, membrane=None)
    write_results(tmp_path, without, summary(without), "2026-02-04")
    assert not (tmp_path / "membrane_map.yaml").exists()
    assert (tmp_path / "membrane_map.previous.yaml").exists()


def test_an_axis_that_is_not_determined_leaves_a_map_and_no_stiffness(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Friction hides the stiffness along x here."""
    data = toy_dataset(np.random.default_rng(0))
    file, out = tmp_path / "samples.jsonl", tmp_path / "out"
    file.write_text("\n".join([header_line(data.header), *map(sample_line, data.samples)]) + "\n")
    assert identify.main(["--from", str(file), "--out", str(out)]) == 1
    said = capsys.readouterr().out
    assert "warning: x is not determined by these data" in said
    assert f"left in {out}: membrane_map.yaml, report.html, summary.json" in said


def test_samples_keep_what_the_membranes_did(data: Dataset) -> None:
    lines = [header_line(data.header), *(sample_line(s) for s in data.samples[:5])]
    assert parse(lines, "file").samples == data.samples[:5]
    old = [line.replace('"version": 2', '"version": 1') for line in lines]
    assert parse(old, "file").header.version == 1
    bad = lines[1].replace('"finger": "left"', '"finger": "thumb"')
    with pytest.raises(DatasetError, match="finger: left or right"):
        parse([lines[0], bad, *lines[2:]], "file")


def test_a_mean_and_a_difference_of_motions() -> None:
    rng = np.random.default_rng(3)
    X = make_pose(so3_exp(rng.normal(0, 0.1, 3)), rng.normal(0, 1e-3, 3))
    Y = make_pose(so3_exp(rng.normal(0, 0.1, 3)), rng.normal(0, 1e-3, 3))
    (x, _), (y, _) = (
        mean_membrane([tuple(MembraneMotion(f, M, deformation=np.full(9, d)) for f in ("left", "right"))] * 2)
        for M, d in ((X, 1e-4), (Y, 3e-4))
    )
    between = since(y, x).estimate
    assert_allclose(between.X_CM @ X, Y, atol=1e-12)
    assert_allclose(between.deformation, 2e-4)


def _changed(data: Dataset, keep: slice, change: object = None) -> Dataset:
    samples = data.samples[keep]
    return replace(data, samples=[change(s) for s in samples] if callable(change) else samples)


def _still(s: Sample) -> Sample:
    return replace(s, membrane=tuple(replace(m, motion=(0.0,) * 6) for m in s.membrane))


def test_what_the_data_do_not_show_is_refused(data: Dataset) -> None:
    def gone(s: Sample) -> Sample:
        return replace(s, membrane=()) if s.kind == "combination" else s

    for bad, words in (
        (_changed(data, slice(0, 20)), "grip 0 has 20 samples with membranes"),
        (_changed(data, slice(1, 60)), "its first sample must be of the centre"),
        (_changed(data, slice(0, 60), _still), "the membranes hardly moved along roll, pitch, yaw, x, y, z"),
        (_changed(data, slice(0, 60), gone), r"20 of 60 samples do not tell .* \(first: 0/"),
    ):
        with pytest.raises(DatasetError, match=words):
            membrane_data(bad)
    refused = analyse(_changed(data, slice(0, 60), gone), "kinematic")
    assert refused.membrane is None
    assert any(w.startswith("no membrane map: 20 of 60 samples") for w in refused.warnings)


def test_an_axis_that_moves_little_counts_if_its_load_is_told(data: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(result, "_EXCITED", 3.0)  # no axis moves as far
    rng = np.random.default_rng(2)

    def blurred(s: Sample) -> Sample:
        off = 1e-3 * rng.normal()  # [m] along y, of both
        moved = (replace(m, motion=(m.motion[0], m.motion[1] + off, *m.motion[2:])) for m in s.membrane)
        return replace(s, membrane=tuple(moved))

    for change, idle in ((None, "roll, pitch, yaw"), (blurred, "roll, pitch, yaw, x, y, z")):
        fit = fit_membrane(membrane_data(_changed(data, slice(0, 60), change)), "smooth")
        with pytest.raises(DatasetError, match=f"the membranes hardly moved along {idle}: rms"):
            refuse_unexcited(fit)


def test_single_samples_that_are_lost_or_wrong_do_not_spoil_the_map(data: Dataset) -> None:
    def spoilt(s: Sample) -> Sample:
        if s.key == data.samples[70].key:
            return replace(s, membrane=())
        return replace(s, membrane=s.membrane[::-1]) if s.key != data.samples[80].key else _jumped(s)

    fit, outliers = fit_without_outliers(membrane_data(_changed(data, slice(60, 120), spoilt)), "smooth")
    assert outliers == 1
    assert fit.data.lost == (data.samples[70].key,)
    assert (fit.share[3:] < 0.06).all()


@pytest.mark.parametrize(("wrong", "kept"), [(8, True), (26, False)])
def test_gross_errors_in_a_seventh_of_the_samples_are_left_out_and_in_nearly_half_refused(
    data: Dataset, wrong: int, kept: bool
) -> None:
    rng = np.random.default_rng(2)
    clean = _changed(data, slice(60, 120))
    pick = {clean.samples[i].key for i in rng.choice(np.arange(1, 60), wrong, replace=False)}

    def spoilt(s: Sample) -> Sample:
        return replace(s, wrench=(*s.wrench[:3], *(np.array(s.wrench[3:]) + 8.0 * rng.normal(size=3)).tolist()))

    dirty = membrane_data(_changed(clean, slice(0, 60), lambda s: spoilt(s) if s.key in pick else s))
    if not kept:
        with pytest.raises(DatasetError, match=r"of 60 samples of a grip 20.0 mm wide are .* \(at most 30% may"):
            fit_without_outliers(dirty, "smooth")
        return
    fit, outliers = fit_without_outliers(dirty, "smooth")
    left = {clean.samples[i].key for i in np.setdiff1d(np.arange(60), fit.data.kept)}
    assert pick <= left
    assert outliers == len(left) <= wrong + 3
    assert_allclose(fit.share, fit_membrane(membrane_data(clean), "smooth").share, atol=0.03)


def _jumped(s: Sample) -> Sample:
    """An estimator that has lost its track: 4 mm off."""
    return replace(s, membrane=tuple(replace(m, motion=(m.motion[0] + 4e-3, *m.motion[1:])) for m in s.membrane))


def test_strengths_shrink_what_the_data_do_not_want() -> None:
    rng = np.random.default_rng(4)
    F, empty = rng.normal(size=(60, 3)), rng.normal(size=(60, 20))
    y = F @ [1.0, -2.0, 0.5] + 0.1 * rng.normal(size=60)
    found = regress([F, empty], y)
    assert_allclose(found.coefficients[0], [1.0, -2.0, 0.5], atol=0.06)
    assert np.abs(found.coefficients[1]).max() < 0.02
    assert_allclose(np.sqrt(found.noise), 0.1, rtol=0.3)
    i = 7  # left out for once
    others = np.arange(60) != i
    kept = regress([F[others], empty[others]], y[others])
    predicted = F[i] @ kept.coefficients[0] + empty[i] @ kept.coefficients[1]
    assert_allclose(found.left_out[i], y[i] - predicted, atol=0.03)
    spread = np.sqrt(np.diag(found.covariance([F, empty])))[:3]
    assert_allclose(spread, 0.1 / np.sqrt(60), rtol=0.5)


def test_mirrors_leave_each_force_its_own_motion() -> None:
    for i, parity in enumerate(WRENCH_PARITY):
        (own,) = next(g for g in groups(["motion of the tool"], parity)).terms
        assert own == (MAIN[i],)
        named = [t for g in groups(KINDS, parity) for t in g.terms]
        assert len(named) == len(set(named))


def test_one_model_is_as_good_with_one_grip(data: Dataset) -> None:
    fit = fit_membrane(membrane_data(_changed(data, slice(60, 120))), "smooth")
    assert (fit.share[3:] < 0.06).all()


def test_samples_of_one_path_are_predicted_from_those_of_others() -> None:
    """Against the conditional mean of a normal distribution with the covariance that was found."""
    rng = np.random.default_rng(4)
    F = [rng.normal(size=(40, 3)), rng.normal(size=(40, 5))]
    y = F[0] @ rng.normal(size=3) + 0.2 * rng.normal(size=40)
    found, group = regress(F, y), np.repeat(np.arange(8), 5)
    K = np.linalg.inv(found.inverse)
    for g in range(8):
        mine, others = group == g, group != g
        expected = K[np.ix_(mine, others)] @ np.linalg.solve(K[np.ix_(others, others)], y[others])
        assert_allclose(found.left_out_together(group)[mine], y[mine] - expected, atol=1e-9)


def test_paths_are_axes_at_all_grips_and_single_combinations(data: Dataset) -> None:
    path, samples = membrane_data(data).path, data.samples
    for kind in ("home", "pitch"):
        assert len({p for p, s in zip(path, samples, strict=True) if s.kind == kind}) == 1
    combinations = [p for p, s in zip(path, samples, strict=True) if s.kind == "combination"]
    assert len(set(combinations)) == len(combinations) > 20


def test_intervals_of_coefficients_contain_the_truth_as_often_as_they_say() -> None:
    """Coefficients drawn as the fit takes them to be: normal, each group with a strength of its own."""
    rng, terms, inside = np.random.default_rng(9), ((0,), (1,), (2,), (3,)), []
    group = Group("any", terms, True)
    for _ in range(60):
        F, c = rng.normal(size=(40, 4)), 2.0 * rng.normal(size=4)
        found = regress([F], F @ c + 0.3 * rng.normal(size=40))
        half = Component([group], [F], found, found.left_out, found.left_out).half_widths()
        inside += [abs(found.coefficients[0][i] - c[i]) < half[(i,)] for i in range(4)]
    assert 0.91 < np.mean(inside) < 0.99


def test_slopes_are_told_with_their_intervals(analysis: Analysis) -> None:
    assert analysis.membrane is not None
    value, half = slopes(analysis.membrane.fit)
    assert (value > 0.0).all()
    assert (half < 0.5 * value).all()
    told = summary(analysis)["membrane_map"]
    assert told["slopes"]["z"] == (pytest.approx(value[5]), pytest.approx(half[5]))
    assert all(abs(v) > h for term, (v, h) in told["coefficients"]["force z"].items() if "*" in term)

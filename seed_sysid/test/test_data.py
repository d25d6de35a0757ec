# SPDX-License-Identifier: Apache-2.0
"""Files of samples: crash-safe, strict; and every kind of bad data is refused by name with a remedy."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated_data import at_rest

from seed_bringup import identify
from seed_core.config import ConfigError
from seed_core.spatial import inverse_pose
from seed_sim.identification.scenario import load
from seed_sim.identification.session import simulate
from seed_sim.identification.tactile_poses import TactilePoses
from seed_sim.identification.truth import draw_truth
from seed_sim.scenario import load_scenario, tactile_of
from seed_sysid.data.bag import TOPIC, TYPE
from seed_sysid.data.dataset import Dataset, DatasetError, Sample, flat_pose
from seed_sysid.data.sample_file import Recorder, header_line, parse, read, sample_line
from seed_sysid.fit.analysis import analyse
from seed_sysid.fit.checks import check_inliers


@pytest.fixture(scope="module")
def data() -> Dataset:
    return at_rest(load("default"), 2100)[0]


def _changed(data: Dataset, change: Callable[[Sample], Sample]) -> Dataset:
    return replace(data, samples=[change(s) for s in data.samples])


def _lines(data: Dataset) -> list[str]:
    return [header_line(data.header), *(sample_line(s) for s in data.samples)]


def _wrench(s: Sample, change: Callable[[np.ndarray], np.ndarray]) -> Sample:
    return replace(s, wrench=tuple(float(v) for v in change(np.array(s.wrench))))


def test_the_estimator_looks_at_the_bubbles_of_the_simulated_scenario(tmp_path: Path) -> None:
    file = tmp_path / "slipping.yaml"
    file.write_text("{name: slipping, slip_share: 0.2, tactile: {squeeze: 0.006}, table: {friction: 0.3}}")
    seen = TactilePoses(load(str(file)), 3)._renderer.parameters
    assert seen == tactile_of(load_scenario(file))
    assert (seen.slip, seen.squeeze) == (0.2, 0.006)


def test_the_grasp_of_a_cell_scenario_has_the_stiffness_of_its_file(tmp_path: Path) -> None:
    file = tmp_path / "my_bench.yaml"
    file.write_text("{grasp: {stiffness: {rotation: [3, 2, 3], translation: [640, 960, 640]}}, table: {friction: 0.6}}")
    for seed in (0, 7):
        truth = draw_truth(load(str(file)), np.random.default_rng(seed))
        np.testing.assert_allclose(truth.stiffness[1], (3, 2, 3, 640, 960, 640))  # at the middle width


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{description: bench, table: {frction: 0.6}}", "yaml:1: unknown key 'table.frction'; known here: tilt_x"),
        (
            "{name: bench, servo: {lag: 0.1}, tabel: {friction: 0.6}}",
            "yaml:1: unknown key 'tabel'; known here: .*table",
        ),
        ("{sensor: {force_nois: 0.1}}", "yaml:1: unknown key 'sensor.force_nois'; known here: force_noise"),
    ],
)
def test_a_mistake_is_told_of_the_kind_of_scenario_that_a_file_is(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "typo.yaml").write_text(text)
    with pytest.raises(ConfigError, match=words):
        load(str(tmp_path / "typo.yaml"))


def test_a_file_reads_back_as_written(data: Dataset) -> None:
    back = parse(_lines(data), "file")
    assert back.samples == data.samples
    assert back.header == data.header


def test_a_crash_loses_the_running_sample_only(data: Dataset, tmp_path: Path) -> None:
    file = tmp_path / "samples.jsonl"
    writer = Recorder(file, data.header)
    for s in data.samples[:20]:
        writer.record(0.0, s)
    writer.close()
    file.write_bytes(file.read_bytes()[:-40])
    back = read(file)
    assert [s.key for s in back.samples] == [s.key for s in data.samples[:19]]
    assert "cut short" in back.warnings[0]
    again = Recorder(file, data.header)
    assert len(again.samples) == 19
    again.record(0.0, data.samples[19])
    again.close()
    assert len(read(file).samples) == 20
    assert not read(file).warnings


def test_samples_of_an_earlier_release_are_all_of_one_grasp(data: Dataset) -> None:
    old = [line.replace(', "grasp": 0', "") for line in _lines(data)]
    assert '"grasp"' not in old[1]
    assert parse(old, "old.jsonl").samples == data.samples


def test_poses_on_the_way_of_a_grasp_before_are_not_those_of_the_next(data: Dataset) -> None:
    """The second sample has no estimated pose, the third is of a new grasp."""
    first, unseen, new = data.samples[:3]
    pose = (0.001, 0.0, 0.0, 0.0, 0.0, 0.0)
    told = [replace(first, estimator=pose), unseen, replace(new, estimator=pose, grasp=1)]
    assert [s.via for s in replace(data, samples=told).with_poses("estimator").samples] == [(), ()]


def test_a_run_continues_where_it_stopped_and_repeats_nothing(tmp_path: Path) -> None:
    scenario = load("default")
    procedure = replace(scenario.procedure, widths=[0.02])
    scenario = replace(scenario, procedure=procedure)
    file = tmp_path / "samples.jsonl"
    whole, _ = simulate(scenario, 2101, file)
    kept = file.read_text().splitlines()[:41]
    file.write_text("\n".join(kept) + "\n")
    resumed, cell = simulate(scenario, 2101, file)
    assert [s.key for s in resumed.samples] == [s.key for s in whole.samples]
    assert file.read_text().splitlines()[:41] == kept
    assert [s.grasp for s in resumed.samples] == [0] * 40 + [1] * 20  # its cell closes on the tool anew
    error = analyse(resumed, "kinematic").solution.value.stiffness / cell.truth.stiffness - 1.0
    assert np.abs(error).max() < 0.02


def test_a_corrected_sensor_is_taken_over_by_the_run_that_goes_on(data: Dataset, tmp_path: Path) -> None:
    file = tmp_path / "samples.jsonl"
    wrong = replace(data.header, sensor_rpy=(0.0, 0.0, 0.0))
    writer = Recorder(file, wrong)
    for s in data.samples:
        writer.record(0.0, s)
    writer.close()
    with pytest.raises(
        DatasetError, match=r"frames disagree.* sensor\.rpy_deg of the node .* sensor_rpy of its header"
    ):
        analyse(read(file), "kinematic")
    again = Recorder(file, replace(data.header, created="later"))
    again.close()
    assert again.header == read(file).header == data.header
    assert again.samples == data.samples
    assert "sensor_rpy = (" in again.remark
    assert "(was (0.0, 0.0, 0.0))" in analyse(again.dataset, "kinematic").warnings[0]
    assert json.loads(file.read_text().splitlines()[-1])["event"]["text"] == again.remark
    assert [f.name for f in tmp_path.iterdir()] == ["samples.jsonl"]
    assert not Recorder(file, data.header).remark


def test_samples_that_the_estimator_did_not_see_are_named_and_left_out(data: Dataset) -> None:
    blind = {"0/010-pitch", "1/050-combination", "2/003-roll"}
    seen = _changed(data, lambda s: replace(s, estimator=None if s.key in blind else s.kinematic))
    result = analyse(seen, "estimator")
    assert len(result.data.samples) == len(data.samples) - len(blind)
    assert any(all(key in w for key in blind) for w in result.warnings)
    assert not any("resume" in w for w in result.warnings)
    whole = analyse(data, "kinematic").solution
    assert np.abs(result.solution.value.stiffness / whole.value.stiffness - 1.0).max() < 0.01
    with pytest.raises(DatasetError, match="no sample has an estimator pose"):
        analyse(data, "estimator")


@pytest.mark.parametrize("end", ["", "\n", '\n{"sample": {"na', '\n{"sample": {"na\n'])
def test_a_file_goes_on_whatever_its_last_line_ends_with(data: Dataset, tmp_path: Path, end: str) -> None:
    """A whole sample without its newline was lost as the run went on, and a cut line with one spoiled the file."""
    file = tmp_path / "samples.jsonl"
    writer = Recorder(file, data.header)
    for s in data.samples[:3]:
        writer.record(0.0, s)
    writer.close()
    file.write_text(file.read_text().rstrip("\n") + end)
    again = Recorder(file, data.header)
    assert [s.key for s in again.samples] == [s.key for s in data.samples[:3]]
    again.record(0.0, data.samples[3])
    again.close()
    assert [s.key for s in read(file).samples] == [s.key for s in data.samples[:4]]


def test_a_sample_that_could_not_be_read_again_is_not_written(data: Dataset, tmp_path: Path) -> None:
    file = tmp_path / "samples.jsonl"
    writer = Recorder(file, data.header)
    writer.record(0.0, data.samples[0])
    with pytest.raises(DatasetError, match=f"{data.samples[1].key} has a value that is not finite: .*slip=nan"):
        writer.record(0.0, replace(data.samples[1], slip=float("nan")))
    writer.close()
    assert writer.samples == read(file).samples == data.samples[:1]


def test_another_runs_file_is_left_alone(data: Dataset, tmp_path: Path) -> None:
    file = tmp_path / "samples.jsonl"
    Recorder(file, data.header).close()
    before = file.read_bytes()
    with pytest.raises(DatasetError, match="belongs to the run"):
        Recorder(file, replace(data.header, run="another"))
    assert file.read_bytes() == before


BAD: dict[str, tuple[Callable[[Dataset], Dataset], str]] = {
    "too few poses": (lambda d: replace(d, samples=d.samples[:8]), "grip 0 has 8 poses; at least 12"),
    "no poses": (lambda d: replace(d, samples=[]), "no finished pose"),
    "axis never excited": (
        lambda d: replace(d, samples=[s for s in d.samples if s.kind in ("home", "x", "y", "roll", "pitch", "yaw")]),
        "z was never excited",
    ),
    "constant channel": (
        lambda d: _changed(d, lambda s: _wrench(s, lambda w: w * [1, 0, 1, 1, 1, 1])),
        "torque y .* stays",
    ),
    "saturated": (lambda d: _changed(d, lambda s: _wrench(s, lambda w: np.clip(w, -9, 3.0))), "saturates at 3"),
    "saturated below": (lambda d: _changed(d, lambda s: _wrench(s, lambda w: np.clip(w, -3.0, 9))), "saturates at -3"),
    "mm": (
        lambda d: _changed(d, lambda s: replace(s, kinematic=(*(1e3 * v for v in s.kinematic[:3]), *s.kinematic[3:]))),
        "mm",
    ),
    "degrees": (
        lambda d: _changed(d, lambda s: replace(s, kinematic=(*s.kinematic[:3], *np.rad2deg(s.kinematic[3:])))),
        "degrees",
    ),
    "N mm": (lambda d: _changed(d, lambda s: _wrench(s, lambda w: w * [1e3, 1e3, 1e3, 1, 1, 1])), "N mm"),
    "Pa": (
        lambda d: _changed(d, lambda s: replace(s, pressures=(102100.0, 102000.0))),
        "a pressure of 102100 hPa .* Pa",
    ),
    "gauge pressure": (lambda d: _changed(d, lambda s: replace(s, pressures=(1021.0, -10.0))), "-10 hPa .* gauge"),
    "width in mm": (lambda d: _changed(d, lambda s: replace(s, width=1e3 * s.width)), "0/000-home: .* 26 m .* mm"),
    "width below zero": (lambda d: _changed(d, lambda s: replace(s, width=-1e-3)), "-0.001 m .* zero of gripper/width"),
    "reaction": (lambda d: _changed(d, lambda s: _wrench(s, lambda w: -w)), "turn its sign"),
    "turned sensor": (
        lambda d: replace(d, header=replace(d.header, sensor_rpy=(0.0, 0.0, 0.0))),
        "frames disagree",
    ),
    "inverse poses": (
        lambda d: _changed(
            d, lambda s: replace(s, estimator=flat_pose(inverse_pose(Dataset(d.header, [s]).poses("kinematic")[0])))
        ),
        "look like X_CT",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_data_are_refused_by_name(data: Dataset, name: str) -> None:
    spoil, message = BAD[name]
    with pytest.raises(DatasetError, match=message):
        analyse(spoil(data), "kinematic")


@pytest.mark.parametrize(("share", "accepted"), [(0.15, True), (0.45, False)])
def test_a_grip_with_too_many_outliers_is_refused(data: Dataset, share: float, accepted: bool) -> None:
    """A load of 0.4 times the true one, at some poses of the middle grip."""
    rng = np.random.default_rng(1)
    mine = [i for i, s in enumerate(data.samples) if s.grip == 1]
    weak = set(rng.choice(mine, int(share * len(mine)), replace=False).tolist())
    samples = [_wrench(s, lambda w: 0.4 * w) if i in weak else s for i, s in enumerate(data.samples)]
    if accepted:
        assert analyse(replace(data, samples=samples), "kinematic").outliers
        return
    with pytest.raises(DatasetError, match=r"grip 1: \d+ of 60 poses do not fit one spring \(at most 30%"):
        analyse(replace(data, samples=samples), "kinematic")


def test_an_axis_whose_poses_are_all_outliers_is_refused(data: Dataset) -> None:
    few = replace(data, samples=[s for s in data.samples if s.grip == 0 and abs(s.kinematic[2]) < 2.4e-4])
    moved = [replace(s, kinematic=(*s.kinematic[:2], 0.004, *s.kinematic[3:])) for s in few.samples[:2]]
    both = replace(few, samples=[*moved, *few.samples[2:]])
    inlier = np.arange(len(both.samples)) >= 2
    with pytest.raises(DatasetError, match=r"grip 0, without 2 outliers \(first: .*\): z was never excited"):
        check_inliers(both, "kinematic", inlier)


def test_refused_data_overwrite_nothing(data: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad, out = tmp_path / "bad.jsonl", tmp_path / "out"
    bad.write_text("\n".join(_lines(BAD["constant channel"][0](data))) + "\n")
    out.mkdir()
    (out / "stiffness.yaml").write_text("precious")
    assert identify.main(["--from", str(bad), "--out", str(out)]) == 2
    assert "dead channel" in capsys.readouterr().err
    assert [f.name for f in out.iterdir()] == ["stiffness.yaml"]
    assert (out / "stiffness.yaml").read_text() == "precious"


def test_a_source_of_poses_that_there_is_not_is_named(data: Dataset) -> None:
    for ask in (lambda: analyse(data, "foo"), lambda: data.poses("foo")):
        with pytest.raises(DatasetError, match=r"^source = 'foo' must be one of: kinematic, estimator$"):
            ask()


def test_a_folder_without_samples_is_told_what_was_looked_for(tmp_path: Path) -> None:
    with pytest.raises(
        DatasetError, match=r"has neither samples\.jsonl, as a run leaves it, nor metadata\.yaml, as a bag"
    ):
        read(tmp_path)


FILES = {
    "": "empty",
    "nonsense\n": "no header",
    '{"format": "seed-stiffness-samples", "version": 3}\n': "version 3",
    '{"format": "other", "version": 1}\n': "no header with",
    '{"format": "seed-stiffness-samples", "version": 1, "units": {"length": "mm"}}\n': "length must be in m",
    '{"format": "seed-stiffness-samples", "version": 1}\n{"sample": {"name": "a"}}\n': "lacks kind",
    '{"format": "seed-stiffness-samples", "version": 1}\n{"sam\n{"event": {}}\n': ":2: not JSON",
    '{"format": "seed-stiffness-samples", "version": 1}\n'
    + json.dumps(
        {
            "sample": {
                "name": "a",
                "kind": "x",
                "grip": 0,
                "stamp": 0.0,
                "kinematic": [0] * 6,
                "wrench": [float("nan")] * 6,
            }
        }
    )
    + "\n": "wrench = .* finite",
}


@pytest.mark.parametrize("text", FILES)
def test_broken_files_are_refused_by_name(text: str, tmp_path: Path) -> None:
    file = tmp_path / "f.jsonl"
    file.write_text(text)
    with pytest.raises(DatasetError, match=FILES[text]):
        read(file)


def test_data_are_fitted_again_from_their_file(
    data: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "samples.jsonl", tmp_path / "out"
    file.write_text("\n".join(_lines(data)) + "\n")
    assert read(str(file)).samples == read(tmp_path).samples == data.samples
    assert identify.main(["--from", str(file), "--json", "--out", str(out)]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert set(printed["stiffness"]) == {"rotation", "translation"}
    report = (out / "report.html").read_text()
    assert report.count("<svg") == 5
    assert "http://" not in report.replace("http://www.w3.org", "").replace("http://purl.org", "").replace(
        "http://creativecommons.org", ""
    )
    assert "src=" not in report


def _record(folder: Path, lines: list[str]) -> Path:
    """A bag of the node's topic; the single file in it."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_JAZZY)
    text = types.types[TYPE]
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection(f"/arm/{TOPIC}", TYPE, typestore=types)
        for i, line in enumerate(lines):
            writer.write(topic, 1_000_000 * i, bytes(types.serialize_cdr(text(data=line), TYPE)))
    return next(folder.glob("*.mcap"))


def test_a_bag_is_fitted_again_as_folder_and_as_file(data: Dataset, tmp_path: Path) -> None:
    lines = _lines(data)
    inner = _record(tmp_path / "bag", [*lines[:70], *lines])  # a run that went on says once more what it has
    single = tmp_path / "single.mcap"
    single.write_bytes(inner.read_bytes())
    for path in (tmp_path / "bag", inner, single):
        assert read(path).samples == data.samples
    held = header_line(replace(data.header, sensor_xyz=(0.0, 0.0, 0.05)))
    assert read(_record(tmp_path / "corrected", [held, *lines])).header == data.header
    other = header_line(replace(data.header, run="another"))
    mixed = _record(tmp_path / "mixed", [*lines[:70], other, *lines[70:]])
    with pytest.raises(DatasetError, match="holds 2 identifications"):
        read(mixed)

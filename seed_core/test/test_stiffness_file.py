# SPDX-License-Identifier: Apache-2.0
"""stiffness.yaml: there and back, between grips, and what is refused."""

from dataclasses import replace
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from seed_core.config import ConfigError
from seed_core.stiffness_file import GripStiffness, IdentifiedGrip, StiffnessFile, load_stiffness, save_stiffness

LOOSE = IdentifiedGrip(20.0, 0.060, (3.0, 2.0, 3.0), (600.0, 900.0, 600.0), (0.1, 0.1, 0.1), (5.0, 5.0, 5.0))
FIRM = IdentifiedGrip(40.0, 0.050, (5.0, 4.0, 5.0), (1000.0, 1500.0, 1000.0))
FILE = StiffnessFile("soft_bubble", "ft_sensor", "2026-01-31", (LOOSE, FIRM))


def test_file_comes_back_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "stiffness.yaml"
    save_stiffness(path, FILE)
    assert load_stiffness(path) == FILE
    assert list(tmp_path.iterdir()) == [path]


def test_stiffness_is_straight_between_grips_and_constant_beyond() -> None:
    grip = GripStiffness(FILE)
    assert grip.at_pressure(20.0) == LOOSE.stiffness
    assert_allclose(grip.at_pressure(30.0).translation, (800.0, 1200.0, 800.0))
    assert_allclose(grip.at_width(0.055).rotation, (4.0, 3.0, 4.0))
    assert grip.at_pressure(5.0) == LOOSE.stiffness
    assert grip.at_pressure(90.0) == FIRM.stiffness
    assert grip.at_width(0.04) == FIRM.stiffness


def test_an_unknown_pressure_among_known_ones_is_refused() -> None:
    with pytest.raises(ConfigError, match="pressure_hpa is 0, that is unknown, of 1 of 2 grips"):
        replace(FILE, grips=(replace(LOOSE, pressure_hpa=0.0), FIRM))


def test_one_grip_is_a_constant() -> None:
    with pytest.raises(ConfigError, match="width = 52 m must be within 0 and 1 m: is it in metres"):
        GripStiffness(FILE).at_width(52.0)
    grip = GripStiffness(StiffnessFile("h", "t", "2026-01-31", (FIRM,)))
    assert grip.at_pressure(0.0) == grip.at_pressure(99.0) == grip.at_width(0.1) == FIRM.stiffness


def test_pressure_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ConfigError, match="pressure = nan hPa must be finite"):
        GripStiffness(FILE).at_pressure(float("nan"))


def test_grips_without_pressures_are_told_apart_by_width_alone() -> None:
    grips = replace(LOOSE, pressure_hpa=0.0), replace(FIRM, pressure_hpa=0.0)
    grip = GripStiffness(replace(FILE, grips=grips))
    assert_allclose(grip.at_width(0.055).rotation, (4.0, 3.0, 4.0))
    with pytest.raises(ConfigError, match="have no pressures: let the stiffness follow the width"):
        grip.at_pressure(30.0)
    with pytest.raises(ConfigError, match=r"falling order of width_m; 0\.06 m follows 0\.05 m"):
        replace(FILE, grips=grips[::-1])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("- 3.0", "- -3.0", r"grips\[0\].rotation\[0\] = -3 N m/rad must be within"),
        ("model: midpoint", "model: cubic", "model = 'cubic' must be one of: midpoint, plain"),
        ("version: 1", "version: 2", "version = 2 must be within 1 and 1"),
        ("pressure_hpa: 40.0", "pressure_hpa: 10.0", "rising order of pressure_hpa; 10 hPa follows 20 hPa"),
        ("hand: soft_bubble\n", "", "'hand' is missing"),
    ],
)
def test_bad_files_are_refused_with_line_and_bound(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "stiffness.yaml"
    save_stiffness(path, FILE)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError, match=words) as caught:
        load_stiffness(path)
    assert str(caught.value).startswith(f"{path}:")


def test_a_file_that_could_not_be_loaded_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "stiffness.yaml"
    save_stiffness(path, FILE)
    pascal = replace(FILE, grips=(replace(LOOSE, pressure_hpa=102100.0),))
    with pytest.raises(ConfigError, match=r"grips\[0\]\.pressure_hpa = 102100 hPa must be within 0 and 2000 hPa"):
        save_stiffness(path, pascal)
    assert load_stiffness(path) == FILE
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_was_cut_short_is_refused_wherever_it_ends(tmp_path: Path) -> None:
    path = tmp_path / "stiffness.yaml"
    save_stiffness(path, FILE)
    text = path.read_text()
    for end in range(len(text) - 1):  # without its last line feed it is whole
        path.write_text(text[:end])
        with pytest.raises(ConfigError):
            load_stiffness(path)


def test_a_file_of_another_kind_is_told_from_one_that_was_cut_short(tmp_path: Path) -> None:
    path = tmp_path / "wipe.yaml"
    path.write_text("name: wipe\ntool: squeegee\nphases: []\n")
    with pytest.raises(ConfigError, match=r"yaml is no stiffness file: unknown key 'name'; a stiffness file has hand,"):
        load_stiffness(path)

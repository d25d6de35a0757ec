# SPDX-License-Identifier: Apache-2.0
"""The strict loader: every mistake in a file is refused with file, line, value, bound and remedy."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest

from seed_core.config import ConfigError, check_values, field, from_mapping, load_file, load_text, to_mapping


@dataclass(frozen=True)
class Inner:
    gain: float = field(1.0, unit="1/s", low=0.0, high=10.0, doc="of the loop")
    names: tuple[str, ...] = field(("a",), doc="labels")


@dataclass(frozen=True)
class Outer:
    speed: float = field(unit="m/s", low=0.0, high=1.0, doc="of the arm")
    mode: str = field("slow", choices=("slow", "fast"))
    count: int = field(3, low=1, high=5)
    flag: bool = field(False)
    width: int = field(7, unit="px", low=0, high=50)
    way: tuple[float, float] = field((0.0, 0.0), unit="m", quantity=True, low=-1, high=1)
    inner: Inner = field(Inner())
    tilt: tuple[float, float] = field((0.0, 1.0), unit="deg", low=-9, high=9, span=True, doc="drawn")
    maybe: float | None = field(None, unit="s", low=0.0)


GOOD = "speed: 0.5\nway: 0.1 -0.2 m\ninner:\n  gain: 2\n  names: [x, y]\nmaybe: null\n"


def test_file_becomes_a_frozen_dataclass_and_plain_data_again(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(GOOD)
    value = load_file(path, Outer)
    assert value == Outer(0.5, way=(0.1, -0.2), inner=Inner(2.0, ("x", "y")))
    assert to_mapping(value)["inner"] == {"gain": 2.0, "names": ["x", "y"]}


BOMB = "\n".join(f"{b}: &{b} [{', '.join(['*' + a] * 10)}]" for a, b in pairwise("_abcdefgh")).replace("*_", "x")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("speed: 1.5", "f.yaml:1: speed = 1.5 m/s must be within 0 and 1 m/s"),
        ("speed: .nan", "f.yaml:1: speed = nan m/s must be finite"),
        ("speed: fast", "f.yaml:1: speed = 'fast' must be a number"),
        ("speed: true", "f.yaml:1: speed = True must be a number"),
        ("mode: slow", "f.yaml:1: 'speed' is missing .m/s; of the arm."),
        ("speed: 0.5\nmode: idle", "f.yaml:2: mode = 'idle' must be one of: slow, fast"),
        ("speed: 0.5\ncount: 2.5", "f.yaml:2: count = 2.5 must be a whole number"),
        ("speed: 0.5\nflag: 1", "f.yaml:2: flag = 1 must be true or false"),
        ("speed: 0.5\nspede: 1", "f.yaml:2: unknown key 'spede'; known here: speed, mode"),
        ("speed: 0.5\nspeed: 0.6", "f.yaml:2: key 'speed' stands twice"),
        ("speed: 0.5\ninner: 3", "f.yaml:2: inner must be a mapping"),
        ("speed: 0.5\ninner:\n  gain: 11", "f.yaml:3: inner.gain = 11 1/s must be within 0 and 10 1/s"),
        ("speed: 0.5\nway: 0.1 0.2", "f.yaml:2: way = '0.1 0.2' must be numbers with their unit, m"),
        ("speed: 0.5\nway: 0.1 0.2 mm", "with their unit, m: for example 0.5 m"),
        ("speed: 0.5\nway: 0.1 m", "f.yaml:2: way must be a list"),
        ("speed: 0.5\nway: 0.1 0.2 0.3 m", "f.yaml:2: way has 3 values; it needs 2"),
        ("speed: 0.5\nway: nan 0.2 m", r"f.yaml:2: way\[0\] = nan m must be finite"),
        ("speed: 500 mm/s", "f.yaml:1: speed = '500 mm/s' must be a number .m/s"),
        ("speed: 1.5 m/s", "f.yaml:1: speed = 1.5 m/s must be within 0 and 1 m/s"),
        ("speed: nan m/s", "f.yaml:1: speed = nan m/s must be finite"),
        ("speed: 0.1 0.2 m/s", "f.yaml:1: speed = .0.1, 0.2. must be a number"),
        ("speed: 0.5\nwidth: 7.5 px", "f.yaml:2: width = 7.5 must be a whole number"),
        ("speed: 0.5\nwidth: 51 px", "f.yaml:2: width = 51 px must be within 0 and 50 px"),
        (
            "speed: 0.5\ntilt: [3.0, -3]",
            r"f.yaml:2: tilt = \[3, -3\] must run from low to high: \[-3, 3\] .deg; drawn.$",
        ),
        (
            "speed: 0.5\ntilt: 0.1 rad",
            "f.yaml:2: tilt = '0.1 rad' must be in deg: a number or a list of two, with or without",
        ),
        ("speed: 0.5\ntilt: low", r"f.yaml:2: tilt must be a number or a list of two \(deg; drawn\), not 'low'"),
        ("speed: [1", "f.yaml: not readable as YAML"),
        (BOMB, "f.yaml:.: aliases .*name. make more than 100[0-9]+ values of this text"),
        (
            'speed: 0.5\nmode: "\\ud800"',
            r"f.yaml:2: a text has the character '\\ud800', which cannot be written or sent",
        ),
        ('speed: 0.5\n"mo\\0de": x', r"f.yaml:2: a text has the character '\\x00'"),
        ("speed: " + 50_000 * "[" + 50_000 * "]", "f.yaml: not readable as YAML"),  # an error, and no crash
        ("speed: !!python/object/apply:os.system ['true']", r"speed = \['true'\] must be a number"),
    ],
)
def test_mistakes_name_line_value_and_bound(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load_text(text, Outer, "f.yaml")


def test_a_number_may_be_written_with_its_unit() -> None:
    assert load_text("speed: 0.5 m/s\nmaybe: 2 s\ninner: {gain: 2 1/s}\nwidth: 9 px", Outer) == Outer(
        0.5, width=9, maybe=2.0, inner=Inner(2.0)
    )
    assert isinstance(load_text("speed: 1 m/s", Outer).speed, float)


@pytest.mark.parametrize("written", ["010", "-010", "1:30", "1:30.5"])
def test_a_number_that_yaml_reads_in_another_base_is_refused(written: str) -> None:
    with pytest.raises(ConfigError, match=f"f.yaml:2: YAML reads {written} as"):
        load_text(f"speed: 0.5\ntilt: {written}", Outer, "f.yaml")


def test_values_from_code_are_checked_alike() -> None:
    assert from_mapping({"speed": 1}, Outer).speed == 1.0
    with pytest.raises(ConfigError, match="speed = 2 m/s must be within"):
        from_mapping({"speed": 2.0}, Outer)


def test_missing_and_huge_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nothing.yaml: cannot be read"):
        load_file(tmp_path / "nothing.yaml", Outer)
    with pytest.raises(ConfigError, match="too many for a configuration file"):
        load_text("#" * 10_000_001, Outer)


def test_values_are_checked_each_by_itself() -> None:
    check_values({"mode": "fast"}, Outer)  # though speed is missing
    with pytest.raises(ConfigError, match=r"speed = 2 m/s must be within 0 and 1 m/s"):
        check_values({"mode": "fast", "speed": 2.0}, Outer)

# SPDX-License-Identifier: Apache-2.0
"""docs/scenarios.md has every key of a scenario file, with unit, bounds, default and meaning as they are declared."""

import dataclasses
from pathlib import Path

import pytest

pytest.importorskip("pydrake", reason="needs Drake")

from seed_core.config import field
from seed_testing.scenario_keys import rows_of, tables, with_tables

DOCUMENT = Path(__file__).parents[2] / "docs" / "scenarios.md"


@pytest.mark.skipif(not DOCUMENT.is_file(), reason="this is an installed copy")
def test_the_page_has_the_keys_as_they_are() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    assert with_tables(text) == text, "run: python -m seed_testing.scenario_keys docs/scenarios.md"


def test_every_key_has_a_meaning() -> None:
    rows = [line.split(" | ") for line in tables().splitlines() if line.startswith("| `")]
    assert len(rows) > 200
    for key, *_, meaning in rows:
        assert meaning.removesuffix(" |"), key


@dataclasses.dataclass(frozen=True)
class Inner:
    wide: float = field(0.5, unit="mm", low=0.0, high=2.0, doc="how wide")


@dataclasses.dataclass(frozen=True)
class Outer:
    kind: str = field("a", choices=("a", "b"), doc="which")
    inner: Inner = field(Inner(0.7), doc="a section")
    other: Inner | None = field(None, doc="another")


def test_a_row_has_unit_bounds_and_the_default_of_its_place() -> None:
    assert list(rows_of(Outer, Outer(), "o.")) == [
        "| `o.kind` | a |  | a, b | which |",
        "| `o.inner` |  |  |  | a section |",
        "| `o.inner.wide` | 0.7 | mm | 0 to 2 | how wide |",
        "| `o.other` | none |  |  | another |",
        "| `o.other.wide` | 0.5 | mm | 0 to 2 | how wide |",
    ]

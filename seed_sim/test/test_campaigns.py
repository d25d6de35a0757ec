# SPDX-License-Identifier: Apache-2.0
"""The file of a campaign: what it keeps, what is none of it, and where it may lie."""

from typing import Any

import pytest

from seed_core.errors import SeedError
from seed_sim.campaigns import kept_runs
from seed_sim.closed_loop import surfaces


@pytest.mark.parametrize("text", ["notes", "notes\n", '{"draw": 3}\n', "[3]\n"])
def test_a_file_of_something_else_is_refused_and_left_as_it_is(text, tmp_path):
    file = tmp_path / "notes.txt"
    file.write_text(text)
    with pytest.raises(SeedError, match=r"notes\.txt:1: not a draw .*: name another file"):
        kept_runs(file, lambda run: run["world"], "a draw")
    assert file.read_text() == text


def test_a_folder_that_is_missing_is_made_before_the_first_run(tmp_path, monkeypatch):
    ran: list[Any] = []

    def run(task: str, scenario: str, seed: int) -> dict[str, Any]:
        ran.append(scenario)
        return {"task": task, "scenario": scenario, "seed": seed, "surface": None}

    monkeypatch.setattr(surfaces, "one_surface", run)
    file = tmp_path / "new" / "runs.jsonl"
    made = surfaces.surfaces(2, 1, ["cylinder"], keep=file)
    assert (len(ran), len(file.read_text().splitlines())) == (2, 2)
    assert surfaces.surfaces(2, 1, ["cylinder"], keep=file) == made
    assert len(ran) == 2
    with pytest.raises(OSError, match=r"runs\.jsonl/file"):
        surfaces.surfaces(2, 1, ["cylinder"], keep=file / "file" / "runs.jsonl")
    assert len(ran) == 2

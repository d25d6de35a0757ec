# SPDX-License-Identifier: Apache-2.0
"""A campaign of insertions is resumable, and its summary is that of known cases."""

import json
from pathlib import Path

import pytest

from seed_core.errors import SeedError
from seed_testing.bench.campaigns.insertion import run, summarised

SETTINGS = {"task": "insert_peg", "estimator": "noisy", "clearance": None}


def case(seed: int, success: bool, force: float, time: float) -> dict[str, object]:
    done = {"success": success, "inserted": time, "found": 0.5 * time, "largest_force": force, "squeeze": 2.0 * force}
    return {**SETTINGS, "seed": seed, "message": "finished" if success else "stuck", **done}


CASES = [case(1, True, 3.0, 2.0), case(2, True, 13.0, 4.0), case(3, False, 5.0, 9.0)]


def test_summary_of_known_cases() -> None:
    out = summarised(CASES)
    assert (out["successes"], out["cases"]) == (2, 3)
    assert (out["time_mean_s"], out["force_worst_n"], out["squeeze_worst_n"]) == (3.0, 13.0, 26.0)
    assert out["beyond_12_n"] == [2]
    assert out["failed"] == {3: "stuck"}
    assert out["search_mean_s"] == 1.5


def test_a_case_that_searched_nothing_is_in_no_mean_of_searches() -> None:
    known = {**CASES[0], "seed": 4, "found": None}
    assert summarised([*CASES, known])["search_mean_s"] == 1.5
    assert summarised([known])["search_mean_s"] is None


def test_cases_that_are_kept_are_not_run_again(tmp_path: Path) -> None:
    out = tmp_path / "cases.jsonl"
    out.write_text("".join(json.dumps(c) + "\n" for c in CASES))
    assert run(SETTINGS, [1, 2, 3], out=out) == CASES
    with pytest.raises(SeedError, match="other settings"):
        run({**SETTINGS, "clearance": 0.1}, [1], out=out)
    out.write_text("nonsense\n")
    with pytest.raises(SeedError, match="not a case"):
        run(SETTINGS, [1], out=out)


def test_a_task_without_a_hole_is_refused() -> None:
    with pytest.raises(SeedError, match="no hole"):
        run({**SETTINGS, "task": "squeegee"}, [1])

# SPDX-License-Identifier: Apache-2.0
"""The comparison: scores from a run worked out by hand, who wins, resuming, and runs of rivals in the plant."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.errors import SeedError
from seed_sim.closed_loop.recording import Recording
from seed_sim.comparison import campaign as campaign_module
from seed_sim.comparison.bumps import Bumps
from seed_sim.comparison.campaign import campaign
from seed_sim.comparison.cases import CASES, case_named
from seed_sim.comparison.command import main
from seed_sim.comparison.methods import METHODS, Method, method_named
from seed_sim.comparison.page import cell_of
from seed_sim.comparison.run import Run, scored
from seed_sim.comparison.score import SCORES, scores_of
from seed_sim.comparison.table import lines_of, text
from seed_sim.comparison.tuning import SEEDS, chosen_settings, tuning_file

RATE = 250.0  # [Hz]


def recording_of(press: np.ndarray, wipe: np.ndarray) -> Recording:
    """A run with these forces onto the table [N], 10 N wanted."""
    recording = Recording(["approach", "press", "wipe", "lift"])
    for i, force in enumerate(np.concatenate([press, wipe])):
        recording.add(
            t=i / RATE,
            phase=1 if i < len(press) else 2,
            force=np.array((0.0, 0.0, -force)),
            wanted_force=np.array((0.0, 0.0, -10.0)),
            torque_T=np.array((0.2, 0.0, 0.0)),
            lean=np.array((0.5, np.deg2rad(3.0), np.deg2rad(4.0))),
        )
    recording.finished = True
    return recording


def test_scores_are_those_worked_out_by_hand() -> None:
    press = np.concatenate([np.zeros(100), np.full(25, 14.0), np.full(100, 10.0)])
    wipe = np.tile((9.0, 11.0), 100)
    s = scores_of(recording_of(press, wipe), 10.0)
    assert_allclose(s["rms"], 1.0)
    assert_allclose(s["p90"], 1.0)
    assert_allclose(s["press_rms"], np.sqrt(25 * 16.0 / 125))
    assert_allclose(s["peak"], 4.0)
    assert_allclose(s["overshoot"], 40.0)
    assert_allclose(s["rest"], 25 / RATE)
    assert_allclose(s["lean"], 5.0)  # 3 and 4 degrees; about x the torque rules
    assert_allclose(s["torque"], 0.2)
    assert s["lost"] == 0.0
    assert s["bandwidth"] is None


def test_lost_contacts_are_counted_and_no_contact_is_all_error() -> None:
    wipe = np.tile(np.concatenate([np.full(20, 10.0), np.zeros(5)]), 4)
    assert scores_of(recording_of(np.full(100, 10.0), wipe), 10.0)["lost"] == 4.0
    assert scores_of(recording_of(np.zeros(50), np.zeros(50)), 10.0)["rms"] == 10.0


def test_a_run_that_was_cut_short_is_all_error() -> None:
    recording = recording_of(np.full(100, 10.0), np.full(20, 10.0))
    recording.finished = False
    assert scores_of(recording, 10.0)["rms"] == 10.0


@pytest.mark.parametrize("before", [np.linspace(0.1, 9.0, 200), np.r_[0.06, np.zeros(150)], np.r_[4.0, np.zeros(150)]])
def test_the_peak_is_seen_however_softly_or_grazing_the_tool_came(before: np.ndarray) -> None:
    """0.6 to 0.8 s after first contact; what comes more than 0.3 s after the force was reached is no impact."""
    press = np.concatenate([before, np.full(10, 13.0), np.full(100, 10.0), np.full(10, 17.0)])
    assert_allclose(scores_of(recording_of(press, np.full(100, 10.0)), 10.0)["peak"], 3.0)


def test_a_press_that_does_not_reach_its_force_has_no_peak() -> None:
    assert scores_of(recording_of(np.full(200, 8.0), np.full(100, 8.0)), 10.0)["peak"] is None


def test_a_run_that_errs_by_more_than_the_wanted_force_gains_nothing_by_its_end() -> None:
    recording = recording_of(np.full(100, 10.0), np.tile((0.0, 25.0), 100))
    bounced = scores_of(recording, 10.0)
    recording.finished = False
    stopped = scores_of(recording, 10.0)
    assert_allclose(bounced["rms"], np.sqrt(0.5 * (10.0**2 + 15.0**2)))
    assert stopped["rms"] == bounced["rms"]
    assert stopped["p90"] == bounced["p90"] == 15.0


def test_each_step_of_the_force_is_a_phase_of_its_own() -> None:
    """Steps that share a name share a row of the score."""
    for case in CASES:
        names = [p.name for p in case.task().phases]
        assert len(set(names)) == len(names)
        assert sum(name.startswith("step ") for name in names) == len(case.steps)


def test_bumps_have_their_height() -> None:
    bumps = Bumps(size=1e-3, length=0.02, every=0.05)
    assert_allclose([bumps.height(x) for x in (0.01, 0.06, 0.005, 0.03)], (1e-3, 1e-3, 0.5e-3, 0.0))


def row(method: str, rms: float, case: str = "nominal", seed: int = 0) -> dict[str, object]:
    values: dict[str, object] = dict.fromkeys(SCORES)
    return (
        {"method": method, "case": case, "seed": seed, "settings": {}, "finished": True, "message": ""}
        | values
        | {"rms": rms}
    )


def test_the_best_wins_a_row_and_the_bound_wins_none() -> None:
    rows = [row("seed", 0.2), row("admittance", 0.1), row("ideal sensor", 0.01)]
    line = lines_of(rows)[0]
    assert line.winners == ("admittance",)
    assert line.medians["seed"] == 0.2
    level = lines_of([row("seed", 0.2), row("admittance", 0.208)])[0]
    assert level.winners == ("seed", "admittance")
    assert "adm." in text(rows).splitlines()[2]


def test_a_press_that_never_comes_to_rest_is_not_the_quickest() -> None:
    presses = [row("open loop", 9.0, seed=s) | {"press_rms": 9.0} for s in range(3)]
    presses[0]["rest"] = 0.1
    presses += [row("seed", 0.2, seed=s) | {"press_rms": 2.0, "rest": 0.4} for s in range(3)]
    (line,) = (line for line in lines_of(presses) if line[:2] == ("all cases", "rest"))
    assert line.medians == {"open loop": None, "seed": 0.4}


FAILED = {"finished": False, "rms": 10.0, "p90": 10.0}
GOOD = {"press_rms": 1.0, "peak": 0.5, "overshoot": 5.0, "rest": 0.4, "lean": 2.0, "torque": 0.02, "lost": 1.0}


@pytest.mark.parametrize("better", [0.5, 1.0])
def test_no_score_is_won_by_failing(better: float) -> None:
    """Of ten runs one survives, with scores half as large or the same; the other method finishes all of them."""
    rows = [row("seed", 0.2, seed=s) | {"p90": 0.3} | GOOD for s in range(10)]
    survivor = {name: better * value for name, value in GOOD.items()}
    rows += [row("published", 0.2, seed=0) | {"p90": 0.3} | survivor]
    rows += [row("published", 0.0, seed=s) | FAILED for s in range(1, 10)]
    lines = [line for line in lines_of(rows) if line.case == "nominal"]
    assert {line.score for line in lines} == set(SCORES) - {"bandwidth"}  # no step, no rise
    assert {line.winners for line in lines} == {("seed",)}
    assert [line.medians["published"] for line in lines if line.score == "lean"] == [None]
    steps = [row(m, 0.5, "force steps", s) | {"bandwidth": 3.0} for m in ("seed", "published") for s in range(3)]
    for lost in steps[4:]:
        lost.update(FAILED, bandwidth=None)
    (line,) = (line for line in lines_of(steps) if line[:2] == ("force steps", "bandwidth"))
    assert line.winners == ("seed",)


def test_a_method_of_which_few_runs_fail_keeps_its_median_and_loses_its_spread() -> None:
    rows = [row("seed", 0.2, seed=s) | {"p90": 0.3} | GOOD for s in range(10)]
    rows[3].update(dict.fromkeys(GOOD), **FAILED)
    (line,) = (line for line in lines_of(rows) if line[:2] == ("nominal", "lean"))
    assert line.medians["seed"] == 2.0
    assert line.ninety["seed"] is None
    assert "2 <small>-</small>" in cell_of(line, "seed")
    assert "inf" not in text(rows)


def test_runs_are_kept_and_only_missing_ones_are_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []

    def fake(works: list[tuple[Run, dict[str, float]]], jobs: int) -> list[dict[str, object]]:
        del jobs
        made.extend(run.key for run, _ in works)
        return [row(run.method, 0.1, run.case, run.seed) | {"settings": dict(s)} for run, s in works]

    monkeypatch.setattr(campaign_module, "scored_in_parallel", fake)
    file = tmp_path / "runs.jsonl"
    works: list[tuple[Run, dict[str, float]]] = [(Run("seed", "nominal", s), {}) for s in range(3)]
    campaign(works[:2], 1, file)
    with file.open("a", encoding="utf-8") as out:
        out.write('{"method": "se')  # interrupted while it was written
    assert [r["seed"] for r in campaign(works, 1, file)] == [0, 1, 2]
    assert made == ["seed|nominal|0", "seed|nominal|1", "seed|nominal|2"]
    campaign([(Run("seed", "nominal", 0), {"gain": 1.0})], 1, file)  # other settings: another run
    assert made[-1] == "seed|nominal|0"


def test_a_file_of_something_else_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "runs.jsonl"
    file.write_text("hello\nworld\n", encoding="utf-8")
    with pytest.raises(SeedError, match="not a run of"):
        campaign([(Run("seed", "nominal", 0), {})], 1, file)


def test_every_method_has_settings_of_its_own_and_tuning_has_other_seeds() -> None:
    chosen = chosen_settings(m.name for m in METHODS)
    for method in METHODS:
        as_which = method_named(method.tuned_as) if method.tuned_as else method
        assert set(chosen[method.name]) <= set(as_which.grid), method.name
        assert bool(chosen[method.name]) == bool(as_which.grid), method.name
    assert max(SEEDS) < 2000
    assert len(CASES) >= 10


@pytest.mark.parametrize("method", [m for m in METHODS if m.grid], ids=lambda m: m.name)
def test_every_method_was_tuned_on_the_whole_of_its_grid(method: Method) -> None:
    """Two had been tuned on a smaller one, and force mode had its best outside it."""
    tuned = json.loads(tuning_file().read_text())["methods"][method.name]
    assert tuned["grid"] == {name: list(values) for name, values in method.grid.items()}
    assert all(value in method.grid[name] for name, value in tuned["settings"].items())


@pytest.mark.parametrize("name", ["PI", "admittance, soft", "impedance"])
def test_a_tuned_rival_wipes_in_the_plant(name: str) -> None:
    """The same plant as ours, a sensor with its noise: within 15 % of the wanted force, and nothing breaks."""
    done = scored(Run(name, "nominal", 2100), chosen_settings([name])[name])
    assert done["finished"], done["message"]
    assert done["rms"] < 1.5
    assert done["torque"] < 0.4  # three deviations of what motors and joint torques are off by, 0.09 N m each


def test_without_noise_and_lateness_ours_is_nearer_and_wins_nothing() -> None:
    """Exact poses at every step of the control: what the lateness costs; as nobody has them, they win no row."""
    late, at_once = (scored(Run(name, "cylinder", 2100), {}) for name in ("seed, no noise", "seed, at once"))
    assert at_once["finished"], at_once["message"]
    assert at_once["rms"] < 0.7 * late["rms"]
    (line,) = (line for line in lines_of([late, at_once, late | {"method": "seed"}]) if line[:2] == ("cylinder", "rms"))
    assert line.winners == ()  # of one that counts there is nobody to win against


def test_bumps_are_felt_by_a_tool_that_does_not_give_way() -> None:
    assert case_named("bumps").bumps.size == 1e-3
    smooth, bumpy = (scored(Run("PI", c, 2101), chosen_settings(["PI"])["PI"]) for c in ("nominal", "bumps"))
    assert bumpy["rms"] > 2.0 * smooth["rms"]


def test_the_command_writes_its_tables_and_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--case", "pen", "--method", "seed", "--method", "force mode", "--seeds", "1", "--jobs", "1"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "Force error [N]" in said
    assert method_named("force mode").short in said
    runs = (tmp_path / "runs.jsonl").read_text(encoding="utf-8")
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    assert (tmp_path / "runs.jsonl").read_text(encoding="utf-8") == runs
    result = json.loads((tmp_path / "compare.json").read_text(encoding="utf-8"))
    assert {line["case"] for line in result["lines"]} == {"pen", "all cases"}
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "data:image/png;base64" in page
    assert "http" not in page  # it opens offline
    assert (tmp_path / "table.csv").read_text(encoding="utf-8").startswith("case,score,unit,seed,force mode")

# SPDX-License-Identifier: Apache-2.0
"""The judges of a live cell: when an arm stood, what rises, what was lost; against tracks and counts made by hand."""

import itertools
import json
import subprocess
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seed_testing.live import kills, load
from seed_testing.live.processes import Usage, cpu_time, descendants, usage
from seed_testing.live.slopes import slope
from seed_testing.live.soak_report import PICTURES, Samples, frames, summary, words
from seed_testing.live.verdict import faults_of, motion, moved_on

V, BRAKE = 0.05, 0.5  # [m/s], [m/s^2]
GOOD: dict[str, Any] = {
    "reached": True,
    "robot": "sim",
    "node": "controller",
    "fault": "kill",
    "phase": "wipe",
    "held_after_s": 0.15,
    "travel_mm": 4.0,
    "late_travel_mm": 0.0,
    "blind_s": 0.03,
    "speed_mm_s": 50.0,
    "force_n": 11.0,
    "force_before_n": 10.0,
    "wanted_n": 10.0,
    "state": "relative_pose is stale",
    "diagnostics": "/controller: relative_pose is stale",
    "needs_cause": True,
    "resumed_unasked": "",
    "recovered": True,
}


def braking(after: float) -> tuple[list[float], list[np.ndarray]]:
    """An arm at 50 mm/s that brakes from `after` [s] on; the fault is at t = 1 s."""
    times = np.arange(0.0, 3.0, 0.008)
    braked = np.clip(times - 1.0 - after, 0.0, V / BRAKE)
    way = V * np.minimum(times, 1.0 + after) + V * braked - 0.5 * BRAKE * braked**2
    return list(times), [np.array((x, 0.0, 0.1)) for x in way]


@pytest.mark.parametrize("after", [0.0, 0.1, 0.4])
def test_an_arm_has_stood_since_the_end_of_its_braking(after: float) -> None:
    seen = motion(*braking(after), fault=1.0, until=3.0)
    assert seen.held_after == pytest.approx(after + V / BRAKE, abs=0.03)
    assert seen.travel == pytest.approx(V * after + 0.5 * V**2 / BRAKE, abs=5e-4)
    assert seen.speed == pytest.approx(V, rel=0.02)


def test_an_arm_that_starts_again_has_not_been_held() -> None:
    times, places = braking(0.0)
    places = [p + np.array((0.01 * max(t - 2.0, 0.0), 0.0, 0.0)) for t, p in zip(times, places, strict=True)]
    assert motion(times, places, fault=1.0, until=3.0).held_after > 1.9


def test_a_track_that_ends_with_the_fault_tells_nothing() -> None:
    times, places = braking(0.0)
    seen = motion(times[:130], places[:130], fault=1.0, until=3.0)
    assert np.isnan(seen.held_after)
    assert seen.blind == pytest.approx(2.0, abs=0.04)


def test_an_arm_that_moves_while_nobody_sees_it_is_not_well() -> None:
    """Poses are missing from 0.05 s to 1.3 s after the fault, in which it goes on by 60 mm."""
    times = np.concatenate((np.arange(0.0, 1.05, 0.008), np.arange(2.3, 3.0, 0.008)))
    places = [np.array((V * min(t, 1.05) + 0.06 * (t > 2.0), 0.0, 0.1)) for t in times]
    seen = motion(list(times), places, fault=1.0, until=2.5)
    row = GOOD | {"held_after_s": seen.held_after, "late_travel_mm": 1e3 * seen.late_travel, "blind_s": seen.blind}
    assert faults_of(row) == ["not seen for 1.25 s"]
    assert faults_of(row | {"node": "sim"}) == []  # which is the arm itself
    assert faults_of(row | {"node": "sim", "robot": "ur"}) == ["not seen for 1.25 s"]


@pytest.mark.parametrize(
    ("changed", "wrong"),
    [
        ({}, []),
        ({"held_after_s": 0.5, "late_travel_mm": 12.0}, ["held after 0.50 s, 12.0 mm later than 0.2 s"]),
        ({"phase": "enabled", "wanted_n": 0.0, "force_n": 0.0}, ["moved by 4.0 mm while nothing was asked"]),
        ({"force_n": 15.5}, ["true force 15.5 N, 10.0 N before the fault"]),
        ({"state": "", "diagnostics": ""}, ["no cause in the state", "no cause in the diagnostics"]),
        ({"resumed_unasked": "contact goes on without a request"}, ["contact goes on without a request"]),
        ({"recovered": False}, ["did not recover"]),
        ({"recovered": None}, []),  # not tried
    ],
)
def test_a_case_is_judged_by_motion_force_words_and_what_comes_after(changed: dict[str, Any], wrong: list[str]) -> None:
    row = GOOD | changed
    assert faults_of(row) == wrong
    assert ("WRONG" in kills.line(row | {"wrong": wrong})) == bool(wrong)


def test_an_arm_that_goes_on_once_its_node_is_back_is_told() -> None:
    times, places = braking(0.0)
    assert moved_on(times, places, since=1.5) == ""
    assert moved_on([], [], since=1.5) == ""
    at_start = [np.array((0.0, 0.0, 0.2 - 0.03 * min(max(t - 5.0, 0.0), 1.0))) for t in np.arange(5.0, 7.0, 0.008)]
    times += list(np.arange(5.0, 7.0, 0.008))  # a simulated arm that began anew, and was sent back to where it was
    assert moved_on(times, places + at_start, since=3.0) == "moved on by 30.0 mm without a request"


def test_the_table_has_every_node_phase_and_fault_and_random_sequences_repeat() -> None:
    parse = kills._parser().parse_args
    everything = kills.table(parse([]))
    assert len(everything) == ((4 + 7) * len(kills.FAULTS) - 1) * len(kills.PHASES)
    assert not any(case[1:3] == ("driver/servo", "restart") for (case,) in everything)
    assert len(set(itertools.chain(*everything))) == len(everything)
    truth = kills.table(parse(["--method", "truth", "--robots", "sim"]))
    assert {node for ((_, node, _, _),) in truth} == {"controller", "sim"}
    drawn = [kills.table(parse(["--random", "20", "--seed", seed])) for seed in ("3", "3", "4")]
    assert drawn[0] == drawn[1] != drawn[2]
    assert len(drawn[0]) == 20


def test_a_table_goes_on_from_the_sequences_that_were_made_whole(tmp_path: Path) -> None:
    file = tmp_path / "kills.json"
    wipe, lift, stop = (
        ("sim", "controller", *rest) for rest in (("kill", "wipe"), ("kill", "lift"), ("restart", "wipe"))
    )
    sequences = [[wipe], [lift, stop], [stop]]
    assert kills.kept(file, sequences, "truth") == []
    names = ("robot", "node", "fault", "phase")
    row = {"reached": True, "method": "truth"}
    cases = [dict(zip(names, wipe, strict=True)) | row | {"sequence": 7}]
    cases += [dict(zip(names, lift, strict=True)) | row | {"sequence": 8}]  # and its second fault was not made
    cases += [dict(zip(names, stop, strict=True)) | row | {"sequence": 9, "reached": False}]
    file.write_text(json.dumps({"cases": cases}))
    assert [(r["sequence"], r["phase"]) for r in kills.kept(file, sequences, "truth")] == [(0, "wipe")]
    assert kills.kept(file, sequences, "rigid_fit") == []


def test_a_rise_is_told_from_noise_steps_and_warm_up() -> None:
    rng = np.random.default_rng(1)
    hours = np.linspace(0.0, 0.5, 180)
    noise = 0.3 * rng.standard_normal(180)
    warm = 20.0 * np.exp(-hours / 0.02)
    level, leak = slope(hours, 80.0 + noise - warm), slope(hours, 80.0 + noise + 20.0 * hours)
    assert level is not None
    assert not level.rises(1.0)
    assert leak is not None
    assert leak.rate == pytest.approx(20.0, abs=1.5)
    assert leak.rises(6.0)
    assert slope(hours[:5], noise[:5]) is None


def soaked(rise: float, used: int, missing: int, files: int = 0) -> Samples:
    """A run of 20 minutes with 45 sets of images a second."""
    s = Samples()
    for i in range(120):
        grown = {"estimator": Usage(80.0 + rise * i / 360.0, 18 + (files * i) // 40, 14)}
        sent = 450.0 * i
        counts = {"bubbles.pairs": 2.0 * sent, "estimator.pairs": used * i, "estimator.sets_missing": missing * i}
        s.add(10.0 * i, grown, counts | {"real_time_factor": 0.98})
    s.tasks = 80
    return s


def test_a_soak_is_level_or_says_what_grew_and_what_was_lost_unsaid() -> None:
    good = soaked(0.0, 449, 1)
    assert summary(good)["verdict"] == "level"
    assert frames(good) == (119 * 450.0, 119 * 449.0, 119.0)
    assert "verdict: level" in words(summary(good))
    assert "memory rises by 60" in summary(soaked(60.0, 450, 0))["verdict"]
    assert "estimator: files rise" in summary(soaked(0.0, 450, 0, files=1))["verdict"]
    assert "nothing counts them" in summary(soaked(0.0, 440, 0))["verdict"]
    assert "no task" in summary(Samples())["verdict"]


def test_a_soak_with_an_open_page_says_what_that_was_sent() -> None:
    for rate, verdict in ((10.0, "level"), (0.2, "the page was sent 0.2 pictures a second")):
        run = soaked(0.0, 449, 1)
        for t, figures in list(zip(run.times, run.figures, strict=True))[5:]:  # opened when the cell was ready
            figures[PICTURES] = rate * t
        result = summary(run)
        assert result["verdict"] == verdict
        assert f"page open: {rate} pictures a second" in words(result)


def test_a_process_is_measured_by_what_the_system_says(tmp_path: Path) -> None:
    import mmap
    import os

    before = usage(os.getpid())
    held = mmap.mmap(-1, 64 * 2**20, flags=mmap.MAP_PRIVATE)  # from the system: an allocator may have as much left over
    held.write(bytes(len(held)))
    with (tmp_path / "a").open("w"), (tmp_path / "b").open("w"):
        after = usage(os.getpid())
    held.close()
    assert before is not None
    assert after is not None
    assert after.files - before.files == 2
    assert after.rss - before.rss == pytest.approx(64.0, rel=0.2)
    assert usage(2**22 + 1) is None


def test_a_process_is_told_from_those_below_it() -> None:
    import os

    with subprocess.Popen(["sleep", "60"]) as child:
        assert child.pid in descendants(os.getpid())
        assert os.getpid() not in descendants(os.getpid())
        assert cpu_time(child.pid) < 0.1
        child.kill()
    assert child.pid not in descendants(os.getpid())
    before, until = cpu_time(os.getpid()), time.process_time() + 0.3
    while time.process_time() < until:
        pass
    assert cpu_time(os.getpid()) - before == pytest.approx(0.3, abs=0.1)
    assert np.isnan(cpu_time(2**22 + 1))


def test_a_short_soak_is_written_for_other_programs(tmp_path: Path) -> None:
    soaked(0.0, 449, 1).write(tmp_path / "samples.csv")
    lines = (tmp_path / "samples.csv").read_text().splitlines()
    assert lines[0].startswith("seconds,load,estimator.rss,estimator.files,estimator.threads,bubbles.pairs")
    assert len(lines) == 121


def test_plays_under_load_prepare_anew_after_a_failure(tmp_path, monkeypatch, capsys):
    said = []

    def answer(*words: str) -> dict:
        said.append(words)
        fails = words == ("play", "squeegee") and said.count(words) == 2
        return {"command": " ".join(words), "code": int(fails), "seconds": 30.0, "load": 20.0, "said": "held"}

    monkeypatch.setattr(load, "said", answer)
    monkeypatch.setattr(load, "cell", lambda _: nullcontext())
    assert load.main(["--busy", "0", "--demos", "1", "--plays", "3", "--out", str(tmp_path)]) == 1
    assert [w for w in said if w[0] != "demo"] == [
        *load.PREPARED,
        *2 * [("call", "controller/enable", "on"), ("play", "squeegee")],
        *load.PREPARED,
        ("call", "controller/enable", "on"),
        ("play", "squeegee"),
    ]
    out = capsys.readouterr().out
    assert "demo: 1 of 1 well" in out
    assert "play: 2 of 3 well" in out
    assert len(json.loads((tmp_path / "load.json").read_text())) == 4

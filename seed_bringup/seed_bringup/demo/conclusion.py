# SPDX-License-Identifier: Apache-2.0
"""What came of a demo: score, summary and report."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from seed_bringup.demo.baseline import Baseline
from seed_bringup.demo.figures import Phase, force_and_torque, relative_pose
from seed_bringup.demo.live import Played
from seed_bringup.demo.live_score import live_score, recording_of
from seed_bringup.demo.plan import Plan
from seed_bringup.demo.report import Report, text_table
from seed_bringup.demo.series import Series
from seed_bringup.demo.terminal import say
from seed_core.command_line import to_json
from seed_core.spatial import rpy_from_rotation
from seed_sim.closed_loop.evaluate import scored_phase
from seed_sim.closed_loop.recording import SETTLING, Recording

FORCE_BOUND, TORQUE_BOUND = 0.5, 0.08  # [N], [N m] rms
GAP = 0.3  # [s] in the recording above which the score is not to be trusted
SLOW = 0.98  # real-time factor below which it is said


def conclude(asked: Plan, played: Played, series: dict[str, Series], baselines: dict[str, Baseline]) -> bool:
    """Score the run, write summary.json and report.html, and say what they say; whether the force was held."""
    recording = recording_of(series, asked.task, asked.scenario.tool.X_Ttip, played.phases)
    score = live_score(recording, asked.task)
    gap = float(np.diff(recording["t"], prepend=0.0).max())
    if gap > GAP:
        say(f"the recording has a gap of {gap:.1f} s: the machine was too busy; the score may mislead")
    held = bool(
        score["samples"] > 0 and score["force_z"]["rmse"] <= FORCE_BOUND and score["torque_x"]["rmse"] <= TORQUE_BOUND
    )
    score["finished"] = True
    score["real_time_factor"] = played.real_time_factor
    scores = {"seed": score, **{law: b.score for law, b in baselines.items()}}
    local = [Phase(p.name, p.start - played.phases[0].start, p.end - played.phases[0].start) for p in played.phases]
    summary = to_json(_summary(asked, local, scores, held), indent=1)
    (asked.folder / "summary.json").write_text(summary, encoding="utf-8")
    page = _report(asked, played, series, baselines, recording, local, scores, held).html()
    (asked.folder / "report.html").write_text(page, encoding="utf-8")
    print(f"\n{text_table(scores)}\n")
    if played.real_time_factor < SLOW:
        say(f"the simulation ran at {played.real_time_factor:.2f} of real time: this machine was busy")
    say(f"force {'held' if held else 'NOT held'} (at most {FORCE_BOUND} N and {TORQUE_BOUND} N m rms)")
    return held


def _summary(asked: Plan, phases: list[Phase], scores: dict[str, dict[str, Any]], held: bool) -> dict[str, Any]:
    own, *others = scores
    return {
        "task": asked.task.name,
        "scenario": asked.scenario.name,
        "seed": asked.options.seed,
        "estimator": asked.options.estimator,
        "law": asked.options.law,
        "robot": asked.robot["robot"],
        "held": held,
        "bounds": {"force_z_rmse": FORCE_BOUND, "torque_x_rmse": TORQUE_BOUND},
        **scores[own],
        "baselines": {law: scores[law] for law in others},
        "phases": [{"name": p.name, "start": p.start, "end": p.end} for p in phases],
    }


def _report(
    asked: Plan,
    played: Played,
    series: dict[str, Series],
    baselines: dict[str, Baseline],
    recording: Recording,
    phases: list[Phase],
    scores: dict[str, dict[str, Any]],
    held: bool,
) -> Report:
    task, estimator, start = asked.task, asked.options.estimator, played.phases[0].start
    contact = recording.contact_time or 0.0
    wanted = max((abs(float(f)) for f in recording["wanted_force"][:, 2]), default=0.0)
    poses = {k: Series(series[k].t - start, series[k].values) for k in ("relative_pose", "true_relative")}
    estimated, true = (poses[k].between(0.0, phases[-1].end) for k in ("relative_pose", "true_relative"))
    return Report(
        title=f"{task.name.replace('_', ' ').capitalize()} at {wanted:g} N",
        subtitle="A grasped tool, pressed and moved by a position-controlled arm: force from tactile images alone, "
        "through the live ROS graph."
        if estimator != "truth"
        else "The live ROS graph, with the true relative pose in place of images.",
        held=held,
        scores=scores,
        force_figure=force_and_torque(
            _runs(recording, baselines, contact), wanted, _scored(asked, phases, contact), phases
        ),
        pose_figure=relative_pose(estimated, true, phases),
        pictures=played.pictures,
        details=_details(asked, played, phases, scores["seed"]),
        source="the true pose" if estimator == "truth" else f"tactile images ({estimator})",
        replay="replay.html" if (asked.folder / "replay.html").is_file() else "",
    )


def _runs(recording: Recording, baselines: dict[str, Baseline], contact: float) -> dict[str, tuple[Any, Any, Any]]:
    """Time [s], pressing force [N] and torque [N m] of this run and of the baselines, these shifted to its contact."""
    runs = {"SEED": (recording["t"], -recording["force"][:, 2], recording["torque_T"][:, 0])}
    for law, b in baselines.items():
        shift = contact - (b.score["contact"]["time"] or contact)
        runs[law.replace("_", " ")] = (b.t + shift, b.force, b.torque)
    return runs


def _scored(asked: Plan, phases: list[Phase], contact: float) -> tuple[float, float]:
    """The stretch of time [s] that the score is of."""
    name = scored_phase(asked.task)
    scored = [p for p in phases if p.name == name or p.name.endswith(f" {name}")] or phases[-2:-1] or phases
    return min(max(scored[0].start, contact + SETTLING), scored[-1].end), scored[-1].end


def _details(asked: Plan, played: Played, phases: list[Phase], score: dict[str, Any]) -> dict[str, str]:
    contact, frame = score["contact"]["time"], asked.task.frame
    rpy = rpy_from_rotation(frame.pose[:3, :3])
    return {
        "command": asked.command,
        "scenario": f"{asked.scenario.name}: {asked.scenario.description}".rstrip(": "),
        "first contact": "never" if contact is None else f"{contact:.2f} s after the start",
        "phases": ", ".join(f"{p.name} {p.end - p.start:.1f} s" for p in phases),
        "real-time factor": f"{played.real_time_factor:.3f}",
        "work frame": f"{frame.position} m, {tuple(round(math.degrees(a), 1) for a in rpy)} degrees",
        "data": "bag.mcap (rosbags, ros2 bag, Foxglove), summary.json",
    }

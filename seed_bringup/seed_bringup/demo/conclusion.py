# SPDX-License-Identifier: Apache-2.0
"""The end of a demo: score, summary and report."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from seed_bringup.demo.baselines import Baseline
from seed_bringup.demo.figures import force_and_torque, relative_pose
from seed_bringup.demo.live import LiveRun
from seed_bringup.demo.plan import Plan
from seed_bringup.demo.report import Report, text_table
from seed_bringup.demo.score import Phase, curve_of, recording_of, scored_stretch
from seed_bringup.demo.series import Series
from seed_bringup.demo.terminal import say
from seed_core.program.command_line import to_json
from seed_core.spatial import rpy_from_rotation
from seed_sim.closed_loop.recording import Recording, score, scored_phase

FORCE_BOUND, TORQUE_BOUND = 0.5, 0.08  # [N], [N m] rms
GAP = 0.3  # [s] in the recording above which the score is not to be trusted
SLOW = 0.98  # real-time factor below which it is said


def conclude(asked: Plan, live: LiveRun, series: dict[str, Series], baselines: dict[str, Baseline]) -> bool:
    """Score the run, write summary.json and report.html, and say what they say; whether the force was held."""
    done = _Conclusion(asked, live, series, baselines)
    gap = float(np.diff(done.recording["t"], prepend=0.0).max())
    if gap > GAP:
        say(f"the recording has a gap of {gap:.1f} s: the machine was too busy; the score may mislead")
    (asked.folder / "summary.json").write_text(to_json(done.summary(), indent=1), encoding="utf-8")
    (asked.folder / "report.html").write_text(done.report().html(), encoding="utf-8")
    print(f"\n{text_table(done.scores)}\n")
    if live.real_time_factor < SLOW:
        say(f"the simulation ran at {live.real_time_factor:.2f} of real time: this machine was busy")
    say(f"force {'held' if done.held else 'NOT held'} (at most {FORCE_BOUND} N and {TORQUE_BOUND} N m rms)")
    return done.held


@dataclass(frozen=True)
class _Conclusion:
    """What came of a run; times count from its first phase."""

    asked: Plan
    live: LiveRun
    series: dict[str, Series]
    baselines: dict[str, Baseline]

    @cached_property
    def recording(self) -> Recording:
        return recording_of(self.series, self.asked.task, self.asked.scenario.tool.X_Ttip, self.live.phases)

    @cached_property
    def score(self) -> dict[str, Any]:
        own = score(self.recording, scored_phase(self.asked.task))
        return own | {"finished": True, "real_time_factor": self.live.real_time_factor}

    @property
    def scores(self) -> dict[str, dict[str, Any]]:
        return {"seed": self.score, **{law: b.score for law, b in self.baselines.items()}}

    @property
    def held(self) -> bool:
        force, torque = self.score["force_z"]["rmse"], self.score["torque_x"]["rmse"]
        return bool(self.score["samples"] > 0 and force <= FORCE_BOUND and torque <= TORQUE_BOUND)

    @property
    def phases(self) -> list[Phase]:
        start = self.live.phases[0].start
        return [p._replace(start=p.start - start, end=p.end - start) for p in self.live.phases]

    def summary(self) -> dict[str, Any]:
        """summary.json."""
        return {
            "task": self.asked.task.name,
            "scenario": self.asked.scenario.name,
            "seed": self.asked.options.seed,
            "estimator": self.asked.options.estimator,
            "law": self.asked.options.law,
            "robot": self.asked.robot["robot"],
            "held": self.held,
            "bounds": {"force_z_rmse": FORCE_BOUND, "torque_x_rmse": TORQUE_BOUND},
            **self.score,
            "baselines": {law: b.score for law, b in self.baselines.items()},
            "phases": [p._asdict() for p in self.phases],
        }

    def report(self) -> Report:
        """report.html."""
        task, estimator, phases = self.asked.task, self.asked.options.estimator, self.phases
        contact = self.recording.contact_time or 0.0
        wanted = max((abs(float(f)) for f in self.recording["wanted_force"][:, 2]), default=0.0)
        runs = {"SEED": curve_of(self.recording)}
        for law, baseline in self.baselines.items():  # from its own first contact
            shift = contact - (baseline.score["contact"]["time"] or contact)
            runs[law.replace("_", " ")] = baseline.curve._replace(t=baseline.curve.t + shift)
        band = scored_stretch(phases, scored_phase(task), contact)
        estimated, true = (
            self.series[name].since(self.live.phases[0].start).between(0.0, phases[-1].end)
            for name in ("relative_pose", "true_relative")
        )
        return Report(
            title=f"{task.name.replace('_', ' ').capitalize()} at {wanted:g} N",
            subtitle="The live ROS graph, with the true relative pose in place of images."
            if estimator == "truth"
            else "A grasped tool, pressed and moved by a position-controlled arm: force from tactile images alone, "
            "through the live ROS graph.",
            held=self.held,
            scores=self.scores,
            force_figure=force_and_torque(runs, wanted, band, phases),
            pose_figure=relative_pose(estimated, true, phases),
            pictures=self.live.pictures,
            details=self._details(),
            source="the true pose" if estimator == "truth" else f"tactile images ({estimator})",
            replay="replay.html" if (self.asked.folder / "replay.html").is_file() else "",
        )

    def _details(self) -> dict[str, str]:
        contact, frame, scenario = self.recording.contact_time, self.asked.task.frame, self.asked.scenario
        rpy = rpy_from_rotation(frame.pose[:3, :3])
        return {
            "command": self.asked.command,
            "scenario": f"{scenario.name}: {scenario.description}".rstrip(": "),
            "first contact": "never" if contact is None else f"{contact:.2f} s after the start",
            "phases": ", ".join(f"{p.name} {p.end - p.start:.1f} s" for p in self.phases),
            "real-time factor": f"{self.live.real_time_factor:.3f}",
            "work frame": f"{frame.position} m, {tuple(round(math.degrees(a), 1) for a in rpy)} degrees",
            "data": "bag.mcap (rosbags, ros2 bag, Foxglove), summary.json",
        }

# SPDX-License-Identifier: Apache-2.0
"""The end of a demo: score, summary and report."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from seed_bringup.demo.baselines import Baseline
from seed_bringup.demo.figures import force_and_torque, path_on_table, relative_pose, true_and_believed
from seed_bringup.demo.hidden import Findings
from seed_bringup.demo.live import LiveRun
from seed_bringup.demo.plan import Plan
from seed_bringup.demo.report import Report, text_table
from seed_bringup.demo.score import Phase, belief_of, curve_of, recording_of, score_of_belief, scored_stretches
from seed_bringup.demo.series import Series
from seed_bringup.demo.terminal import say
from seed_bringup.pictures.scene import Scene, setup_picture
from seed_core.program.command_line import to_json
from seed_core.spatial import inverse_pose, rpy_from_rotation
from seed_sim.closed_loop.recording import SETTLING, Recording, score, scored_phase
from seed_sim.replay.plots import TOUCH

BOUNDS, HIDDEN_BOUNDS = (0.5, 0.08), (1.0, 0.15)  # [N], [N m] rms, of a known and of a hidden world
GAP = 0.3  # [s] in the recording above which the score is not to be trusted
SLOW = 0.98  # real-time factor below which it is said


def conclude(
    asked: Plan,
    live: LiveRun,
    series: dict[str, Series],
    baselines: dict[str, Baseline],
    findings: Findings | None = None,
) -> bool:
    """Score the run, write summary.json and report.html, and say what they say; whether the force was held."""
    done = _Conclusion(asked, live, series, baselines, findings)
    gap = float(np.diff(done.recording["t"], prepend=0.0).max())
    if gap > GAP:
        say(f"the recording has a gap of {gap:.1f} s: the machine was too busy; the score may mislead")
    (asked.folder / "summary.json").write_text(to_json(done.summary(), indent=1), encoding="utf-8")
    (asked.folder / "report.html").write_text(done.report().html(), encoding="utf-8")
    print(f"\n{text_table(done.scores)}\n")
    if live.real_time_factor < SLOW:
        say(f"the simulation ran at {live.real_time_factor:.2f} of real time: this machine was busy")
    if done.belief is not None:
        say(belief_words(done.belief))
    force, torque = done.bounds
    say(f"force held (at most {force} N and {torque} N m rms)" if done.held else f"force NOT held: {done.why_not}")
    return done.held


def belief_words(belief: dict[str, Any]) -> str:
    """Whether the controller knew the force, in words."""
    share, off = belief["in_band"], belief["error"]
    words = f"believed and true force differ by {off:.2f} N rms, {belief['stated']:.2f} N are stated"
    return f"{words}; the truth lay within two stated deviations for {share:.0%} of the time"


@dataclass(frozen=True)
class _Conclusion:
    """What came of a run; times count from its first phase."""

    asked: Plan
    live: LiveRun
    series: dict[str, Series]
    baselines: dict[str, Baseline]
    findings: Findings | None

    @property
    def bounds(self) -> tuple[float, float]:
        """Largest rms of force [N] and torque [N m] that count as held."""
        return HIDDEN_BOUNDS if self.asked.hidden else BOUNDS

    @property
    def belief(self) -> dict[str, Any] | None:
        """Of believed against true force."""
        found: dict[str, Any] | None = self.score["believed_z"]
        return found

    @cached_property
    def recording(self) -> Recording:
        return recording_of(self.series, self.asked.task, self.asked.scenario.tool.X_Ttip, self.live.phases)

    @cached_property
    def score(self) -> dict[str, Any]:
        phase = scored_phase(self.asked.task)
        own = score(self.recording, phase) | {"believed_z": score_of_belief(self.recording, phase)}
        return own | {
            "finished": not self.live.early,
            "message": self.live.early,
            "real_time_factor": self.live.real_time_factor,
        }

    @property
    def scores(self) -> dict[str, dict[str, Any]]:
        return {"seed": self.score, **{law: b.score for law, b in self.baselines.items()}}

    @property
    def held(self) -> bool:
        return not self.why_not

    @property
    def why_not(self) -> str:
        """Why the force does not count as held, '' if it does."""
        if self.live.early:
            return self.live.early
        if not self.score["samples"]:
            return f"nothing of '{scored_phase(self.asked.task)}' was scored"
        off = (self.score["force_z"]["rmse"], self.score["torque_x"]["rmse"])
        return ", ".join(
            f"{name} is {is_off:.2f} {unit} rms off (at most {bound:g} {unit})"
            for name, unit, is_off, bound in zip(("force", "torque"), ("N", "N m"), off, self.bounds, strict=True)
            if not is_off <= bound
        )

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
            "bounds": dict(zip(("force_z_rmse", "torque_x_rmse"), self.bounds, strict=True)),
            "world": "hidden" if self.asked.hidden else "known",
            "found": self.findings.figures if self.findings else None,
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
        scored = scored_stretches(phases, scored_phase(task), contact)
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
            force_figure=force_and_torque(runs, wanted, scored, phases),
            belief_figure=true_and_believed(belief_of(self.recording), scored, phases),
            hidden=self._hidden(),
            pose_figure=relative_pose(estimated, true, phases),
            pictures=self.live.pictures,
            details=self._details(),
            source="the true pose" if estimator == "truth" else f"tactile images ({estimator})",
            asked=self._asked(wanted),
            happened=self._happened(),
            setup=setup_picture(self._scene()),
            path_figure=path_on_table(self.recording, scored_phase(task)),
            phase=scored_phase(task),
            replay="replay.html" if (self.asked.folder / "replay.html").is_file() else "",
        )

    def _asked(self, wanted: float) -> str:
        """What was asked for, in a sentence."""
        task, o = self.asked.task, self.asked.options
        what = task.description.strip().rstrip(".") or f"the task '{task.name}'"
        eyes = "the simulation's own truth" if o.estimator == "truth" else "two tactile cameras"
        where = "in a hidden world" if self.asked.hidden else "in a known world"
        return (
            f"{what[:1].upper()}{what[1:]}, at {wanted:g} N, with a {self.asked.scenario.tool_kind.replace('_', ' ')} "
            f"that is only grasped, seen by {eyes}, {where} (seed {o.seed})."
        )

    def _happened(self) -> str:
        """What came of it, in a sentence."""
        contact, phase = self.recording.contact_time, scored_phase(self.asked.task)
        if contact is None:
            return "The tool never touched the table."
        words, force = f"The tool touched the table after {contact:.1f} s", self.score["force_z"]
        if self.score["samples"]:
            words += f"; over '{phase}' it pressed with {-force['mean']:.2f} N on average"
            words += f", {force['rmse']:.2f} N rms off"
        else:
            words += f"; '{phase}' did not last until {SETTLING:g} s later, so its force is not scored"
        if self.held:
            return f"{words}, and the force counts as held (at most {self.bounds[0]:g} N)."
        return f"{words}. The force does not count as held: {self.why_not}."

    def _scene(self) -> Scene:
        """The cell in the middle of the scored stretch."""
        scenario, begin = self.asked.scenario, self.live.phases[0].start
        end = self.live.phases[-1].end
        scored = np.flatnonzero(self.recording.scored(scored_phase(self.asked.task)))
        t = self.recording["t"]
        at = begin + float(t[scored[len(scored) // 2]] if scored.size else t[len(t) // 2])
        names = ("true_tip", "true_relative", "true_wrench")
        X_Wtip, X_CT, load = (self.series[name].nearest(np.array([at]))[0] for name in names)
        X_WC = X_Wtip @ inverse_pose(X_CT @ scenario.tool.X_Ttip)
        tips = self.series["true_tip"].between(begin, end)
        forces = self.series["true_wrench"].nearest(tips.t)[:, 3:]
        X_WS = self.asked.task.frame.pose
        X_WS[:3, 3] += X_WS[:3, 2] * float(X_WS[:3, 2] @ (X_Wtip[:3, 3] - X_WS[:3, 3]))  # where the tip found it
        return Scene(
            scenario.hand,
            scenario.tool,
            scenario.tool_kind,
            X_WC,
            X_CT,
            X_WS,
            tips.values[::4, :3, 3],
            np.linalg.norm(forces, axis=1)[::4] > TOUCH,
            -load[3:],
        )

    def _hidden(self) -> str:
        if self.findings is None:
            return ""
        return f"{self.findings.words} In this run {belief_words(self.belief)}." if self.belief else self.findings.words

    def _details(self) -> dict[str, str]:
        contact, frame, scenario = self.recording.contact_time, self.asked.task.frame, self.asked.scenario
        rpy = rpy_from_rotation(frame.pose[:3, :3])
        return {
            "command": self.asked.command,
            **({"ended": self.live.early} if self.live.early else {}),
            "scenario": f"{scenario.name}: {scenario.description}".rstrip(": "),
            "first contact": "never" if contact is None else f"{contact:.2f} s after the start",
            "phases": ", ".join(f"{p.name} {p.end - p.start:.1f} s" for p in self.phases),
            "real-time factor": f"{self.live.real_time_factor:.3f}",
            "work frame": f"{frame.position} m, {tuple(round(math.degrees(a), 1) for a in rpy)} degrees",
            "data": "bag.mcap (rosbags, ros2 bag, Foxglove), summary.json",
        }

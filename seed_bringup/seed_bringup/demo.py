# SPDX-License-Identifier: Apache-2.0
"""./seed demo: the simulated cell, live, plays a task on tactile images; ends with a report.

Every process of the real graph runs: simulation, cameras, estimator, controller, and a recorder. The exit code is 0
only if the force was held: at most 0.5 N and 0.08 N m rms against the simulation's own contact forces.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import signal
import sys
import time
from datetime import datetime
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import yaml

from seed_bringup.bags.recording import Recording
from seed_bringup.launcher import Launch
from seed_bringup.launching.packages import find_launch_file
from seed_bringup.showing.baseline import Baseline, start_baselines
from seed_bringup.showing.figures import Phase, force_and_torque, relative_pose
from seed_bringup.showing.live_score import TOPICS, live_score, recording_of
from seed_bringup.showing.report import Picture, Report, text_table
from seed_bringup.showing.series import Series, read_series
from seed_control.tasks import Task, load_task
from seed_core.command_line import Help, command, leaving_at_once, number, results_folder, seed_number, to_json
from seed_core.config import to_mapping
from seed_core.errors import FailedError, SeedError
from seed_core.spatial import rpy_from_rotation
from seed_sim.evaluate import SCENARIO_OF_TASK, scored_phase
from seed_sim.recording import SETTLING
from seed_sim.scenario import Scenario, load_scenario

FORCE_BOUND, TORQUE_BOUND = 0.5, 0.08  # [N], [N m] rms
GAP = 0.3  # [s] in the recording above which the score is not to be trusted
SLOW = 0.98  # real-time factor below which it is said
BASELINES = ("open_loop", "welded")
TASK_PATIENCE = 75.0  # [s]
RECORDED = [
    *TOPICS.values(),
    "/contact_patches",
    "/wrench_estimate",
    "/ft_sensor/wrench",
    "/joint_states",
    "/gripper/width",
    "/bubble_left/pressure",
    "/bubble_right/pressure",
    "/sim/real_time_factor",
    "/sim/ground_truth/table_pose",
    "/tf",
    "/tf_static",
    "/diagnostics",
]
IMAGES = ["/current_pose", "/target_frame"] + [  # with the fast streams, what a playback needs
    f"/bubble_{f}/{t}"
    for f in ("left", "right")
    for t in ("depth/image_rect_raw", "ir/image_rect_raw", "depth/camera_info")
]
CORES = 4  # that the live graph wants at full rates
STANDIN = "127.0.0.2"  # where the demo's stand-in UR controller listens
SMALL_CAMERA_RATE = 22.5  # [Hz] with fewer: every other picture
LOOP_RATE, SMALL_LOOP_RATE = 250.0, 125.0  # [Hz] of arm and controller, with enough cores and with fewer


def live_rates() -> tuple[float, float]:
    """Rates of cameras (0: the scenario's) and of control that the live graph keeps on this machine [Hz]."""
    return (SMALL_CAMERA_RATE if _small() else 0.0), _loop_rate()


def _small() -> bool:
    """Whether this machine is too small for cameras at 45 Hz and control at 250 Hz beside a simulation."""
    return len(os.sched_getaffinity(0)) < CORES


def _loop_rate() -> float:
    """Rate of arm and controller on this machine [Hz]."""
    return SMALL_LOOP_RATE if _small() else LOOP_RATE


def _parser() -> argparse.ArgumentParser:
    p = argparse.ArgumentParser(
        prog="seed demo",
        description=(__doc__ or "").split("\n\n")[0],
        formatter_class=Help,
    )
    p.add_argument("--task", default="squeegee", help="name of a shipped task, or a task file")
    p.add_argument("--force", type=float, help="[N] size of every force in the task; the task's own if left out")
    p.add_argument("--seed", type=seed_number, default=7, help="draws the table and all noise")
    p.add_argument("--scenario", help="what is simulated: a shipped scenario or a file; the task's own if left out")
    p.add_argument("--estimator", default="rigid_fit", choices=("rigid_fit", "published", "truth"), help="of the pose")
    p.add_argument("--law", default="seed", choices=("seed", "plain", "published"), help="control law")
    p.add_argument("--out", type=Path, help="folder to write; default: results/TASK-TIME")
    p.add_argument("--images", action="store_true", help="record the cameras' images in the bag too (20 MB/s)")
    p.add_argument(
        "--camera-rate",
        type=number(0.0, "Hz"),
        default=0.0,
        help="[Hz] of the simulated cameras; default: the scenario's, "
        f"or {SMALL_CAMERA_RATE:g} where there are fewer than {CORES} cores",
    )
    p.add_argument("--verbose", action="store_true", help="show what the nodes say")
    p.add_argument(
        "robot",
        nargs="*",
        default=["robot:=sim"],
        metavar="NAME:=VALUE",
        help=f"robot:=ur [robot_ip:={STANDIN}]: the UR driver and ur_rtde in the loop, against the stand-in controller",
    )
    return p


def robot_arguments(words: list[str]) -> dict[str, str]:
    """robot and robot_ip as launch arguments. Raises SeedError for others, and for an address that is not loopback."""
    given = dict(w.partition(":=")[::2] for w in words)
    unknown = sorted(set(given) - {"robot", "robot_ip"})
    robot = given.get("robot", "ur")
    if unknown or robot not in ("sim", "ur"):
        raise SeedError(f"{' '.join(words)}: the demo takes robot:=sim or robot:=ur, and robot_ip:=127.x.y.z")
    address = given.get("robot_ip", STANDIN if robot == "ur" else "")
    if robot == "ur" and not address.startswith("127."):
        raise SeedError(f"robot_ip:={address}: the demo runs in simulation; a real arm goes with ./seed launch cell")
    return {"robot": robot, "robot_ip": address}


class Demo:
    """One run of the demo; `run` returns the exit code."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        self.robot = robot_arguments(options.robot)
        self.task: Task = load_task(options.task, options.force)
        self.scenario_name = str(options.scenario or SCENARIO_OF_TASK.get(self.task.name, self.task.name))
        self.scenario: Scenario = load_scenario(self.scenario_name)
        stamp = datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
        self.folder: Path = (options.out or results_folder() / f"{self.task.name}-{stamp}").resolve()
        if self.folder.is_dir() and any(self.folder.iterdir()):
            raise SeedError(f"{self.folder} is not empty; results are never overwritten: name another folder")
        self.folder.mkdir(parents=True, exist_ok=True)
        self.pictures: list[Picture] = []
        self.started = time.monotonic()
        self._log = (self.folder / "nodes.log").open("w", encoding="utf-8")
        self._failed_node = ""
        self._last_lines: dict[str, str] = {}  # of each node
        self.real_time_factor = 1.0

    # --- the live part -------------------------------------------------------------------------------------------
    def run(self) -> int:
        """Everything; files are complete on return."""
        options = self.options
        say(f"task {self.task.name}, scenario {self.scenario.name}, seed {options.seed}, estimator {options.estimator}")
        say(f"results go to {self.folder}")
        if _small() and not options.camera_rate:
            say(f"fewer than {CORES} cores: cameras at {SMALL_CAMERA_RATE:g} Hz, control at {SMALL_LOOP_RATE:g} Hz")
        phases = self._live()
        pool, futures = start_baselines(BASELINES, options.task, options.force, options.seed, self.scenario_name)
        try:
            series = read_series(self.folder / "bag.mcap", TOPICS)
            say("baselines: open loop and welded, on the same table")
            baselines = {law: future.result(timeout=120.0) for law, future in futures.items()}
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
        return self._conclude(series, phases, baselines)

    def _live(self) -> list[Phase]:
        """Run the cell and the task; when each phase began and ended."""
        with leaving_at_once("demo"):
            from seed_bringup.showing.session_node import Session  # rclpy only from here on

        launch = Launch(find_launch_file(["demo"]), self._arguments(), output=self._output)
        topics = RECORDED + (IMAGES if self.options.images else [])
        recording = Recording(self.folder / "bag.mcap", topics)
        with contextlib.ExitStack() as stack:
            say("starting simulation, cameras, estimator, controller and recorder")
            stack.enter_context(launch)
            stack.enter_context(recording)
            session = Session(lambda: self._watch(launch))
            stack.callback(session.close)
            self._prepare(session)
            heard = session.node.count_subscribers
            session.until(
                lambda: all(heard(topic) for topic in TOPICS.values() if topic.startswith("/sim")),
                40.0,
                "the recorder did not start",
            )
            self._play(session)
            with contextlib.suppress(SeedError):
                session.trigger("sim/save_replay")
            session.spin(0.3)
            say("closing the bag and the cell")
        played = session.played
        self.real_time_factor = round(played.real_time_factor, 3)
        if not played.result.success:
            raise FailedError(
                f"the task ended early: {played.result.message}; the bag and nodes.log are in {self.folder}"
            )
        ends = [start for _, start in played.phases[1:]] + [played.ended]
        return [Phase(name, start, end) for (name, start), end in zip(played.phases, ends, strict=True)]

    def _arguments(self) -> dict[str, str]:
        believed = self.folder / "beliefs.yaml"
        believed.write_text(yaml.safe_dump(beliefs(self.scenario)), encoding="utf-8")
        controller = self.folder / "controller.yaml"
        given = {k: v for k, v in self.scenario.controller.items() if k != "law"}
        values = {"rate": _loop_rate(), **given}
        controller.write_text(yaml.safe_dump({"controller": {"ros__parameters": values}}), encoding="utf-8")
        o = self.options
        return {
            **self.robot,
            "scenario": self.scenario_name,
            "task": str(o.task),
            "seed": str(o.seed),
            "method": o.estimator,
            "law": o.law,
            "replay": str(self.folder / "replay.html"),
            "hand_file": str(believed),
            "controller_file": str(controller),
            "sim_rate": str(_loop_rate()),
            "camera_rate": str(float(o.camera_rate or (SMALL_CAMERA_RATE if _small() else 0.0))),
        }

    def _prepare(self, session: Any) -> None:
        """What one does with a real gripper: picture the empty bubbles, close, picture the grasp."""
        images = self.options.estimator != "truth"
        if images:
            session.trigger("estimator/capture_reference", patience=40.0)
            say("reference taken of the empty bubbles")
        session.trigger("sim/grasp", patience=40.0)
        if images:
            session.spin(0.3)
            session.trigger("estimator/initialize_grasp")
        say("tool grasped")

    def _play(self, session: Any) -> None:
        camera = _Camera(session, self.pictures) if self.options.estimator != "truth" else None
        bar = _Bar()

        def tell(feedback: Any) -> None:
            bar.show(feedback, session.state)
            if camera is not None:
                camera.consider(feedback)

        session.enable("driver/resend_robot_program" if self.robot["robot"] == "ur" else "")
        overrides = "" if self.options.force is None else f"force: {self.options.force}"
        try:
            session.play(self._task_source(), overrides, tell, TASK_PATIENCE)
        finally:
            bar.close()
        for reason in session.holds:
            say(f"the arm held during the task: {reason}")

    def _task_source(self) -> str:
        file = Path(self.options.task)
        return str(file.resolve()) if file.is_file() else str(self.options.task)

    def _watch(self, launch: Launch) -> None:
        code = launch.poll()
        if code is not None:
            raise FailedError(
                f"{self._failed_node or 'the cell ended'}; all that it said is in {self.folder / 'nodes.log'}"
            )

    def _output(self, label: str, line: str) -> None:
        self._log.write(f"[{label}] {line}\n")
        self._log.flush()
        if label == "launch" and "died" in line:
            name = line.split(" ")[0]
            self._failed_node = f"{line.split(' (')[0]}: {self._last_lines.get(name, 'it said nothing')}"
        self._last_lines[label] = line
        if self.options.verbose:
            print(f"[{label}] {line}", flush=True)

    # --- what came of it -----------------------------------------------------------------------------------------
    def _conclude(self, series: dict[str, Series], phases: list[Phase], baselines: dict[str, Baseline]) -> int:
        recording = recording_of(series, self.task, self.scenario.tool.X_Ttip, phases)
        score = live_score(recording, self.task)
        gap = float(np.diff(recording["t"], prepend=0.0).max())
        if gap > GAP:
            say(f"the recording has a gap of {gap:.1f} s: the machine was too busy; the score may mislead")
        held = (
            score["samples"] > 0
            and score["force_z"]["rmse"] <= FORCE_BOUND
            and score["torque_x"]["rmse"] <= TORQUE_BOUND
        )
        score["finished"] = True
        score["real_time_factor"] = self.real_time_factor
        scores = {"seed": score, **{law: b.score for law, b in baselines.items()}}
        self._write_report(series, phases, baselines, recording, scores, held)
        o = self.options
        summary = {
            "task": self.task.name,
            "scenario": self.scenario.name,
            "seed": o.seed,
            "estimator": o.estimator,
            "law": o.law,
            "robot": self.robot["robot"],
            "held": held,
            "bounds": {"force_z_rmse": FORCE_BOUND, "torque_x_rmse": TORQUE_BOUND},
            **score,
            "baselines": {law: b.score for law, b in baselines.items()},
            "phases": [
                {"name": p.name, "start": p.start - phases[0].start, "end": p.end - phases[0].start} for p in phases
            ],
        }
        (self.folder / "summary.json").write_text(to_json(summary, indent=1), encoding="utf-8")
        print(f"\n{text_table(scores)}\n")
        bound = f"at most {FORCE_BOUND} N and {TORQUE_BOUND} N m rms"
        if self.real_time_factor < SLOW:
            say(f"the simulation ran at {self.real_time_factor:.2f} of real time: this machine was busy")
        say(f"force {'held' if held else 'NOT held'} ({bound}), {time.monotonic() - self.started:.0f} s in all")
        say(f"look at {self.folder / 'report.html'}")
        return 0 if held else 1

    def _write_report(
        self,
        series: dict[str, Series],
        phases: list[Phase],
        baselines: dict[str, Baseline],
        recording: Any,
        scores: dict[str, Any],
        held: bool,
    ) -> None:
        start = phases[0].start
        local = [Phase(p.name, p.start - start, p.end - start) for p in phases]
        t = recording["t"]
        runs = {"SEED": (t, -recording["force"][:, 2], recording["torque_T"][:, 0])}
        contact = recording.contact_time or 0.0
        for law, b in baselines.items():
            shift = contact - (b.score["contact"]["time"] or contact)  # drawn from first contact on
            runs[law.replace("_", " ")] = (b.t + shift, b.force, b.torque)
        scored = scored_phase(self.task)
        wiped = [p for p in local if p.name == scored or p.name.endswith(f" {scored}")] or local[-2:-1] or local
        band = (min(max(wiped[0].start, contact + SETTLING), wiped[-1].end), wiped[-1].end)
        wanted = max((abs(float(f)) for f in recording["wanted_force"][:, 2]), default=0.0)
        shifted = {k: Series(series[k].t - start, series[k].values) for k in ("relative_pose", "true_relative")}
        span = (0.0, local[-1].end)
        o = self.options
        report = Report(
            title=f"{self.task.name.replace('_', ' ').capitalize()} at {wanted:g} N",
            subtitle="A grasped tool, pressed and moved by a position-controlled arm: force from tactile images alone, "
            "through the live ROS graph."
            if o.estimator != "truth"
            else "The live ROS graph, with the true relative pose in place of images.",
            held=held,
            scores=scores,
            force_figure=force_and_torque(runs, wanted, band, local),
            pose_figure=relative_pose(
                shifted["relative_pose"].between(*span), shifted["true_relative"].between(*span), local
            ),
            pictures=self.pictures,
            details=self._details(local, scores["seed"]),
            source="the true pose" if o.estimator == "truth" else f"tactile images ({o.estimator})",
            replay="replay.html" if (self.folder / "replay.html").is_file() else "",
        )
        (self.folder / "report.html").write_text(report.html(), encoding="utf-8")

    def _details(self, phases: list[Phase], score: dict[str, Any]) -> dict[str, str]:
        o, contact = self.options, score["contact"]["time"]
        rpy = rpy_from_rotation(self.task.frame.pose[:3, :3])
        return {
            "command": f"./seed demo --task {o.task} --seed {o.seed} --estimator {o.estimator}"
            + (f" --force {o.force:g}" if o.force is not None else "")
            + (f" --scenario {o.scenario}" if o.scenario is not None else "")
            + (f" --law {o.law}" if o.law != "seed" else "")
            + (f" --camera-rate {o.camera_rate:g}" if o.camera_rate else "")
            + (f" robot:=ur robot_ip:={self.robot['robot_ip']}" if self.robot["robot"] == "ur" else ""),
            "scenario": f"{self.scenario.name}: {self.scenario.description}".rstrip(": "),
            "first contact": "never" if contact is None else f"{contact:.2f} s after the start",
            "phases": ", ".join(f"{p.name} {p.end - p.start:.1f} s" for p in phases),
            "real-time factor": f"{self.real_time_factor:.3f}",
            "work frame": f"{self.task.frame.position} m, {tuple(round(math.degrees(a), 1) for a in rpy)} degrees",
            "data": "bag.mcap (rosbags, ros2 bag, Foxglove), summary.json",
        }


class _Camera:
    """Takes the estimator's debug image at the moments that tell something."""

    def __init__(self, session: Any, pictures: list[Picture]) -> None:
        self._session, self._pictures = session, pictures
        self._taken: set[str] = set()

    def consider(self, feedback: Any) -> None:
        """After each feedback: is this a moment?"""
        phase = feedback.phase
        moment = f"{phase}, just begun" if phase not in {m.split(",")[0] for m in self._taken} else ""
        if moment and len(self._taken) < 6:
            self._taken.add(moment)
            caption = {"approach": "before contact: only the tool's weight turns and pulls"}.get(phase, phase)
            self._session.picture(
                "estimator/debug_image", lambda png: self._pictures.append(Picture(png, caption)), delay=0.8
            )


class _Bar:
    """Phase, progress and force on one line of the terminal."""

    def __init__(self) -> None:
        self._live = sys.stdout.isatty()
        self._phase = ""

    def show(self, feedback: Any, state: Any) -> None:
        """One feedback."""
        force = 0.0 if state is None else -state.estimated.force.z
        text = f"{feedback.phase:<12} {100 * feedback.progress:3.0f} %   estimated force {force:6.2f} N"
        if self._live:
            width = 24
            done = round(width * feedback.progress)
            print(f"\r  [{'#' * done}{'.' * (width - done)}] {text}  ", end="", flush=True)
        elif feedback.phase != self._phase:
            print(f"  {text}", flush=True)
        self._phase = feedback.phase

    def close(self) -> None:
        if self._live:
            print(flush=True)


def beliefs(scenario: Scenario) -> dict[str, Any]:
    """What the controller and the estimator believe about hand, tool and grasp, as ROS parameters for all nodes."""
    stiffness = scenario.grasp.believed or scenario.grasp.stiffness
    values = {"hand": scenario.hand, "tool": scenario.tool, "grasp": stiffness}
    return {"/**": {"ros__parameters": {k: to_mapping(v) for k, v in values.items()}}}


def say(text: str) -> None:
    """One line of progress."""
    print(f"seed demo: {text}", flush=True)


def _interrupt(number: int, frame: FrameType | None) -> None:
    del number, frame
    raise KeyboardInterrupt


@command("seed demo")
def main(argv: list[str]) -> int:
    """Command line; the exit code is 0 only if the force was held."""
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, _interrupt)
    return Demo(_parser().parse_args(argv)).run()

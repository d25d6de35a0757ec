# SPDX-License-Identifier: Apache-2.0
"""The live part of the demo: the cell runs, the task is played, and all of it is recorded."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from seed_bringup.bags.recording import Recording
from seed_bringup.demo.figures import Phase
from seed_bringup.demo.live_score import TOPICS
from seed_bringup.demo.plan import Plan
from seed_bringup.demo.report import Picture
from seed_bringup.demo.terminal import Bar, say
from seed_bringup.launching.launcher import Launch
from seed_bringup.launching.packages import find_launch_file
from seed_core.command_line import leaving_at_once
from seed_core.config import to_mapping
from seed_core.errors import FailedError, SeedError
from seed_sim.scenario import Scenario

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


class Played(NamedTuple):
    """What is left of a run beside the bag: when each phase began and ended [s], and debug images of its moments."""

    phases: list[Phase]
    pictures: list[Picture]
    real_time_factor: float


def play_live(asked: Plan) -> Played:
    """Run the cell and play the task; files in the plan's folder are complete on return.

    Raises:
        FailedError: a node died or did not answer, or the task ended early.
    """
    if _small() and not asked.options.camera_rate:
        say(f"fewer than {CORES} cores: cameras at {SMALL_CAMERA_RATE:g} Hz, control at {SMALL_LOOP_RATE:g} Hz")
    return _Run(asked).play()


class _Run:
    def __init__(self, asked: Plan) -> None:
        self.asked, self.options, self.folder = asked, asked.options, asked.folder
        self.pictures: list[Picture] = []
        self._log = (self.folder / "nodes.log").open("w", encoding="utf-8")
        self._failed_node = ""
        self._last_lines: dict[str, str] = {}  # of each node

    def play(self) -> Played:
        """Everything, from the start of the cell to its end."""
        with leaving_at_once("demo"):
            from seed_bringup.ros.session import Session  # rclpy only from here on

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
            self._task(session)
            with contextlib.suppress(SeedError):
                session.trigger("sim/save_replay")
            session.spin(0.3)
            say("closing the bag and the cell")
        task = session.played
        if not task.result.success:
            raise FailedError(
                f"the task ended early: {task.result.message}; the bag and nodes.log are in {self.folder}"
            )
        ends = [start for _, start in task.phases[1:]] + [task.ended]
        phases = [Phase(name, start, end) for (name, start), end in zip(task.phases, ends, strict=True)]
        return Played(phases, self.pictures, round(task.real_time_factor, 3))

    def _arguments(self) -> dict[str, str]:
        believed = self.folder / "beliefs.yaml"
        believed.write_text(yaml.safe_dump(beliefs(self.asked.scenario)), encoding="utf-8")
        controller = self.folder / "controller.yaml"
        given = {k: v for k, v in self.asked.scenario.controller.items() if k != "law"}
        values = {"rate": _loop_rate(), **given}
        controller.write_text(yaml.safe_dump({"controller": {"ros__parameters": values}}), encoding="utf-8")
        o = self.options
        return {
            **self.asked.robot,
            "scenario": self.asked.scenario_name,
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

    def _task(self, session: Any) -> None:
        camera = _Camera(session, self.pictures) if self.options.estimator != "truth" else None
        bar = Bar()

        def tell(feedback: Any) -> None:
            bar.show(feedback.phase, feedback.progress, session.pressing_force)
            if camera is not None:
                camera.consider(feedback)

        session.enable("driver/resend_robot_program" if self.asked.robot["robot"] == "ur" else "")
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


def beliefs(scenario: Scenario) -> dict[str, Any]:
    """What the controller and the estimator believe about hand, tool and grasp, as ROS parameters for all nodes."""
    stiffness = scenario.grasp.believed or scenario.grasp.stiffness
    values = {"hand": scenario.hand, "tool": scenario.tool, "grasp": stiffness}
    return {"/**": {"ros__parameters": {k: to_mapping(v) for k, v in values.items()}}}

# SPDX-License-Identifier: Apache-2.0
"""The live part of the demo: the cell runs, the task is played, and all of it is recorded."""

import argparse
import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from seed_bringup.bags.recording import recording
from seed_bringup.demo.plan import Plan
from seed_bringup.demo.report import Picture
from seed_bringup.demo.score import TOPICS, Phase
from seed_bringup.demo.terminal import Bar, say
from seed_bringup.launching.launcher import Launch
from seed_bringup.launching.packages import find_launch_file
from seed_control.tasks.steps import steps_of
from seed_control.tasks.task import Task
from seed_core.errors import FailedError, SeedError
from seed_core.hand import FINGERS
from seed_core.program.command_line import leaving_at_once
from seed_sim.hand_file import hand_file_of
from seed_sim.scenario import Scenario

TASK_PATIENCE = 60.0  # [s] of the machine's clock without progress, beside what a phase waits for its condition
SLOWEST = 0.2  # real-time factor of a very busy machine
RECORDED = [
    *TOPICS.values(),
    "/contact_patches",
    "/ft_sensor/wrench",
    "/joint_states",
    "/gripper/width",
    "/bubble_left/pressure",
    "/bubble_right/pressure",
    "/sim/real_time_factor",
    "/sim/ground_truth/table_pose",
    "/sim/ground_truth/table",
    "/tf",
    "/tf_static",
    "/diagnostics",
]
IMAGES = ["/current_pose", "/target_frame"] + [  # with the fast streams, what a playback needs
    f"/bubble_{f}/{t}" for f in FINGERS for t in ("depth/image_rect_raw", "ir/image_rect_raw", "depth/camera_info")
]
CORES = 4  # that the live graph wants at full rates
SMALL_CAMERA_RATE = 22.5  # [Hz] with fewer: every other picture
LOOP_RATE, SMALL_LOOP_RATE = 250.0, 125.0  # [Hz] of arm and controller, with enough cores and with fewer
OPERATOR_TIMEOUT = 3.0  # [s]; everything here shares one computer, and the cell ends with this program anyway
CLOSING = 15.0  # [s] that a lift after Ctrl-C and the end of every process take at most, as a rule
MOST_PICTURES, PICTURE_DELAY = 6, 0.8  # pictures of a run; [s] after the phase began


def live_rates() -> tuple[float, float]:
    """Rates of cameras (0: the scenario's) and of control that the live graph keeps on this machine [Hz]."""
    small = len(os.sched_getaffinity(0)) < CORES
    return (SMALL_CAMERA_RATE, SMALL_LOOP_RATE) if small else (0.0, LOOP_RATE)


def camera_rate_of(options: argparse.Namespace) -> float:
    """Rate of the live cameras [Hz]: as asked for, or what this machine keeps; 0: the scenario's."""
    return float(options.camera_rate or live_rates()[0])


def patience_with(task: Task) -> float:
    """How long a task may make no progress [s]: a phase waits as long for its condition, in simulated time."""
    return TASK_PATIENCE + max(step.phase.timeout + step.phase.dwell for step in steps_of(task)) / SLOWEST


class LiveRun(NamedTuple):
    """What is left of a run beside the bag: its phases in ROS time [s], and debug images of its moments.

    early: why the task ended before its end, after it had touched something; '' if it did not.
    """

    phases: list[Phase]
    pictures: list[Picture]
    real_time_factor: float
    early: str = ""


def play_live(asked: Plan, believed: Scenario, check: Callable[[], None]) -> LiveRun:
    """Run the cell and play the task; files in the plan's folder are complete on return.

    Args:
        asked: the plan.
        believed: the plan's scenario as controller and estimator are told of it.
        check: called often; may raise to end everything.

    Raises:
        FailedError: a node died or did not answer, or the task ended before it touched anything.
    """
    camera_rate, loop_rate = live_rates()
    if camera_rate and not asked.options.camera_rate:
        say(f"fewer than {CORES} cores: cameras at {camera_rate:g} Hz, control at {loop_rate:g} Hz")
    with leaving_at_once("demo"):
        from seed_bringup.ros.session import Session  # rclpy only from here on

    log = _NodeLog(asked.folder / "nodes.log", asked.options.verbose)
    launch = Launch(find_launch_file(["demo"]), _launch_arguments(asked, believed), output=log.add)

    def watch() -> None:
        check()
        if launch.poll() is not None:
            raise FailedError(f"{log.death or 'the cell ended'}; all that it said is in {log.path}")

    with contextlib.ExitStack() as stack:
        say("starting simulation, cameras, estimator, controller and recorder")
        stack.enter_context(launch)
        stack.enter_context(recording(asked.folder / "bag.mcap", RECORDED + (IMAGES if asked.options.images else [])))
        session = Session(watch)
        stack.callback(session.close)
        stack.push(_tell_of_closing)
        _prepare(session, asked.options.estimator != "truth")
        heard = session.node.count_subscribers
        session.until(
            lambda: all(heard(topic) for topic in TOPICS.values() if topic.startswith("/sim")),
            40.0,
            "the recorder did not start",
        )
        pictures = _play_task(session, asked)
        with contextlib.suppress(SeedError):
            session.trigger("sim/save_replay")
        session.spin(0.3)
        say("closing the bag and the cell")
    played = session.played
    early = "" if played.result.success else f"the task ended early: {played.result.message}"
    if early and (played.contact is None or not played.phases):
        raise FailedError(f"{early}; the bag and nodes.log are in {asked.folder}")
    ends = [start for _, start in played.phases[1:]] + [played.ended]
    phases = [Phase(name, start, end) for (name, start), end in zip(played.phases, ends, strict=True)]
    return LiveRun(phases, pictures, round(played.real_time_factor, 3), early)


def _tell_of_closing(kind: type[BaseException] | None, *_: object) -> None:
    """The end of every process takes seconds: an interrupt is answered before that."""
    if kind is KeyboardInterrupt:
        say("closing the bag and the cell")


def _launch_arguments(asked: Plan, believed: Scenario) -> dict[str, str]:
    """Of demo_launch.xml; writes the parameter files that they name."""
    loop_rate = live_rates()[1]
    o, hand, controller = asked.options, asked.folder / "beliefs.yaml", asked.folder / "controller.yaml"
    settings = {
        "rate": loop_rate,
        "operator_timeout": OPERATOR_TIMEOUT,
        **{k: v for k, v in asked.scenario.controller.items() if k != "law"},
    }
    if believed.wrench.file:
        settings["wrench"] = {"model": believed.wrench.model, "file": believed.wrench.file}
    hand.write_text(hand_file_of(believed), encoding="utf-8")
    controller.write_text(yaml.safe_dump({"controller": {"ros__parameters": settings}}), encoding="utf-8")
    return {
        **asked.robot,
        "hand_file": str(hand),
        "controller_file": str(controller),
        "scenario": asked.scenario_name,
        "task": str(o.task),
        "seed": str(o.seed),
        "method": o.estimator,
        "law": o.law,
        "view": str(not o.no_view).lower(),
        "replay": str(asked.folder / "replay.html"),
        "sim_rate": str(loop_rate),
        "camera_rate": str(camera_rate_of(o)),
    }


def _prepare(session: Any, images: bool) -> None:
    """What one does with a real gripper: picture the empty bubbles, close, picture the grasp."""
    if images:
        session.trigger("estimator/capture_reference", patience=40.0)
        say("reference taken of the empty bubbles")
    session.trigger("sim/grasp", patience=40.0)
    if images:
        session.spin(0.3)
        session.trigger("estimator/initialize_grasp")
    say("tool grasped")


def _play_task(session: Any, asked: Plan) -> list[Picture]:
    """Play the task to its end; the estimator's debug image of each phase."""
    pictures: list[Picture] = []
    pictured: set[str] = set()
    bar = Bar()

    def tell(feedback: Any) -> None:
        phase = feedback.phase
        bar.show(phase, feedback.progress, session.pressing_force)
        if asked.options.estimator != "truth" and phase not in pictured and len(pictured) < MOST_PICTURES:
            pictured.add(phase)
            caption = {"approach": "before contact: only the tool's weight turns and pulls"}.get(phase, phase)
            session.picture(
                "estimator/debug_image", lambda png: pictures.append(Picture(png, caption)), delay=PICTURE_DELAY
            )

    def cancelling() -> None:
        bar.close()
        say(f"lifting the tool, then closing: some {CLOSING:g} s, more on a busy computer")

    session.cancelling = cancelling
    session.enable("driver/resend_robot_program" if asked.robot["robot"] == "ur" else "")
    try:
        session.play(str(asked.options.task), asked.options.force, tell, patience_with(asked.task))
    finally:
        bar.close()
    for reason in session.holds:
        say(f"the arm held during the task: {reason}")
    return pictures


class _NodeLog:
    """Keeps what the nodes say in a file, and the last words of the one whose death ended the run."""

    def __init__(self, path: Path, verbose: bool) -> None:
        self.path, self.death = path, ""
        self._verbose = verbose
        self._file = path.open("w", encoding="utf-8")
        self._last_lines: dict[str, str] = {}  # of each node

    def add(self, label: str, line: str) -> None:
        """One line of a node, or of the launcher."""
        print(f"[{label}] {line}", file=self._file, flush=True)
        if label == "launch" and "died" in line:
            name = line.split(" ")[0]
            self.death = f"{line.split(' (')[0]}: {self._last_lines.get(name, 'it said nothing')}"
        if label == "page" and "http://" in line and not self._verbose:
            say(line)
        self._last_lines[label] = line
        if self._verbose:
            print(f"[{label}] {line}", flush=True)

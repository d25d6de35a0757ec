# SPDX-License-Identifier: Apache-2.0
"""A live cell whose nodes are killed, stopped and started anew; what arm, force and words do then."""

from __future__ import annotations

import os
import signal
import tempfile
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.action import ActionClient
from rclpy.qos import qos_profile_sensor_data
from seed_msgs.action import FollowSetpoints
from seed_msgs.msg import ControllerState
from std_msgs.msg import String

from seed_bringup.demo.live import live_rates
from seed_bringup.ros.session import SessionError
from seed_ros.conversions import seconds
from seed_ros.qos import LATCHED
from seed_testing.live.ros.cell import STARTS_WITHIN, Cell
from seed_testing.live.verdict import MOVES, motion, moved_on

STANDIN = "127.0.0.56"  # address of the stand-in for a UR
TASK, WANTED = "squeegee", 10.0  # [N] that it presses with
INTO_PHASE = 0.6  # [s] after a phase began, at which the fault comes
AGAIN_AFTER = 1.0  # [s] from a node's end to its next start
WATCHED = 1.5  # [s] after a fault
BACK_WITHIN = 30.0  # [s] for a node to speak again on a busy machine
SETTLES = 0.5  # [s] in which nothing may begin to move once it is back
BEFORE = 0.2  # [s] before the fault, whose force is told beside that after it
SIGNALS = {"kill": signal.SIGKILL, "restart": signal.SIGINT}
SLOW = "slower than real time"  # is no cause
STOPS = {"stop 0.5 s": 0.5, "stop 5 s": 5.0}
ARM = {"sim": "sim", "ur": "driver"}


class FaultCell(Cell):
    """One life of a cell. `spoiled`: it could not be brought back, start another one."""

    def __init__(self, robot: str, method: str, log: Path) -> None:
        camera_rate, loop_rate = live_rates()
        self._controller = tempfile.NamedTemporaryFile("w", suffix=".yaml")  # noqa: SIM115
        yaml.safe_dump({"controller": {"ros__parameters": {"rate": loop_rate}}}, self._controller)
        self._controller.flush()
        arguments = {"robot": robot, "method": method, "links": "false", "controller_file": self._controller.name}
        arguments |= {"sim_rate": str(loop_rate), "camera_rate": str(camera_rate)}
        if robot == "ur":
            arguments |= {"robot_ip": STANDIN}
        super().__init__(arguments, log, launch_file="cell")
        nodes = self.launch.description.nodes
        self.launch.description.nodes = [
            replace(n, shutdown_on_exit=False, respawn=True, respawn_delay=AGAIN_AFTER) for n in nodes
        ]
        self.robot, self.spoiled, self.state = robot, False, ControllerState()
        self._state_at = -1.0
        self._track: dict[str, list[tuple[float, np.ndarray]]] = {"flange": [], "tip": []}
        self._force: list[tuple[float, float]] = []
        self._held: list[tuple[float, str]] = []
        self.phase = ""

    def open(self) -> FaultCell:
        """Start it and bring it to the reference."""
        self.__enter__()
        node, qos = self.session.node, qos_profile_sensor_data
        node.create_subscription(PoseStamped, "current_pose", lambda m: self._on_pose("flange", m), qos)
        node.create_subscription(PoseStamped, "sim/ground_truth/tip_pose", lambda m: self._on_pose("tip", m), qos)
        node.create_subscription(WrenchStamped, "sim/ground_truth/contact_wrench", self._on_wrench, qos)
        node.create_subscription(ControllerState, "controller/state", self._on_state, qos)
        node.create_subscription(String, f"{ARM[self.robot]}/hold_reason", self._on_hold, LATCHED)
        return self

    def close(self) -> None:
        """End it."""
        self.__exit__()
        self._controller.close()

    def _on_pose(self, what: str, message: PoseStamped) -> None:
        p = message.pose.position
        self._track[what].append((seconds(message.header.stamp), np.array((p.x, p.y, p.z))))

    def _on_wrench(self, message: WrenchStamped) -> None:
        f = message.wrench.force
        self._force.append((seconds(message.header.stamp), float(np.linalg.norm((f.x, f.y, f.z)))))

    def _on_state(self, message: ControllerState) -> None:
        self.state, self._state_at = message, time.monotonic()

    def _on_hold(self, message: String) -> None:
        self._held.append((time.monotonic(), message.data))

    # a case
    def run(self, node: str, fault: str, phase: str) -> dict[str, Any]:
        """Bring the cell to a phase, let a node fail, watch, and bring the cell back.

        Raises:
            SessionError: the phase was not reached.
        """
        for track in self._track.values():
            track.clear()
        self._force.clear()
        goal = self._reach(phase)
        pid = self.pids().get(node)
        if pid is None:
            raise SessionError(f"there is no process of {node}")
        self._held.clear()
        self.said.clear()
        began, fault_at = time.monotonic(), time.time()
        self._strike(pid, fault)
        self.session.spin(WATCHED)
        until = time.time()
        row = self._row(node, fault, phase, began, fault_at, until)
        back = time.monotonic() - 0.1
        with suppress(SessionError):
            self.session.until(lambda: self._state_at > back and self._again(node), BACK_WITHIN, "it is not back")
        self.session.spin(SETTLES)
        row["resumed_unasked"] = self._resumed(phase, fault, node, until)
        goal.destroy()
        row["needed"], row["recovered"] = self._bring_back(phase)
        return row

    def _reach(self, phase: str) -> ActionClient:
        """The phase of a fault, healthy; a client of the task's action."""
        client = ActionClient(self.session.node, FollowSetpoints, "controller/follow_setpoints")
        try:
            self._lead(client, phase)
        except BaseException:
            client.destroy()
            raise
        return client

    def _lead(self, client: ActionClient, phase: str) -> None:
        """To the phase; raises SessionError where it is not reached."""
        self.phase = ""
        if self.images:
            self._take_reference()
        else:
            self.session.until(lambda: bool(self._track["flange"]), STARTS_WITHIN, "no current_pose")
        if phase == "reference":
            return
        self.session.trigger("sim/grasp", patience=STARTS_WITHIN)
        self.session.spin(0.4)
        self.initialize()
        if phase == "grasped":
            return
        self.enable()
        self.session.spin(0.4)
        if phase == "enabled":
            return
        self.session.until(client.server_is_ready, STARTS_WITHIN, "no action controller/follow_setpoints")
        sent = client.send_goal_async(FollowSetpoints.Goal(task=TASK), feedback_callback=self._on_feedback)
        self.session.until(sent.done, 10.0, "follow_setpoints did not answer")
        ended = sent.result().get_result_async()
        self.session.until(lambda: self.phase == phase or ended.done(), 60.0, f"phase {phase} was not reached")
        self.session.spin(INTO_PHASE)
        if ended.done():
            raise SessionError(f"the task ended before the fault: {ended.result().result.message}")
        if self.state.mode == "holding":
            raise SessionError(f"it held before the fault: {self.state.reason}")

    def _take_reference(self) -> None:
        """A cell that has just been started needs its time."""
        deadline = time.monotonic() + STARTS_WITHIN
        while True:
            try:
                self.session.trigger("estimator/capture_reference", patience=STARTS_WITHIN)
                return
            except SessionError:
                if time.monotonic() > deadline:
                    raise

    def _on_feedback(self, message: Any) -> None:
        self.phase = message.feedback.phase

    def _strike(self, pid: int, fault: str) -> None:
        """End or stop a process."""
        if fault in SIGNALS:
            os.kill(pid, SIGNALS[fault])
            return
        os.kill(pid, signal.SIGSTOP)
        try:
            self.session.spin(STOPS[fault])
        finally:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)

    def _row(self, node: str, fault: str, phase: str, began: float, fault_at: float, until: float) -> dict[str, Any]:
        itself = node == "sim" and self.robot == "sim"  # the arm is a part of it, and stops with it
        streams = ("tip",) if node.startswith(("driver", "ur_controller")) else ("flange",)
        track = self._track[streams[0]]
        seen = motion([t for t, _ in track], [p for _, p in track], fault_at, until)
        if itself and fault in SIGNALS:
            seen = seen._replace(held_after=float("nan"), travel=float("nan"), speed=float("nan"))
        forces = [f for t, f in self._force if fault_at <= t <= until]
        words = "; ".join(dict.fromkeys(r for t, r in self._held if t > began and r))
        fresh = self._state_at > time.monotonic() - 1.0
        state = self.state.reason if fresh and (self.state.mode == "holding" or not self.state.enabled) else ""
        told = [f"{n}: {m}" for n, (level, m, _) in self.said.items() if level > 0 and not m.startswith(SLOW)]
        moves = phase in MOVES
        return {
            "reached": True,
            "robot": self.robot,
            "node": node,
            "fault": fault,
            "phase": phase,
            "held_after_s": _number(seen.held_after),
            "travel_mm": _number(1e3 * seen.travel),
            "late_travel_mm": _number(1e3 * seen.late_travel) or 0.0,
            "blind_s": round(seen.blind, 3),
            "speed_mm_s": _number(1e3 * seen.speed),
            "force_n": _largest(forces),
            "force_before_n": _largest(f for t, f in self._force if fault_at - BEFORE <= t < fault_at),
            "force_at_s": round(self._force_at(fault_at, until), 2) if forces else None,
            "wanted_n": WANTED if moves else 0.0,
            "state": "; ".join(filter(None, (state, f"arm: {words}" if words else ""))),
            "diagnostics": "; ".join(told),
            "needs_cause": moves and (held := _number(seen.held_after)) is not None and held < 2.0,
        }

    def _force_at(self, fault_at: float, until: float) -> float:
        """When the largest force was [s], from the fault on."""
        return max((f, t - fault_at) for t, f in self._force if fault_at <= t <= until)[1]

    def _again(self, node: str) -> bool:
        """Whether a node that was ended runs, and speaks."""
        speaks = node.split("/")[0]
        return node in self.pids() and (speaks == "ur_controller" or speaks in self.said)  # that one is no ROS node

    def _resumed(self, phase: str, fault: str, node: str, since: float) -> str:
        """Whether it moved since then [s], or is ready to, without having been asked, in words."""
        goes_on = self.state.mode in ("position", "approach", "contact")
        if phase in MOVES and fault == "stop 0.5 s" and not self._held and self.state.mode != "holding":
            return ""  # too short for a hold
        if phase in MOVES and goes_on:
            return f"{self.state.mode} goes on without a request"
        if node == "controller" and fault in SIGNALS and self.state.enabled:
            return "enabled after a new start"
        return moved_on([t for t, _ in self._track["flange"]], [p for _, p in self._track["flange"]], since)

    def _bring_back(self, phase: str) -> tuple[str, bool | None]:
        """What `enable` says before anything else was done, and whether the cell works again; None: not tried."""
        said = ""
        try:
            try:
                said = self.session.switch("controller/enable", True)
            except SessionError as error:
                said = str(error)
            with suppress(SessionError):
                self.session.switch("controller/enable", False)
            if self.robot == "ur" and phase in MOVES:
                self.spoiled = True  # the arm is near the table, and nothing here moves it away
                return said, None
            self.recover_to_reference()
        except SessionError as error:
            self.spoiled = True
            return f"{said}; {error}", False
        return said, True

    def recover_to_reference(self) -> None:
        """The tool in its holder, bubbles free, arm at its start where it can be put there."""
        if self.robot == "sim":
            self.session.trigger("sim/reset", patience=STARTS_WITHIN)
        else:
            self.session.trigger("sim/release", patience=STARTS_WITHIN)
        self.session.spin(0.8)


def _largest(forces: Iterable[float]) -> float | None:
    found = [round(f, 2) for f in forces]
    return max(found) if found else None


def _number(value: float) -> float | None:
    return round(float(value), 3) if np.isfinite(value) else None

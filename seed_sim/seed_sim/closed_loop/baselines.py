# SPDX-License-Identifier: Apache-2.0
"""What SEED is compared with: a taught path that barely touches; a tool bolted to the gripper with force control."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState, Counters
from seed_control.tasks import Task, TaskPlayer
from seed_core.spatial import Array, inverse_pose, so3_exp
from seed_sim.closed_loop.recording import Recording, torque_axes_of
from seed_sim.closed_loop.run import MAX_DURATION, Run, _record, start_pose
from seed_sim.plant.plant import Plant
from seed_sim.scenario import Scenario

DT = 0.004  # [s] of a control step
_TOUCH = -1e-4  # [m] depth of the taught path: the arm's repeatability
_APPROACH = 0.03  # [m/s]
_ADMITTANCE = 1.5e-3  # [m/s per N] of the welded tool along z
_ROLL_ADMITTANCE = 0.3  # [rad/s per N m] of the welded tool about x, with roll control


def run_baseline(scenario: Scenario, task: Task, *, kind: str, seed: int = 0, meshcat: Any = None) -> Run:
    """Play the task with 'open_loop', 'welded' or 'welded_roll'."""
    began = time.perf_counter()
    welded = kind != "open_loop"
    plant = Plant(scenario, seed, task.frame.pose, start_pose(scenario, task), welded=welded, meshcat=meshcat)
    player = TaskPlayer(task)
    recording = Recording(player.phases, torque_axes=torque_axes_of(task))
    arm = _Admittance(plant, task, kind)
    for step in range(round(MAX_DURATION / DT)):
        t = step * DT
        plant.advance(t)
        status = player.step(t, arm.state(t))
        if status.setpoint is not None:
            plant.command(arm.target(status.setpoint))
            index = recording.phases.index(status.phase) if status.phase in recording.phases else -1
            _record(recording, plant, task, status.setpoint, t, index)
        if status.done:
            recording.finished = not (status.failed or status.cancelled)
            recording.message = status.message
            break
    recording.wall_time = time.perf_counter() - began
    return Run(recording, plant, None)


class _Admittance:
    """Follows the reference; along z it obeys an ideal force sensor (welded), or stays at the taught height."""

    def __init__(self, plant: Plant, task: Task, kind: str) -> None:
        self.plant, self.kind = plant, kind
        self.X_work = task.frame.pose
        self._z: float | None = None
        self._roll = 0.0
        self._settled = 0

    def state(self, t: float) -> ControllerState:
        """What the task's player wants to know of a controller."""
        return ControllerState(
            t,
            "contact",
            True,
            "hybrid",
            None,
            None,
            None,
            None,
            None,
            self._tip(),
            np.eye(3),
            (),
            "",
            True,
            self._settled > 50,
            0.0,
            Counters(),
        )

    def _tip(self) -> Array:
        return np.asarray(self.plant.X_WT @ self.plant.tool.X_Ttip)

    def target(self, s: HybridSetpoint) -> Array:
        """Flange pose (4, 4) for this set-point."""
        X = s.X_W_tip.copy()
        normal = self.X_work[:3, 2]
        if s.force_projector.any():
            height = self._force_height(s) if self.kind != "open_loop" else self._taught_height()
            X[:3, 3] += normal * (height - normal @ (X[:3, 3] - self.X_work[:3, 3]))
        else:
            self._z = None
        tool = X @ inverse_pose(self.plant.tool.X_Ttip)
        if self.kind == "welded_roll":
            tip = X[:3, 3]
            turn = so3_exp(self._roll * tool[:3, 0])
            tool[:3, :3] = turn @ tool[:3, :3]
            tool[:3, 3] = tip + turn @ (tool[:3, 3] - tip)
        X_WC = tool @ inverse_pose(self._sag(tool[:3, :3]))
        return np.asarray(X_WC @ inverse_pose(self.plant.hand.X_EC))

    def _sag(self, R_WT: Array) -> Array:
        """X_CT (4, 4) of the tool that hangs free: the taught path was taught with the tool in the grasp."""
        X = np.eye(4)
        if self.kind == "open_loop":
            weight = R_WT.T @ np.array((0.0, 0.0, -9.81 * self.plant.tool.mass))
            X[:3, 3] = weight / np.array(self.plant.scenario.grasp.stiffness.translation)
        return X

    def _taught_height(self) -> float:
        """Down to the nominal table at the approach speed."""
        self._z = max((self._z if self._z is not None else self._height()) - _APPROACH * DT, _TOUCH)
        self._settled = self._settled + 1 if self._z <= _TOUCH else 0
        return self._z

    def _height(self) -> float:
        return float(self.X_work[:3, 2] @ (self._tip()[:3, 3] - self.X_work[:3, 3]))

    def _force_height(self, s: HybridSetpoint) -> float:
        if self._z is None:
            self._z = self._height()
        load = self.plant.contact_wrench
        normal = self.X_work[:3, 2]
        pressed, wanted = -float(normal @ load.force), -float(normal @ s.R_W_task @ s.wrench.force)
        speed = _ADMITTANCE * (pressed - wanted)
        self._z += DT * float(np.clip(speed, -_APPROACH, _APPROACH))
        if self.kind == "welded_roll":
            torque = float(self.plant.X_WT[:3, 0] @ load.torque)
            self._roll -= DT * float(np.clip(_ROLL_ADMITTANCE * torque, -0.3, 0.3))
        self._settled = self._settled + 1 if abs(pressed - wanted) < 0.1 * wanted else 0
        return self._z

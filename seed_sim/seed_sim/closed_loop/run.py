# SPDX-License-Identifier: Apache-2.0
"""One task against the plant, step by step, and SEED's controller in that loop. Deterministic: it reads no clock."""

import math
from bisect import bisect_right
from collections import deque
from typing import Protocol

import numpy as np

from seed_control.controller import Controller
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint, SetpointError
from seed_control.state import ControllerState
from seed_control.tasks import Task, TaskPlayer
from seed_control.wrench.choose_model import choose_model
from seed_core.config import from_mapping, to_mapping
from seed_core.spatial import Array, inverse_pose, make_pose, rotation_from_rpy
from seed_core.wrench_model import WrenchModel
from seed_sim.closed_loop.arm_sensor import ArmSensor, stated
from seed_sim.closed_loop.progress import Progress
from seed_sim.closed_loop.recording import Recording, lean_of, torque_axes_of
from seed_sim.closed_loop.relative_poses import Poses, pose_source
from seed_sim.membrane import MembraneError
from seed_sim.plant.plant import Plant
from seed_sim.plant.tool_holder import LETTING_DOWN
from seed_sim.scenario import Scenario

START_HEIGHT = 0.03  # [m] of the tip above the nominal table
MAX_DURATION = 120.0  # [s] of any run
SETTLE = 0.6  # [s] of hanging still before the controller is enabled
_REMEMBERED = 1.0  # [s] of loads, for images that arrive late


class Steering(Protocol):
    """What moves the arm in a run: the controller, or a baseline."""

    rate: float  # [Hz] of its steps

    def sense(self, t: float) -> ControllerState:
        """Bring the plant to time t [s]; how things stand, for the task's player."""

    def steer(self, t: float, setpoint: HybridSetpoint | None) -> str:
        """Send the arm to where this set-point wants it; why the set-point is refused, else ''."""


def play(task: Task, plant: Plant, steering: Steering, progress: Progress | None = None) -> Recording:
    """Play the task once, to its end or for MAX_DURATION; `progress` is told phase and simulated time."""
    player = TaskPlayer(task)
    recording = Recording(player.phases, torque_axes_of(task))
    loads: deque[tuple[float, Array]] = deque(maxlen=math.ceil(_REMEMBERED * steering.rate))
    for step in range(round(MAX_DURATION * steering.rate)):
        t = step * (1.0 / steering.rate)
        try:
            state = steering.sense(t)
        except MembraneError as error:  # what happens to the tool belongs to the run
            recording.message = str(error)
            break
        loads.append((t, plant.contact_wrench.vector()))
        status = player.step(t, state)
        if refusal := steering.steer(t, status.setpoint):
            player.cancel(refusal)
        if status.setpoint is not None:
            _record(recording, plant, task, status.setpoint, t, -1 if status.index is None else status.index)
            _record_belief(recording, loads, task, state)
        if progress is not None and (status.done or step % 25 == 0):
            progress(status.progress, f"{status.phase}, {t:.1f} s simulated")
        if status.done:
            recording.finished = not (status.failed or status.cancelled)
            recording.message, recording.found = status.message, player.found
            break
    return recording


class SeedSteering:
    """SEED: the controller, fed with reported flange poses and with relative poses from an estimator.

    Attributes:
        X_WE_reported: (4, 4) flange as the controller was last told it.
    """

    def __init__(
        self,
        plant: Plant,
        scenario: Scenario,
        law: str,
        estimator: str,
        seed: int,
        poses: Poses | None = None,
        wrench_model: WrenchModel | None = None,
    ) -> None:
        """The controller in front of a plant.

        Args:
            plant: as it is. scenario: as it is believed.
            law, estimator: by their names.
            seed: of noise.
            poses: another source of relative poses than `estimator` names.
            wrench_model: another than the one that the scenario names.
        """
        parameters = parameters_of(scenario, law)
        grasp = scenario.grasp
        believed = grasp.believed or (grasp.stiffness if plant.membranes is None else plant.stiffness)
        chosen, pressure = choose_model(scenario.wrench, believed, scenario.hand)
        self.controller = Controller(
            parameters,
            scenario.hand,
            scenario.tool,
            believed,
            wrench_model or chosen,
            references=stated(scenario.reference, scenario.measurement.arm_sensor),
            pressure=pressure,
        )
        self._arm_sensor = ArmSensor(scenario.measurement.arm_sensor, seed)
        self.rate, self._plant, self._enabled = parameters.rate, plant, False
        self._poses = poses or pose_source(estimator, scenario, seed, parameters.rate, plant)
        self._rng = np.random.default_rng([seed, 3])
        self._kinematics_noise = 1e-3 * scenario.measurement.kinematics_noise
        self.X_WE_reported = plant.X_WE.copy()

    def sense(self, t: float) -> ControllerState:
        if self._plant.membranes is not None and t <= LETTING_DOWN + 1.0 / self.rate:
            self._plant.carry(max(1.0 - t / LETTING_DOWN, 0.0))
        while self._poses.next_image() <= t + 1e-9:
            self._plant.advance(self._poses.next_image())
            self._poses.take_image(self._plant)
        self._plant.advance(t)
        reported = self._plant.X_WE.copy()
        if self._kinematics_noise:
            reported[:3, 3] += self._kinematics_noise * self._rng.standard_normal(3)
        self.X_WE_reported = reported
        self.controller.add_kinematics(t, reported)
        for stamp, load in self._arm_sensor.readings(self._plant, t):
            self.controller.add_arm_wrench(stamp, load)
        for estimate in self._poses.arrived(t):
            self.controller.add_estimate(estimate)
        if not self._enabled and t >= SETTLE:
            self.controller.enable(t)
            self._enabled = True
        return self.controller.state

    def steer(self, t: float, setpoint: HybridSetpoint | None) -> str:
        refusal = ""
        if setpoint is not None:
            try:
                self.controller.set_setpoint(setpoint, t)
            except SetpointError as error:
                refusal = str(error)
        output = self.controller.step(t)
        if output.X_WE is not None and self._enabled:
            self._plant.command(output.X_WE)
        return refusal


def start_pose(scenario: Scenario, task: Task) -> Array:
    """X_WE (4, 4) with the tip above the start of the task's first phase."""
    x, y, z = task.phases[0].to or (0.0, 0.0, 0.0)
    X_work_tip = make_pose(rotation_from_rpy(np.deg2rad(task.tip_rpy)), (x, y, max(z, START_HEIGHT)))
    X_WT = task.frame.pose @ X_work_tip @ inverse_pose(scenario.tool.X_Ttip)
    return np.asarray(X_WT @ inverse_pose(scenario.hand.X_EC))


def parameters_of(scenario: Scenario, law: str) -> ControllerParameters:
    """The controller's defaults, changed as the scenario says."""
    values = to_mapping(ControllerParameters()) | scenario.controller | {"law": law}
    return from_mapping(values, ControllerParameters, f"scenario {scenario.name}: controller")


def _record(recording: Recording, plant: Plant, task: Task, s: HybridSetpoint, t: float, phase: int) -> None:
    X_work, X_WT, X_Ttip = task.frame.pose, plant.X_WT, plant.tool.X_Ttip
    load, to_work = plant.contact_wrench, inverse_pose(X_work)
    R_work, R_T = X_work[:3, :3], X_WT[:3, :3]
    R_task = s.R_W_task if s.task_frame != "tool" else R_T @ X_Ttip[:3, :3]
    recording.add(
        t=t,
        phase=phase,
        force=R_work.T @ load.force,
        normal=R_work.T @ plant.true_normal,
        torque_T=R_T.T @ load.torque,
        wanted_force=R_work.T @ R_task @ s.wrench.force,
        wanted_torque_T=R_T.T @ R_task @ s.wrench.torque,
        tip=(to_work @ X_WT @ X_Ttip)[:3, 3],
        reference=(to_work @ s.X_W_tip)[:3, 3],
        lean=lean_of(s.X_W_tip[:3, :3] @ X_Ttip[:3, :3].T, R_T),
    )


def _at(loads: deque[tuple[float, Array]], t: float) -> Array:
    """(6,) of times [s] and loads, straight between them; NaN before the first."""
    times = [time for time, _ in loads]
    i = bisect_right(times, t)
    if i == 0:
        return np.full(6, np.nan)
    (before, a), (after, b) = loads[i - 1], loads[min(i, len(loads) - 1)]
    return a + (b - a) * ((t - before) / (after - before) if after > before else 0.0)


def _record_belief(recording: Recording, loads: deque[tuple[float, Array]], task: Task, state: ControllerState) -> None:
    """What the controller makes of it: force in the work frame with its stated deviation, and what it says.

    The wrench's error is that of the image: against what was true at its stamp, not when it has arrived.
    """
    R_work = task.frame.pose[:3, :3]
    force, stated = np.full(3, np.nan), np.full(3, np.nan)
    error, covariance = np.full(6, np.nan), np.full((6, 6), np.nan)
    if state.estimated is not None:
        estimated = state.estimated.rotated(state.R_W_task)
        force, error = R_work.T @ estimated.force, estimated.vector() - _at(loads, state.stamp - state.image_age)
        if state.covariance is not None:
            covariance = state.covariance
            stated = np.sqrt(np.diag(R_work.T @ covariance[3:, 3:] @ R_work))
    recording.add(
        believed_force=force,
        stated_force=stated,
        wrench_error=error,
        wrench_covariance=covariance,
        found_normal=R_work.T @ state.R_W_task[:, 2],
        mode=state.mode,
        told=tuple(t for t in (state.reason, *state.contradictions, state.doubt) if t),
    )

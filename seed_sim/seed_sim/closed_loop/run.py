# SPDX-License-Identifier: Apache-2.0
"""The closed loop without ROS and without a clock: plant, measurement, controller and task in one deterministic run."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from seed_control.controller import Controller, ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint, SetpointError
from seed_control.tasks import Task, TaskPlayer
from seed_core.config import from_mapping, to_mapping
from seed_core.spatial import Array, inverse_pose, make_pose, rotation_from_rpy
from seed_sim.closed_loop.recording import Recording, lean_of, torque_axes_of
from seed_sim.closed_loop.sources import source_for
from seed_sim.plant.plant import Plant
from seed_sim.scenario import Scenario

START_HEIGHT = 0.03  # [m] of the tip above the nominal table
MAX_DURATION = 120.0  # [s] of any run
SETTLE = 0.6  # [s] of hanging still before the controller is enabled
Progress = Callable[[float, str], None]


@dataclass
class Run:
    """Everything of one run."""

    recording: Recording
    plant: Plant
    controller: Controller | None


def start_pose(scenario: Scenario, task: Task) -> Array:
    """X_WE (4, 4) with the tip above the start of the task's first phase."""
    first = task.phases[0].to or (0.0, 0.0, 0.0)
    place = (first[0], first[1], max(first[2], START_HEIGHT))
    X_W_tip = task.frame.pose @ make_pose(rotation_from_rpy(np.deg2rad(task.tip_rpy)), place)
    X_WT: Array = X_W_tip @ inverse_pose(scenario.tool.X_Ttip)
    return X_WT @ inverse_pose(scenario.hand.X_EC)


def parameters_of(scenario: Scenario, law: str) -> ControllerParameters:
    """The controller's defaults, changed as the scenario says."""
    values = to_mapping(ControllerParameters()) | scenario.controller | {"law": law}
    return from_mapping(values, ControllerParameters, f"scenario {scenario.name}: controller")


def run_closed_loop(
    scenario: Scenario,
    task: Task,
    *,
    law: str = "seed",
    estimator: str = "truth",
    seed: int = 0,
    meshcat: Any = None,
    progress: Progress | None = None,
) -> Run:
    """Play the task once. Deterministic: everything but the wall time depends on the arguments alone."""
    began = time.perf_counter()
    X_WE = start_pose(scenario, task)
    plant = Plant(scenario, seed, task.frame.pose, X_WE, meshcat=meshcat)
    parameters = parameters_of(scenario, law)
    grasp = scenario.grasp
    controller = Controller(parameters, scenario.hand, scenario.tool, grasp.believed or grasp.stiffness)
    player = TaskPlayer(task)
    recording = Recording(player.phases, torque_axes=torque_axes_of(task))
    source = source_for(estimator, scenario, seed, parameters.rate)
    rng = np.random.default_rng([seed, 3])
    dt = 1.0 / parameters.rate
    enabled = False
    kinematics_noise = 1e-3 * scenario.measurement.kinematics_noise
    for step in range(round(MAX_DURATION / dt)):
        t = step * dt
        while source.next_image() <= t + 1e-9:
            plant.advance(source.next_image())
            source.look(plant)
        plant.advance(t)
        reported = plant.X_WE.copy()
        if kinematics_noise:
            reported[:3, 3] += kinematics_noise * rng.standard_normal(3)
        controller.add_kinematics(t, reported)
        for estimate in source.arrived(t):
            controller.add_estimate(estimate)
            recording.estimates.append(estimate)
        if not enabled and t >= SETTLE:
            controller.enable(t)
            enabled = True
        status = player.step(t, controller.state)
        if status.setpoint is not None:
            try:
                controller.set_setpoint(status.setpoint, t)
            except SetpointError as error:
                player.cancel(str(error))
        output = controller.step(t)
        if output.X_WE is not None and enabled:
            plant.command(output.X_WE)
        if status.setpoint is not None:
            index = recording.phases.index(status.phase) if status.phase in recording.phases else -1
            _record(recording, plant, task, status.setpoint, t, index)
        if progress is not None and step % 25 == 0:
            progress(status.progress, status.phase)
        if status.done:
            recording.finished = not (status.failed or status.cancelled)
            recording.message = status.message
            break
    recording.wall_time = time.perf_counter() - began
    return Run(recording, plant, controller)


def _record(recording: Recording, plant: Plant, task: Task, s: HybridSetpoint, t: float, phase: int) -> None:
    X_work = task.frame.pose
    R_work, X_WT = X_work[:3, :3], plant.X_WT
    load = plant.contact_wrench
    R_T, X_Ttip = X_WT[:3, :3], plant.tool.X_Ttip
    R_task = s.R_W_task if s.task_frame != "tool" else X_WT[:3, :3] @ X_Ttip[:3, :3]
    wanted_force = R_work.T @ R_task @ s.wrench.force
    wanted_torque = R_T.T @ R_task @ s.wrench.torque
    to_work = inverse_pose(X_work)
    recording.add(
        t=t,
        phase=phase,
        force=R_work.T @ load.force,
        torque=R_work.T @ load.torque,
        torque_T=R_T.T @ load.torque,
        wanted_force=wanted_force,
        wanted_torque_T=wanted_torque,
        tip=(to_work @ X_WT @ X_Ttip)[:3, 3],
        reference=(to_work @ s.X_W_tip)[:3, 3],
        lean=lean_of(s.X_W_tip[:3, :3] @ X_Ttip[:3, :3].T, R_T),
        X_CT=plant.X_CT,
    )

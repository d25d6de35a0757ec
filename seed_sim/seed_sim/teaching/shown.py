# SPDX-License-Identifier: Apache-2.0
"""A run that is shown to the simulated cell: what the controller measures of it, and what is true."""

from dataclasses import replace

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState
from seed_control.tasks import Task
from seed_control.teach import Demonstration, Recorder
from seed_control.teach.demonstration import STEP as EVEN_STEP
from seed_core.spatial import Array
from seed_sim.closed_loop.run import SETTLE, SeedSteering, start_pose
from seed_sim.plant.plant import Plant
from seed_sim.scenario import load_scenario

STEP = 0.004  # [s]
_STEPS_APART = round(EVEN_STEP / STEP)  # of true samples: a comparison keeps no more
_PRESSES = 3.0  # [s] in which a hand comes down and presses, before it leads on
_LIFT, _LIFTS = 0.05, 0.03  # [m], [m/s] at the end
_DOWN = 0.02  # [m/s] of a hand towards the surface, at most
_FEELS = 0.2  # [N] that tells a hand of the surface
_GIVES = 0.003  # [m/s] per newton: how fast a hand answers a force that is not the one it means
_TREMBLES = 1e-4  # [m] at 9 Hz
_WAVERS = 0.04  # share of the force at 0.6 Hz


class Shown:
    """Steers as SEED does, and remembers: `measured` is what `./seed teach` hears, `true` is the plant's."""

    def __init__(self, task: Task, scenario: str, table: Array, seed: int, noise: int, estimator: str) -> None:
        """The cell of a seed, at rest above the task's start.

        Args:
            task: that is played, or whose start is above where a hand leads.
            scenario: by its name.
            table: X_W (4, 4) about which the seed tilts and shifts the table: one table, whatever frame is taught.
            seed: of table and arm. noise: seed of the estimates' noise.
            estimator: by its name.
        """
        cell = load_scenario(scenario)
        # by its weight a tool that moves along a table seems to hang free, where no controller presses it
        cell = replace(cell, reference=replace(cell.reference, correct=False))
        self.start = start_pose(cell, task)
        self.plant = Plant(cell, seed, table, self.start)
        self.steering = SeedSteering(self.plant, cell, "seed", estimator, noise)
        self.rate, self._measured, self._true = self.steering.rate, Recorder(), Recorder()

    def sense(self, t: float) -> ControllerState:
        """As Steering."""
        return self.steering.sense(t)

    def steer(self, t: float, setpoint: HybridSetpoint | None) -> str:
        """As Steering."""
        refusal = self.steering.steer(t, setpoint)
        self._remember(t)
        return refusal

    def _remember(self, t: float) -> None:
        state = self.steering.controller.state
        if state.X_W_tip is not None and state.estimated is not None:
            force = state.estimated.rotated(state.R_W_task).force
            self._measured.add(state.stamp - state.image_age, state.X_W_tip, force)
        if round(t / STEP) % _STEPS_APART == 0:
            tip = self.plant.X_WT @ self.plant.tool.X_Ttip
            self._true.add(t, tip, self.plant.contact_wrench.force)

    @property
    def measured(self) -> Demonstration:
        """One measurement of each image, from the first motion to the last."""
        return self._measured.demonstration().moving()

    @property
    def true(self) -> Demonstration:
        """As dense as a comparison keeps it."""
        return self._true.demonstration()

    def led(self, path: Array, forces: Array, speed: float) -> None:
        """A hand leads the flange over points (n, 2) [m] of the work frame, each with its force (n,) [N].

        The controller is never enabled. The hand feels the force, and answers by moving up or down; it trembles.
        """
        self.steering._enabled = True  # it is not to enable itself
        along = np.concatenate(((0.0,), np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
        steps, rest = max(round(along[-1] / speed / STEP), 1), round((SETTLE + _PRESSES) / STEP)
        way = along[-1] * np.concatenate((np.zeros(rest), np.arange(1, steps + 1) / steps, np.ones(round(0.3 / STEP))))
        over = np.column_stack([np.interp(way, along, column) for column in path.T]) - path[0]
        wanted = np.interp(way, along, forces)
        z = 0.0
        for k in range(len(way)):
            t = k * STEP
            if t >= SETTLE:
                z -= STEP * self._hand(wanted[k] * (1.0 + _WAVERS * np.sin(2.0 * np.pi * 0.6 * t)), k < rest)
            self._lead(t, (*over[k], z + _TREMBLES * np.sin(2.0 * np.pi * 9.0 * t)))
        for k in range(round(_LIFT / _LIFTS / STEP)):
            z += _LIFTS * STEP
            self._lead((len(way) + k) * STEP, (*over[-1], z))

    def _hand(self, meant: float, comes: bool) -> float:
        """Speed [m/s] downwards of a hand that means a force [N]; comes: it may not have touched yet."""
        felt = abs(float(self.plant.contact_wrench.force[2]))
        return _DOWN if comes and felt < _FEELS else float(np.clip(_GIVES * (meant - felt), -_DOWN, _DOWN))

    def _lead(self, t: float, moved: tuple[float, ...]) -> None:
        self.sense(t)
        self.steering.controller.step(t)
        X = self.start.copy()
        X[:3, 3] += moved
        self.plant.command(X)
        self._remember(t)

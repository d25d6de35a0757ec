# SPDX-License-Identifier: Apache-2.0
"""What is shown to the simulated cell, by hand or by a task, plays again: the same path, the same force."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip("pydrake", reason="needs Drake")

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState
from seed_control.tasks import Task, load_task
from seed_control.teach import Demonstration, Recorder, TeachSettings, task_text, taught
from seed_control.teach.compare import difference
from seed_core.config import load_text
from seed_core.spatial import Array
from seed_sim.closed_loop.run import SETTLE, SeedSteering, play, start_pose
from seed_sim.plant.plant import Plant
from seed_sim.scenario import load_scenario

STEP = 0.004  # [s]


class Shown:
    """Steers as SEED does; remembers what a person would show by it, and the truth."""

    def __init__(self, task: Task, seed: int, estimator: str) -> None:
        scenario = load_scenario("nominal")
        # by its weight a tool that moves along a table seems to hang free, where no controller presses it
        scenario = replace(scenario, reference=replace(scenario.reference, correct=False))
        self.start = start_pose(scenario, task)
        self.plant = Plant(scenario, seed, task.frame.pose, self.start)
        self.steering = SeedSteering(self.plant, scenario, "seed", estimator, seed)
        self.rate, self._measured, self._true = self.steering.rate, Recorder(), Recorder()

    def sense(self, t: float) -> ControllerState:
        return self.steering.sense(t)

    def steer(self, t: float, setpoint: HybridSetpoint | None) -> str:
        refusal = self.steering.steer(t, setpoint)
        self.remember(t)
        return refusal

    def remember(self, t: float) -> None:
        state = self.steering.controller.state
        if state.X_W_tip is not None and state.estimated is not None:
            force = state.estimated.rotated(state.R_W_task).force
            self._measured.add(state.stamp - state.image_age, state.X_W_tip, force)
        tip = self.plant.X_WT @ self.plant.tool.X_Ttip
        self._true.add(t, tip, self.plant.contact_wrench.force)

    @property
    def measured(self) -> Demonstration:
        return self._measured.demonstration().moving()

    @property
    def true(self) -> Demonstration:
        return self._true.demonstration()


def replayed(demonstration: Demonstration, settings: TeachSettings, seed: int, estimator: str) -> tuple[Shown, Task]:
    made = taught(demonstration, "mine", "squeegee", settings).task
    task = load_text(task_text(made), Task, "mine.yaml")
    again = Shown(task, seed, estimator)
    recording = play(task, again.plant, again)
    assert recording.finished, recording.message
    return again, task


def pulled(shown: Shown) -> None:
    """A hand pulls the flange down, along a quarter of a circle and up; the controller is never enabled."""
    down, radius, speed = 0.037, 0.05, 0.04
    shown.steering._enabled = True  # it is not to enable itself
    at = [np.zeros(3)] * round(SETTLE / STEP)

    def to(points: Array) -> None:
        for a, b in pairwise(points):
            n = max(round(np.linalg.norm(b - a) / speed / STEP), 1)
            at.extend(a + (b - a) * k / n for k in range(1, n + 1))

    to(np.array((at[-1], (0.0, 0.0, -down))))
    at.extend([at[-1]] * 100)
    angle = np.linspace(0.0, np.pi / 2, 30)
    to(at[-1] + radius * np.column_stack((np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle)))
    at.extend([at[-1]] * 100)
    to(np.array((at[-1], at[-1] + (0.0, 0.0, down))))
    for k, moved in enumerate(at):
        t = k * STEP
        shown.sense(t)
        shown.steering.controller.step(t)
        X = shown.start.copy()
        X[:3, 3] += moved
        shown.plant.command(X)
        shown.remember(t)


@pytest.mark.slow
def test_an_arm_that_was_led_by_hand_goes_the_same_way_with_the_same_force() -> None:
    shown = Shown(load_task("squeegee"), 1, "truth")
    pulled(shown)
    settings = TeachSettings(force=1.0)  # a hand presses less evenly than a controller
    again, task = replayed(shown.measured, settings, 1, "truth")
    assert sum(p.control is not None for p in task.phases) >= 2
    apart = difference(shown.true, again.true, settings)
    assert apart.path < 1e-3  # [m]
    assert apart.force < 0.6  # [N]: the steps in which an uneven hand is taught


@pytest.mark.slow
def test_a_task_that_was_played_plays_again_as_it_was_taught() -> None:
    short = load_text(SHORT, Task, "short.yaml")
    shown = Shown(short, 1, "truth")
    assert play(short, shown.plant, shown).finished
    again, task = replayed(shown.measured, TeachSettings(resists=("x",)), 1, "truth")
    forces = {p.control.force for p in task.phases if p.control is not None}
    assert len(forces) == 1
    apart = difference(shown.true, again.true)
    assert apart.path < 1e-3
    assert apart.force < 0.3


SHORT = """
name: short
tool: squeegee
frame: {position: 0.45 0.0 0.0 m}
phases:
  - {name: approach, to: 0 0 0.015 m, speed: 0.1 m/s}
  - name: press
    to: 0.015 0 0 m
    speed: 0.015 m/s
    control: &pressing {force: 0 0 -8 N, torque_axes: [x], contact_resists: [x]}
    until: settled
  - {name: wipe, to: 0.1 0 0 m, control: *pressing}
  - {name: lift, to: 0.1 0 0.04 m, speed: 0.03 m/s}
"""

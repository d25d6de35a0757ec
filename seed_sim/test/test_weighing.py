# SPDX-License-Identifier: Apache-2.0
"""Weighing the tool in the simulated cell: the motion, the samples and what they say of mass and stiffness."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_control.controller import Controller, ControllerParameters
from seed_control.payload.identify import Payload
from seed_control.payload.motion import PayloadRun
from seed_control.tasks import load_task
from seed_sim.closed_loop.relative_poses import pose_source
from seed_sim.closed_loop.run import start_pose
from seed_sim.plant.plant import Plant
from seed_sim.scenario import Scenario, load_scenario


def weighed(scenario: Scenario, believed: float = 1.0, estimator: str = "noisy", seed: int = 3) -> Payload:
    task = load_task("squeegee")
    plant = Plant(scenario, seed, task.frame.pose, start_pose(scenario, task))
    controller = Controller(
        ControllerParameters(), scenario.hand, scenario.tool, scenario.grasp.stiffness.scaled(believed)
    )
    source, run, t = pose_source(estimator, scenario, seed, 250.0), None, 0.0
    while t < 40.0:
        while source.next_image() <= t + 1e-9:
            plant.advance(source.next_image())
            source.take_image(plant)
        plant.advance(t)
        controller.add_kinematics(t, plant.X_WE.copy())
        for estimate in source.arrived(t):
            controller.add_estimate(estimate)
        if run is None and t >= 0.6:
            controller.enable(t)
            run = PayloadRun(controller.wrench_estimator, scenario.tool, controller.step(t).state)
        if run is not None:
            status = run.step(t, controller.state)
            if status.done:
                assert not status.failed
                return run.result()
            if status.setpoint is not None:
                controller.set_setpoint(status.setpoint, t)
        output = controller.step(t)
        if run is not None and output.X_WE is not None:
            plant.command(output.X_WE)
        t += 0.004
    raise AssertionError("the weighing has no end")


def test_weighing_finds_mass_and_centre_of_mass_of_the_hanging_tool() -> None:
    scenario = load_scenario("nominal")
    weight = weighed(scenario)
    assert_allclose(weight.mass, scenario.tool.mass, rtol=0.03)  # noise of 0.3 mm in 2.5 mm, over 100 images
    off = np.abs(weight.center_of_mass - scenario.tool.center_of_mass)
    assert (off < 4.0 * weight.center_of_mass_std).all()
    assert off.max() < 0.012  # half a degree of noise an image, a torque of 0.04 N m on 3 N m/rad
    assert weight.stiffness_ratio == pytest.approx(1.0, abs=0.03)


def test_a_stiffness_that_is_believed_too_high_shows_against_the_known_mass() -> None:
    weight = weighed(load_scenario("nominal"), believed=1.25)
    assert weight.stiffness_ratio == pytest.approx(0.8, rel=0.03)

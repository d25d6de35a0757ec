# SPDX-License-Identifier: Apache-2.0
"""A plant coupled to the stand-in sees the flange and presses back."""

import time

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_ur.kinematics import URKinematics
from seed_ur.plant_link import ArmState, PlantLink
from seed_ur.standin.controller import UPTIME
from seed_ur.standin.options import HOME
from seed_ur.standin_client import StandIn

pytestmark = pytest.mark.realtime


def wait_for_state(link: PlantLink, force: np.ndarray, seconds: float) -> ArmState:
    deadline = time.monotonic() + seconds
    state = None
    while time.monotonic() < deadline:
        state = link.exchange(force, np.zeros(3)) or state
        time.sleep(0.002)
    assert state is not None
    return state


def test_plant_gets_the_flange_and_gives_the_wrench() -> None:
    with StandIn() as robot, PlantLink(robot.host) as link:
        state = wait_for_state(link, np.array([0.0, 0.0, -10.0]), 0.2)
        assert_allclose(state.X_WE, URKinematics.for_model("ur5e").forward(state.q), atol=1e-12)
        assert 0.0 < state.time - UPTIME < 60.0
        # the flange looks down, so pushing it along -z of the flange pushes up in the base
        assert_allclose(robot.ask("state")["wrench"][:3], [0.0, 0.0, 10.0], atol=0.1)


def test_wrench_is_zero_when_the_plant_is_gone() -> None:
    with StandIn() as robot:
        with PlantLink(robot.host) as link:
            wait_for_state(link, np.array([1.0, 2.0, 3.0]), 0.1)
        time.sleep(1.0)
        assert_allclose(robot.ask("state")["wrench"], np.zeros(6), atol=0)


def test_a_plant_sets_the_clock_and_its_pace() -> None:
    with StandIn() as robot, PlantLink(robot.host) as link:
        link.place(URKinematics.for_model("ur5e").forward(HOME), HOME, clock=1000.0)
        clock = run_until(link, 1000.1, 0.5)
        assert clock == pytest.approx(1000.1, abs=0.003)  # it got there, and stands still
        assert run_until(link, 1001.0, 0.3) > clock + 0.1  # let go, it runs again


def run_until(link: PlantLink, until: float, seconds: float) -> float:
    """The controller's clock after letting it run so far for some time."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        link.report(np.zeros(3), np.zeros(3), until)
        time.sleep(0.005)
    state = link.receive()
    assert state is not None
    return state.time

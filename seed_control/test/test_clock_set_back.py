# SPDX-License-Identifier: Apache-2.0
"""Stamps of a time still to come: they would pass for fresh, and nothing that comes afterwards for newer."""

import numpy as np
import pytest

from seed_control import Controller, ControllerParameters
from seed_control.controller import ControlRefusedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Hand, Tool
from seed_core.spatial import make_pose, pose_from_rpy

X_WE = pose_from_rpy((np.pi, 0.0, 0.0), (0.4, 0.0, 0.3))
HANGING = make_pose(None, (0.0, 0.0, 0.2 * 9.81 / 800.0))


def run(controller: Controller, start: float, steps: int = 50) -> float:
    """Steps with good inputs; the time after them [s]."""
    for i in range(steps):
        t = start + 0.004 * i
        controller.add_kinematics(t, X_WE)
        if i % 5 == 0:
            controller.add_estimate(RelativePoseEstimate(t, HANGING, 1e-8 * np.eye(6)))
        controller.step(t)
    return start + 0.004 * steps


def made() -> Controller:
    return Controller(ControllerParameters(), Hand(), Tool(), DEFAULT_STIFFNESS)


def test_a_clock_that_is_set_back_holds_and_then_goes_on() -> None:
    controller = made()
    t = run(controller, 1000.0)
    controller.enable(t)
    assert controller.step(t).state.mode == "idle"
    t = run(controller, 980.0, steps=1)
    assert controller.state.mode == "holding"
    assert "the clock was set back by 20.196 s" in controller.state.reason
    t = run(controller, t)
    controller.enable(t)
    assert controller.step(t).state.mode == "idle"


def test_a_silent_arm_is_seen_after_the_clock_was_set_back() -> None:
    controller = made()
    t = run(controller, 1000.0)
    controller.enable(t)
    controller.step(990.0)
    with pytest.raises(ControlRefusedError):  # nothing has come since
        controller.enable(990.1)


@pytest.mark.parametrize("place", [(1e308, 0.0, 0.3), (450.0, 0.0, 300.0)])
def test_a_pose_further_than_any_arm_reaches_is_refused(place: tuple[float, float, float]) -> None:
    controller = made()
    t = run(controller, 1000.0)
    assert not controller.add_kinematics(t, make_pose(X_WE[:3, :3], place))
    assert not controller.add_estimate(RelativePoseEstimate(t, make_pose(None, place), 1e-8 * np.eye(6)))
    controller.step(t)
    assert "metres" in controller.state.reason or controller.state.mode == "disabled"

# SPDX-License-Identifier: Apache-2.0
"""Limits of force and speed that are lowered while the controller moves the arm."""

from dataclasses import replace

import numpy as np
import pytest
from quasi_static import DOWN, DT, Bench

from seed_control.setpoint.setpoints import HybridSetpoint, SetpointError
from seed_core.config import ConfigError
from seed_core.spatial import make_pose


def lower(bench: Bench, **limits: float) -> None:
    bench.controller.set_limits(replace(bench.controller.parameters, **limits), bench.t)


def test_a_force_that_is_allowed_no_longer_ends_in_a_hold_and_is_refused_from_then_on() -> None:
    bench = Bench().enabled()
    bench.press(8.0)
    bench.run(2.0)
    lower(bench, max_force=9.0)
    bench.run(0.1)
    assert bench.state.mode == "contact"
    lower(bench, max_force=5.0)
    bench.run(0.1)
    assert bench.state.mode == "holding"
    assert "the limits were lowered: SP11: force of 8 N is beyond max_force = 5 N" in bench.state.reason
    bench.controller.enable(bench.t)
    with pytest.raises(SetpointError, match="max_force = 5 N"):
        bench.press(8.0)


def test_a_speed_that_is_lowered_on_the_way_is_kept_after_braking() -> None:
    bench = Bench(start=make_pose(p=(0.0, 0.0, 0.3)) @ DOWN).enabled()
    bench.controller.set_setpoint(HybridSetpoint(DOWN), bench.t)
    bench.run(0.6)
    lower(bench, max_speed=0.05)
    bench.run(0.3)  # 0.2 m/s at 2 m/s^2 and with bounded jerk
    before = len(bench.commands)
    bench.run(0.5)
    heights = np.array([X[2, 3] for X in bench.commands[before:]])
    speeds = np.abs(np.diff(heights)) / DT
    assert speeds.max() <= 0.05 + 1e-6
    assert speeds.min() > 0.04  # it goes on


def test_a_limit_out_of_its_bounds_is_refused_and_what_is_no_limit_stays() -> None:
    bench = Bench().enabled()
    with pytest.raises(ConfigError, match="max_force"):
        lower(bench, max_force=-1.0)
    lower(bench, estimate_timeout=1.0)
    assert bench.controller.parameters.estimate_timeout == 0.14


def test_a_lower_speed_of_turning_is_known_to_all_that_goes_by_it() -> None:
    bench = Bench().enabled()
    lower(bench, max_angular_speed=0.05)
    assert bench.controller.law.deflection.parameters.max_angular_speed == 0.05

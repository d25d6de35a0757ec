# SPDX-License-Identifier: Apache-2.0
"""Whatever comes in whichever order: no exception, finite commands, and nothing left of the set-point before."""

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from quasi_static import DOWN, PRESS_Z, Bench

from seed_control.controller import ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint, RelativePoseSetpoint, SetpointError, WrenchSetpoint
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Wrench, make_pose

PRESS = Wrench(np.zeros(3), np.array((0.0, 0.0, -5.0)))
SLANTED = np.array((0.6, 0.0, 0.8))
Action = Callable[[Bench], None]


def follow(setpoint: object) -> Action:
    return lambda bench: bench.controller.set_setpoint(setpoint, bench.t)  # type: ignore[arg-type]


def invalid_images(bench: Bench) -> None:
    for i in range(3):
        bench.controller.add_estimate(RelativePoseEstimate(bench.t + 1e-4 * i, np.eye(4), valid=False, reason="none"))


ACTIONS: dict[str, Action] = {
    "enable": lambda bench: bench.controller.enable(bench.t),
    "disable": lambda bench: bench.controller.disable(bench.t, "asked"),
    "hold": invalid_images,
    "free": follow(HybridSetpoint(DOWN)),
    "one": follow(HybridSetpoint(DOWN, PRESS, PRESS_Z)),
    "slanted": follow(HybridSetpoint(DOWN, Wrench(np.zeros(3), -5.0 * SLANTED), np.outer(SLANTED, SLANTED))),
    "two": follow(HybridSetpoint(DOWN, PRESS, np.diag([0.0, 1.0, 1.0]), task_frame="tool")),
    "three": follow(HybridSetpoint(DOWN, PRESS, np.eye(3), (True,) * 3, contact_resists=(True,) * 3)),
    "wrench": follow(WrenchSetpoint(PRESS)),
    "relative": follow(RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.004)))),
}


def do(bench: Bench, name: str) -> None:
    """One action, the images that follow it, and what has to be true after each."""
    stopped = bench.state.mode in ("disabled", "holding")
    if stopped and name not in ("enable", "disable", "hold"):
        with pytest.raises(SetpointError, match="SP17"):
            ACTIONS[name](bench)
    else:
        ACTIONS[name](bench)
    state = bench.run(0.1)
    law = bench.controller.law
    assert np.isfinite(bench.commands[-1]).all()
    assert len(law.plan.normals) == len(law.plan.wanted) == len(law.reference._references)
    if law.setpoint is None:
        assert not law.regulates_force
        assert not state.in_contact
        assert not law.plan.limits
        np.testing.assert_array_equal(law.plan.R_W_task, np.eye(3))
    assert (state.setpoint_kind in ("wrench", "hybrid")) == (law.setpoint is not None)


@pytest.mark.parametrize("first", list(ACTIONS))
def test_every_sequence_of_three_from_an_enabled_controller(first: str) -> None:
    for rest in product(ACTIONS, repeat=2):
        bench = Bench(image_rate=60.0, delay=0.0).enabled()
        for name in (first, *rest):
            do(bench, name)


@pytest.mark.parametrize("seed", range(6))
def test_long_random_sequences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bench = Bench(parameters=ControllerParameters(law=("seed", "plain", "published")[seed % 3])).enabled()
    names = [*ACTIONS, *["enable"] * 5]  # so that most of them are followed
    for i in rng.integers(len(names), size=120):
        do(bench, names[i])

# SPDX-License-Identifier: Apache-2.0
"""A tool that is tilted about its tip keeps the tip where it is."""

import numpy as np
import pytest
from quasi_static import DT, Bench

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.wrench.filters import WantedTurn
from seed_core.spatial import make_pose, rotation_from_rpy

SPEED = 0.4  # [rad/s]
ALL = (True, True, True)


class TurningBench(Bench):
    """An arm that turns as well, with the same lag."""

    def step(self):
        R = self.X_WE[:3, :3]
        state = super().step()
        wanted = self.commands[-1][:3, :3]
        share = 1.0 - np.exp(-DT / self.lag)
        U, _, V = np.linalg.svd(R + share * (wanted - R))
        self.X_WE = make_pose(U @ V, self.X_WE[:3, 3])
        return state


def test_the_tip_stays_while_the_tool_tilts_about_it() -> None:
    bench = TurningBench(table=-1.0).enabled()
    tips = []
    bench.controller.set_setpoint(HybridSetpoint(bench.start), bench.t)
    bench.run(1.0)
    for i in range(round(2.5 / DT)):
        angle = min(SPEED * i * DT, 0.6)
        X = bench.start @ make_pose(rotation_from_rpy((0.0, angle, 0.0)))
        bench.controller.set_setpoint(HybridSetpoint(X), bench.t)
        bench.step()
        tips.append((bench.X_WE @ bench.hand.X_EC @ bench.grasp() @ bench.tool.X_Ttip)[:3, 3])
    off = np.linalg.norm(np.array(tips) - bench.start[:3, 3], axis=1)
    assert off.max() < 2e-3
    assert off[-50:].max() < 5e-4


@pytest.mark.parametrize("held", [ALL, (True, False, True)])
def test_a_turn_is_that_of_the_held_axes_between_image_and_answer(held: tuple[bool, bool, bool]) -> None:
    turn, loop, frame = WantedTurn(), 0.12, 0.02
    for i in range(40):
        R = rotation_from_rpy((0.0, SPEED * i * frame, 0.0))
        turns = turn.update(R, held, i * frame, loop, 1.0)
    assert turns == held[1]
    if turns:
        assert np.abs(turn.step - rotation_from_rpy((0.0, SPEED * frame, 0.0))).max() < 1e-9
        assert np.abs(turn.since - rotation_from_rpy((0.0, SPEED * loop, 0.0))).max() < 1e-9


def test_a_step_turns_no_faster_than_the_gripper() -> None:
    turn = WantedTurn()
    turn.update(np.eye(3), ALL, 0.0, 0.1, 0.5)
    assert turn.update(rotation_from_rpy((0.0, 1.0, 0.0)), ALL, 0.02, 0.1, 0.5)
    assert np.abs(turn.step - rotation_from_rpy((0.0, 0.01, 0.0))).max() < 1e-9

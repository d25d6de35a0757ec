# SPDX-License-Identifier: Apache-2.0
"""The validation of gels: a short draw is within the goal, and draws differ."""

import numpy as np

from seed_sim.tactile.trajectory import TrajectorySection
from seed_testing.validation import gel
from seed_testing.validation.scores import NAMED


def test_a_short_draw_is_within_the_goal_by_two_gels() -> None:
    motion = TrajectorySection(duration=1.0, rate=8.0, translation_mm=(0.3, 0.05, 0.3), rotation_deg=(1.0, 2.0, 1.0))
    result = gel.one(41, motion, places=(6, 4))
    both = result["both"]
    assert both["valid_fraction"] == 1.0
    for name in NAMED:
        assert both["rmse"][name] < (gel.GOAL[0] if name.endswith("mm") else gel.GOAL[1]), name
    assert set(result) == {"seed", "tool", *gel.CASES}


def test_draws_differ_in_tool_and_mounts() -> None:
    a, b = (gel.parameters(np.random.default_rng(s)) for s in (1, 2))
    assert a.tool != b.tool
    assert a.T_held != b.T_held
    hand = gel.gel_hand(a)
    told = gel.believed(hand, np.random.default_rng(3))
    assert 0.0 < np.linalg.norm(told.X_CL[:3, 3] - hand.X_CL[:3, 3]) < 1e-3

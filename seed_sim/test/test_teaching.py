# SPDX-License-Identifier: Apache-2.0
"""What is shown to the simulated cell plays again: the short form of `./seed bench teach`."""

import numpy as np
import pytest

pytest.importorskip("pydrake", reason="needs Drake")

from seed_sim.teaching.draw import KINDS, draw
from seed_sim.teaching.score import Replay, replay, summary, table


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(len(KINDS)))
def test_a_replay_follows_path_and_force_of_what_was_shown(seed: int) -> None:
    found = replay(seed)
    assert not found.ended
    assert found.path < 1e-3  # [m]
    assert found.force < 0.3  # [N]


def test_kinds_take_turns_and_no_path_leaves_the_table() -> None:
    cases = [draw(seed) for seed in range(40)]
    assert [c.kind for c in cases[: len(KINDS)]] == list(KINDS)
    for case in cases:
        assert np.ptp(case.path, axis=0).max() <= 0.2
        assert case.task().tool == case.tool


def test_a_replay_that_ended_early_counts_as_infinitely_far() -> None:
    good = [Replay("led pen", seed, 5e-4, 1e-3, 0.1) for seed in range(9)]
    result = summary([*good, Replay("led pen", 9, 1e-4, 1e-4, 0.0, "held")])
    assert result["all"]["path_mm"]["median"] == pytest.approx(0.5)
    assert result["all"]["path_mm"]["worst"] == np.inf
    assert "seed 9: held" in table(result)

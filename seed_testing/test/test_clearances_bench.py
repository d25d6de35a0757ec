# SPDX-License-Identifier: Apache-2.0
"""Random arms among random boxes, at random speeds: some are held, none comes nearer than its clearance."""

import pytest

from seed_testing.bench import clearances


def test_no_random_motion_comes_nearer_than_the_clearance() -> None:
    figures = clearances.run(8, seed=100)
    assert 1 <= figures["held"] < 8
    assert figures["least_beyond_clearance_mm"] >= 0.0
    assert figures["looks_share"] < 0.8


@pytest.mark.parametrize("seed", [5001, 5070])
def test_a_stop_that_bends_or_ends_a_branch_keeps_the_clearance(seed: int) -> None:
    """One turns longer than it moves, past the corner of a box; one straightens the elbow."""
    assert clearances.run(1, seed)["least_beyond_clearance_mm"] >= 0.0

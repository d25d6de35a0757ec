# SPDX-License-Identifier: Apache-2.0
"""Random arms among random boxes, at random speeds: some are held, none comes nearer than its clearance."""

from seed_testing.bench import clearances


def test_no_random_motion_comes_nearer_than_the_clearance() -> None:
    figures = clearances.run(8, seed=100)
    assert 1 <= figures["held"] < 8
    assert figures["least_beyond_clearance_mm"] >= 0.0
    assert figures["looks_share"] < 0.8

# SPDX-License-Identifier: Apache-2.0
"""Random arms among random boxes, at random speeds: some are held, none uses up more than 1 mm of its clearance."""

from seed_testing.bench import clearances


def test_no_random_motion_comes_much_nearer_than_the_clearance() -> None:
    figures = clearances.run(8, seed=100)
    assert 1 <= figures["held"] < 8
    assert figures["least_beyond_clearance_mm"] >= -1.0  # of 10 mm: between poses that are looked at
    assert figures["looks_share"] < 0.8

# SPDX-License-Identifier: Apache-2.0
"""Pairs are made of images of one moment, whatever arrives late, twice, or never."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from seed_ros.images.pairing import Pairing

PERIOD = 1.0 / 45.0


def test_images_of_one_moment_are_paired_in_spite_of_jitter_and_order() -> None:
    rng = np.random.default_rng(1)
    pairing: Pairing[int] = Pairing(("left", "right"), tolerance=0.008)
    pairs = []
    for i in range(200):
        jitter = rng.uniform(-0.003, 0.003, 2)
        for name in rng.permutation(["left", "right"]):
            done = pairing.add(str(name), i * PERIOD + jitter[int(name == "right")], i)
            if done:
                pairs.append(done[1])
    assert [p["left"] for p in pairs] == list(range(200))
    assert all(p["left"] == p["right"] for p in pairs)
    assert pairing.unpaired == 0


def test_a_lost_image_costs_its_partner_only() -> None:
    pairing: Pairing[int] = Pairing(("left", "right"), tolerance=0.008)
    pairs = []
    for i in range(60):
        for name in ("left", "right"):
            if (name, i) in (("left", 10), ("right", 31)):
                continue
            if done := pairing.add(name, i * PERIOD, i):
                pairs.append(done[1])
    assert [p["left"] for p in pairs] == [i for i in range(60) if i not in (10, 31)]
    assert all(p["left"] == p["right"] for p in pairs)
    assert pairing.unpaired == 2


def test_a_clock_set_back_starts_again_and_a_late_packet_does_not() -> None:
    pairing: Pairing[int] = Pairing(("left", "right"), tolerance=0.008)
    for name in ("left", "right"):
        pairing.add(name, 100.0, 0)
    assert pairing.add("left", 99.99, 1) is None
    assert pairing.add("right", 99.99, 1) is None
    assert pairing.backwards == 2
    assert pairing.add("left", 5.0, 2) is None
    done = pairing.add("right", 5.0, 2)
    assert done is not None
    assert done[1] == {"left": 2, "right": 2}


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.sampled_from("abcd"), st.floats(-0.04, 0.04)), max_size=300))
def test_whatever_comes_a_set_is_within_tolerance_and_queues_stay_short(events: list[tuple[str, float]]) -> None:
    pairing: Pairing[float] = Pairing(tuple("abcd"), tolerance=0.05)
    sets = []
    for i, (name, jitter) in enumerate([*events, *[(name, 0.0) for name in "abcd"]]):  # ends with a set, whatever came
        stamp = (0.01 * i if i < len(events) else 10.0) + jitter
        sets.append(pairing.add(name, stamp, stamp))
        assert max(len(q) for q in pairing._queues.values()) <= 4
    complete = [s for s in sets if s is not None]
    assert complete[-1] == (10.0, dict.fromkeys("abcd", 10.0))
    for oldest, items in complete:
        assert set(items) == set("abcd")
        assert max(items.values()) - min(items.values()) <= 0.05
        assert oldest == min(items.values())


def test_the_skew_of_the_last_set_is_told() -> None:
    pairing = Pairing[str](("left", "right"), 0.012)
    pairing.add("left", 1.0, "a")
    assert pairing.add("right", 1.011, "b") is not None
    assert abs(pairing.skew - 0.011) < 1e-9
    pairing.add("left", 2.0, "c")
    assert pairing.add("right", 2.02, "d") is None  # too far apart to be one moment
    assert abs(pairing.skew - 0.011) < 1e-9


def test_a_skew_up_to_the_bound_pairs_and_is_told() -> None:
    pairing = Pairing[int](("left", "right"), 0.025)
    for i in range(20):
        assert pairing.add("left", i / 15.0, i) is None
        done = pairing.add("right", i / 15.0 + 0.022, i)
        assert done is not None
        assert done[1] == {"left": i, "right": i}
        assert abs(pairing.skew - 0.022) < 1e-9
    assert pairing.unpaired == 0


def test_a_tolerance_beyond_the_period_pairs_the_nearest_after_a_loss() -> None:
    pairing = Pairing[int](("left", "right"), 0.025)
    sets = []
    for i in range(60):
        for name, ahead in (("left", 0.0), ("right", 0.004)):
            if (name, i) not in (("left", 10), ("right", 31)):
                sets.append(pairing.add(name, i * PERIOD + ahead, i))
    pairs = [done[1] for done in sets if done is not None]
    assert [p["left"] for p in pairs] == [i for i in range(60) if i not in (10, 31)]
    assert all(p["left"] == p["right"] for p in pairs)
    assert abs(pairing.skew - 0.004) < 1e-9


def test_sets_that_never_came_are_counted_by_the_gaps_between_those_that_did() -> None:
    pairing = Pairing[int](("left", "right"), tolerance=0.01)
    lost = {40, 41, 60, 90}
    for i in range(120):
        stamp = i / 45.0 + (0.003 if i % 3 else 0.0)  # a camera that is uneven
        if i not in lost:
            pairing.add("left", stamp, i)
        if i not in lost - {90} and i != 75:  # of one the left image, of one the right one
            pairing.add("right", stamp, i)
    assert pairing.missing == len(lost) + 1


def test_a_stream_that_pauses_or_becomes_slower_has_lost_nothing_for_long() -> None:
    pairing = Pairing[int](("one",), tolerance=0.01)
    for i in range(100):
        pairing.add("one", i / 45.0, i)
    for i in range(100):
        pairing.add("one", 60.0 + i / 45.0, i)  # a pause of a minute
    assert pairing.missing == 0
    for i in range(200):
        pairing.add("one", 70.0 + i / 22.5, i)
    assert 0 < pairing.missing < 40

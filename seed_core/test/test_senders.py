# SPDX-License-Identifier: Apache-2.0
"""Two senders of one topic are told by the numbers of their messages."""

from itertools import pairwise
from random import Random

import pytest

from seed_core.arm.senders import UNTOLD, Senders


def told(messages: list[tuple[float, int | None]]) -> list[float]:
    """When several senders are told of, of messages (time [s], number)."""
    senders = Senders()
    return [at for at, number in messages if senders.several(number, at)]


def stream(rate: float, start: float, seconds: float, first: int = 1) -> list[tuple[float, int]]:
    return [(start + i / rate, first + i) for i in range(round(seconds * rate))]


@pytest.mark.parametrize("first", [1, 7, 100_000])
@pytest.mark.parametrize("rate", [2.0, 20.0, 50.0, 100.0, 500.0])
def test_two_at_once_are_told_of_with_the_second_message_of_the_slower(rate: float, first: int) -> None:
    alone = stream(100.0, 0.0, 1.0, first)
    mixed = sorted(alone + stream(100.0, 1.0, 2.0, first + 100) + stream(rate, 1.003, 2.0))
    found = told(mixed)
    assert 1.0 < found[0] < 1.003 + 1.0 / rate + 0.021
    assert max(b - a for a, b in pairwise([*found, 3.0])) < 0.2  # and all the time


def test_one_alone_never_is_whatever_is_lost_and_however_late() -> None:
    rng, at, number, messages = Random(1), 0.0, 0, []
    for _ in range(5000):
        at, number = at + rng.choice((0.0, 0.002, 0.01, 0.3)), number + rng.choice((1, 1, 2, 50))
        messages.append((at, number))
    assert told(messages) == []


def test_one_that_takes_over_is_none_too_many() -> None:
    assert told(stream(100.0, 0.0, 1.0) + stream(50.0, 1.0, 2.0)) == []
    assert told(stream(100.0, 0.0, 1.0) + stream(50.0, 1.0, 2.0) + stream(100.0, 3.1, 1.0)) == []


def test_it_ends_half_a_second_after_the_second_has() -> None:
    mixed = sorted(stream(100.0, 0.0, 3.0) + stream(100.0, 1.003, 1.0))
    assert told(mixed)[-1] == pytest.approx(2.5, abs=0.02)


@pytest.mark.parametrize("number", [None, UNTOLD])
def test_a_middleware_that_does_not_number_messages_tells_nothing(number: int | None) -> None:
    assert told([(0.01 * i, number) for i in range(500)]) == []

# SPDX-License-Identifier: Apache-2.0
"""How far the clock of the estimator's computer is from the controller's, by questions and answers over the network.

A question carries the time of its sending, the answer that and the estimator's own time. Half way between sending and
arrival the two clocks are compared, which is wrong by half the way there and back at most; of the newest answers that
with the shortest way counts (the clock filter of RFC 5905, network time).
"""

from collections import deque
from dataclasses import dataclass

from seed_core.config import field

LASTS = 5.0  # [s] for which an answer counts
LEAST = 3  # answers before anything is said
LONGEST = 1.0  # [s] there and back, after which an answer is worth nothing


@dataclass(frozen=True)
class SkewSettings:
    """What is asked, and how much may come out."""

    rate: float = field(5.0, unit="Hz", low=0.0, high=50.0, doc="of questions to the estimator's clock; 0: none")
    max_skew: float = field(
        0.01, unit="s", low=0.001, high=0.1, doc="of the estimator's clock against this one; more is refused and held"
    )


class ClockSkew:
    """Feed it answers; `problem` is why no estimate may be used, `doubt` what to tell."""

    def __init__(self, bound: float) -> None:
        """bound: [s] that the two clocks may differ by."""
        self._bound = bound
        self._answers: deque[tuple[float, float, float]] = deque()  # arrival, way there and back, offset [s]

    def add(self, asked: float, answered: float, now: float) -> bool:
        """An answer that arrives now, to a question asked then, both [s] of this clock; answered: [s] of the other.

        Returns:
            False when it is of no use: it took too long, or this clock was set back meanwhile.
        """
        way = now - asked
        if not 0.0 <= way <= LONGEST:
            return False
        if self._answers and now < self._answers[-1][0]:
            self._answers.clear()
        self._answers.append((now, way, answered - 0.5 * (asked + now)))
        return True

    def look(self, now: float) -> None:
        """Forget what is old at now [s]."""
        while self._answers and not now - LASTS <= self._answers[0][0] <= now:
            self._answers.popleft()

    @property
    def known(self) -> bool:
        """Whether enough answers have come."""
        return len(self._answers) >= LEAST

    @property
    def pending(self) -> str:
        """That answers come, but not enough of them yet; '' otherwise."""
        if self.known or not self._answers:
            return ""
        return f"the estimator's clock is not compared yet ({len(self._answers)} of {LEAST} answers): ask again"

    @property
    def offset(self) -> float:
        """By which the estimator's clock is ahead [s]; known: only then."""
        return min(self._answers, key=lambda a: a[1])[2]

    @property
    def within(self) -> float:
        """By which the offset is wrong at most [s]; known: only then."""
        return 0.5 * min(way for _, way, _ in self._answers)

    @property
    def problem(self) -> str:
        """Why the estimates cannot be used; '' if they can, or if nothing is known."""
        if not self.known or abs(self.offset) <= max(self._bound, self.within):
            return ""
        side = "ahead of" if self.offset > 0.0 else "behind"
        return (
            f"the clock of the estimator's computer is {1e3 * abs(self.offset):.1f} +- {1e3 * self.within:.1f} ms "
            f"{side} the controller's, more than clock.max_skew = {1e3 * self._bound:g} ms: synchronise the two "
            "(chrony, PTP)"
        )

    @property
    def doubt(self) -> str:
        """What the network does not let us know; '' for nothing."""
        if not self.known or self.problem or self.within <= self._bound:
            return ""
        return (
            f"the estimator's clock is known to {1e3 * self.within:.1f} ms only, worse than clock.max_skew = "
            f"{1e3 * self._bound:g} ms: the network is slow"
        )

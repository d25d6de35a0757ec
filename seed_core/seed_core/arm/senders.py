# SPDX-License-Identifier: Apache-2.0
"""Whether the targets of an arm come from one sender, or from several at once: each numbers its own messages."""

from math import inf

UNTOLD = 2**64 - 1  # of a middleware that does not number them
WITHIN = 2.0  # [s] of two steps back: one alone is a sender that takes over from another
LASTING = 0.5  # [s] after the newest


class Senders:
    """Takes the number of every message of a topic, as its sender counts; one sender's numbers only rise."""

    def __init__(self) -> None:
        self._last = 0
        self._back = self._before = -inf  # [s] when a number was not above the last: newest, and the one before

    def several(self, number: int | None, now: float) -> bool:
        """Whether more than one sends, as of this message.

        Args:
            number: of the message; None where it is not told, which tells nothing.
            now: time of a steady clock [s].
        """
        if number is None or number >= UNTOLD:
            return False
        if number <= self._last:
            self._before, self._back = self._back, now
        self._last = number
        return self._back - self._before <= WITHIN and now - self._back <= LASTING

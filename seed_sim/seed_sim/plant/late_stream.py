# SPDX-License-Identifier: Apache-2.0
"""A stream of messages that simulated time waits for when it is late."""

from math import inf

LONGEST = 2.0  # [s] of waiting, unless said otherwise, after which the stream counts as ended until heard again
LOST = 1.0  # [s] of waiting, after which time goes on by one period: the message itself may have been lost
PERIODS = 1.6  # [periods] of the stream that are waited for at least, however little patience there is
PAUSE = 1.0  # [s] a longer gap tells nothing about the period


class LateStream:
    """`hear` each message; while it is `late`, time should stand still."""

    def __init__(self, patience: float, longest: float = LONGEST) -> None:
        """patience: age of the newest message [s] from which the next is waited for, up to `longest` [s]."""
        self._patience, self._longest = patience, longest
        self._newest = -inf
        self._period = 0.0  # [s] smoothed; 0: not known yet
        self._since = inf  # steady time at which waiting began

    def hear(self, stamp: float) -> None:
        """A message of this (simulated) time [s] has come."""
        gap = stamp - self._newest
        if 0.0 < gap < PAUSE:
            self._period = 0.9 * self._period + 0.1 * gap if self._period else gap
        self._newest, self._since = stamp, inf

    @property
    def runs(self) -> bool:
        """Whether there are messages, as far as one knows."""
        return self._newest != -inf

    def late(self, now: float, steady: float) -> bool:
        """Whether to wait, at a simulated time `now` and by a steady clock [s]."""
        age = now - self._newest
        limit = max(self._patience, PERIODS * self._period)
        if not self.runs or age <= limit:
            return False
        self._since = min(self._since, steady)
        waited = steady - self._since
        if waited > self._longest:
            self._newest = -inf
            return False
        return waited < LOST or age > limit + self._period

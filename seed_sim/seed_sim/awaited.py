# SPDX-License-Identifier: Apache-2.0
"""A stream of messages that simulated time waits for when it is late."""

from __future__ import annotations

from math import inf

LONGEST = 2.0  # [s] of waiting, after which the stream counts as ended until it is heard again


class Awaited:
    """`hear` each message; while it is `late`, time should stand still."""

    def __init__(self, patience: float) -> None:
        """patience: age of the newest message [s] from which the next is waited for."""
        self._patience = patience
        self._newest = -inf
        self._since = inf  # steady time at which waiting began

    def hear(self, stamp: float) -> None:
        """A message of this (simulated) time [s] has come."""
        self._newest, self._since = stamp, inf

    def late(self, now: float, steady: float) -> bool:
        """Whether to wait, at a simulated time `now` and by a steady clock [s]."""
        if self._newest == -inf or now - self._newest <= self._patience:
            return False
        self._since = min(self._since, steady)
        if steady - self._since > LONGEST:
            self._newest = -inf
        return self._newest != -inf

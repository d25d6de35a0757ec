# SPDX-License-Identifier: Apache-2.0
"""When a stream that has a rate of its own is due, by the plant's time."""

_EARLY = 1e-6  # [s] by which a tick on the period may be short of it


class Every:
    """A period of the plant's time, whatever the rate of the ticks, and also after that time has gone back."""

    def __init__(self, period: float) -> None:
        """period: [s]; due for the first time at 0 s."""
        self._period, self._next = period, 0.0

    def due(self, t: float) -> bool:
        """Whether to publish at time t [s]; asked once per tick."""
        ahead = self._next - t
        if _EARLY < ahead <= self._period:
            return False
        on_grid = -self._period < ahead <= _EARLY
        self._next = (self._next if on_grid else t) + self._period
        return True

# SPDX-License-Identifier: Apache-2.0
"""A line on stderr while a long run goes on."""

import sys
import time


class Progress:
    """Name, share and phase of a run on a terminal, nothing elsewhere; `done` tells how long it took."""

    def __init__(self, name: str) -> None:
        self._name, self._began, self._last = name, time.monotonic(), 0.0

    def __call__(self, share: float, phase: str = "") -> None:
        now = time.monotonic()
        if sys.stderr.isatty() and (now - self._last > 0.2 or share >= 1.0):
            self._last = now
            end = "" if share < 1.0 else "\r"
            print(f"\r{self._name}: {100 * share:3.0f} %  {phase:30s}", end=end, file=sys.stderr, flush=True)

    def done(self) -> None:
        """End the line."""
        took = time.monotonic() - self._began
        print(f"{self._name}: done in {took:.0f} s{' ' * 30}", file=sys.stderr, flush=True)

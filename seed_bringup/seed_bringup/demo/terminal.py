# SPDX-License-Identifier: Apache-2.0
"""Progress of the demo and of ./seed play on the terminal."""

import math
import sys

WIDTH = 24  # characters of the bar


def say(text: str) -> None:
    """One line of progress."""
    print(f"seed demo: {text}", flush=True)


def done_in(duration: float, force_rmse: float) -> str:
    """How a task went, that took duration [s]; force_rmse [N]: not a number where it controlled no force."""
    force = "" if math.isnan(force_rmse) else f"; estimated force within {force_rmse:.2f} N rms of what was wanted"
    return f"done in {duration:.1f} s{force}"


class Bar:
    """Phase, progress and force on one line of the terminal; where there is none, a line as each phase begins.

    Such a line has the force of that moment: a lift begins while the tool still presses. So the last phase has a line
    for its end, too.
    """

    def __init__(self) -> None:
        self._live = sys.stdout.isatty()
        self._phase = self._newest = ""

    def show(self, phase: str, progress: float, force: float) -> None:
        """Progress from 0 to 1, and the estimated pressing force [N]."""
        text = f"{phase:<17} {100 * progress:3.0f} %   estimated force {force:6.2f} N"
        if self._live:
            done = round(WIDTH * progress)
            print(f"\r  [{'#' * done}{'.' * (WIDTH - done)}] {text}  ", end="", flush=True)
        elif phase != self._phase:
            print(f"  {text} as it begins", flush=True)
        self._phase, self._newest = phase, text

    def close(self) -> None:
        """End the line."""
        if self._live:
            print(flush=True)
        elif self._newest:
            print(f"  {self._newest} as it ends", flush=True)
        self._newest = ""

# SPDX-License-Identifier: Apache-2.0
"""A pattern under a press, until the tip drops below the plate or a rim is felt.

The spiral is Archimedes', so that no place is further than half its pitch from the path: S. R. Chhatpar,
M. S. Branicky, "Search strategies for peg-in-hole assemblies with position uncertainty", IROS 2001.
"""

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState
from seed_control.tasks.insertion.plate import PlateUnderTip
from seed_control.tasks.insertion.sections import Search
from seed_control.tasks.path import Path, Spiral
from seed_control.tasks.steps import Ending, Step, StepRun, TipImages
from seed_core.spatial import Array, length, make_pose, so3_exp

_TOGETHER = 1.15  # shares of `drop` and `rim` that add up to a hole: what has caught in its mouth shows some of both
_AGAIN = 0.5  # [s] at the end of the pattern, for what the last images tell
_ROUNDS = 2  # of tilting all around
_ROCKING = 0.2  # [rad/s] of the tip's axis


class SearchRun(StepRun):
    """A search being played.

    Attributes:
        plate: height [m] of the plate where the tip was last, in the work frame.
        found: the tip has dropped, or met a rim.
    """

    def __init__(
        self, step: Step, start: Array, R_start: Array, R_end: Array, X_W: Array, before: StepRun | None = None
    ) -> None:
        """As a `StepRun`, from the tip's place `start` (3,) in the work frame; before: the run that has ended."""
        search = step.phase.search
        assert search is not None
        self._search: Search = search
        pace = step.phase.speed, step.phase.acceleration
        if search.pattern == "spiral":
            path: Path = Spiral(start, search.radius, search.pitch, *pace)
        else:
            path = Path([start, start + search.along] if search.pattern == "line" else [start], *pace)
        super().__init__(step, path, R_start, R_end, X_W)
        self._surface = PlateUnderTip(search.drop)
        self._images = TipImages(X_W)  # beside those of the path
        self._at_rest: Array | None = None  # (2,) [N] sideways as it began
        self._rounds = _ROUNDS * 2.0 * np.pi * np.deg2rad(search.angle) / _ROCKING  # [s] of tilting
        if search.pattern == "tilt":
            self.duration = max(self.duration, self._rounds)
        self.plate, self.found, self._touched = -search.within, False, False
        if isinstance(before, SearchRun) and before.found:
            self.plate, self.found = before.plate, True

    def advance(self, dt: float, state: ControllerState) -> Ending:
        ended = super().advance(dt, state)
        if self.finish or self.found:
            return "done"
        self._touched = self._touched or state.in_contact
        if (X := self._images.new(state)) is not None:
            self._look(X[:3, 3])
        if self.found or self._feels_hole(state):
            self.found = True
            return "done"
        if self._search.pattern == "here":
            return ended
        if self._t < self.duration + _AGAIN:
            return ""
        self.why = (
            f"phase '{self.step.phase.name}': no hole found: over the whole {self._search.pattern} the tip has not "
            f"dropped by {1e3 * self._search.drop:g} mm, nor met {self._search.rim:g} N sideways: check that the hole "
            "is there and where the work frame is, or search further"
        )
        return "failed"

    def _look(self, tip: Array) -> None:
        """Take in the tip's place (3,) of a new image."""
        if self._touched:
            self._surface.image(tip)
            self.plate = self._surface.height(tip)
        if tip[2] < -self._search.within - self._search.drop:  # below any plate: it went straight into the hole
            self.plate, self.found = max(self.plate, -self._search.within), True

    def _feels_hole(self, state: ControllerState) -> bool:
        """The tip has dropped, or met a rim, or a good half of each."""
        dropped, met = self._surface.dropped / self._search.drop, self._sideways(state) / self._search.rim
        return max(dropped, met) > 1.0 or dropped + met > _TOGETHER

    def _sideways(self, state: ControllerState) -> float:
        """[N] across the press, less what there was as it began."""
        if state.filtered is None or not self._touched:
            return 0.0
        across = self._images.to_work[:2, :3] @ state.R_W_task @ state.filtered.force
        if self._at_rest is None:
            self._at_rest = across
        off = across - self._at_rest
        return length(off)

    def setpoint(self) -> HybridSetpoint:
        if self._search.pattern != "tilt":
            return super().setpoint()
        share = min(self._t / self._rounds, 1.0)
        angle = np.deg2rad(self._search.angle) * min(8.0 * share, 1.0, 8.0 * (1.0 - share))
        turn = 2.0 * np.pi * _ROUNDS * share
        R = self.R_end @ so3_exp(angle * np.array((np.cos(turn), np.sin(turn), 0.0)))
        return self._first.moved(self._X_W @ make_pose(R, self.position), self._X_W[:3, :3] @ self.velocity)

# SPDX-License-Identifier: Apache-2.0
"""The step `contact_stop`: go until something is touched, or over a surface until it falls away, and tell where."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from seed_control.state import ControllerState
from seed_control.tasks.path import Path
from seed_control.tasks.steps import Ending, Step, StepRun
from seed_control.tasks.task import Control
from seed_core.spatial import Array

_ENOUGH = 12  # images that a place is the mean of
_LEAST = 5e-5  # [m] deviation of a place, however well its images agree
_FIRST = 20  # images on a surface before its end is looked for
_LATELY = 3  # images that a fall is the mean of
_DEEPEST = 0.05  # [m] to a surface whose edge is looked for: `reach` is along it
_ON = 0.25  # share of the drop within which an image is still on the surface


class FoundPlace(NamedTuple):
    """Where something was touched.

    Attributes:
        name: of the phase. X_W_tip: (4, 4) of the tip there. deviation: (3,) of its place [m], in W.
        towards: (3,) the way on which it was found, in W.
    """

    name: str
    X_W_tip: Array
    deviation: Array
    towards: Array

    def __str__(self) -> str:
        x, y, z = self.X_W_tip[:3, 3]
        return f"{self.name} at ({x:.4f}, {y:.4f}, {z:.4f}) m, +-{1e3 * float(self.deviation.max()):.1f} mm"


@dataclass
class _Image:
    """The tip at one image, in the work frame."""

    X: Array
    way: float
    height: float


class StopRun(StepRun):
    """Walks with a small force along an axis of the work frame until there is contact, then waits until it is sure.

    With `edge` it goes on over the surface, still pressing, until the tip falls below the line of its heights so far.
    """

    def __init__(self, step: Step, start: Array, R_start: Array, R_end: Array, X_W: Array) -> None:
        """From the tip's place start (3,) [m], turning from R_start (3, 3) to R_end, in work frame X_W (4, 4)."""
        stop = step.phase.contact_stop
        assert stop is not None
        way, edge = axis(stop.towards), axis(stop.edge) if stop.edge else np.zeros(3)
        x, y, z = (stop.force * way).tolist()
        speed = min(step.phase.speed, 0.1)
        control = Control((x, y, z), force_directions=(stop.towards[-1],), approach_speed=speed)
        points = [start, start + stop.reach * edge]
        path = Path(np.array(points), step.phase.speed, step.phase.acceleration)
        pressing = replace(step.phase, control=control, contact_stop=None)
        super().__init__(replace(step, phase=pressing), path, R_start, R_end, X_W)
        self._stop, self._way, self._edge, self._start = stop, way, edge, start
        self._going = 0.0  # [s] along the surface
        self._images: list[_Image] = []
        self.found: FoundPlace | None = None

    def advance(self, dt: float, state: ControllerState) -> Ending:
        self._t += dt
        X = self._tips.new(state)
        if self.finish or self.found is not None:
            return "done"
        sliding = bool(self._stop.edge) and len(self._images) >= _ENOUGH
        if state.settled or sliding:
            if sliding:
                self._going += dt
            if X is not None:
                self._look(X)
        self.position, self.velocity = self.path.at(self._going)
        if dt == 0.0 or not sliding:
            self.velocity = np.zeros(3)
        return "failed" if self._gone_too_far(state) else ""

    def _look(self, X: Array) -> None:
        """One image of a tip that touches, at X (4, 4) in the work frame."""
        self._images.append(_Image(X, float(self._edge @ X[:3, 3]), -float(self._way @ X[:3, 3])))
        n = len(self._images)
        if not self._stop.edge and n >= _ENOUGH:
            self._tell(self._images)
        elif self._stop.edge and n > _FIRST + _ENOUGH:
            self._look_for_the_end()

    def _look_for_the_end(self) -> None:
        before, lately = self._images[: -2 * _LATELY], self._images[-_LATELY:]
        slope, height = np.polyfit([i.way for i in before], [i.height for i in before], 1)
        below = [slope * i.way + height - i.height for i in self._images]
        if float(np.mean(below[-_LATELY:])) < self._stop.drop or min(i.way for i in lately) < before[0].way:
            return
        last = max((k for k, b in enumerate(below) if b < _ON * self._stop.drop), default=0)
        self._tell(self._images[max(last - 1, 0) : last + 2])

    def _tell(self, images: list[_Image]) -> None:
        places = np.array([self._X_W[:3, :3] @ i.X[:3, 3] for i in images])
        spread = places.std(axis=0, ddof=1) / np.sqrt(len(images))
        if self._stop.edge:  # it is passed between two images, and the tip rolls over it
            spread = np.sqrt(spread**2 + (self._X_W[:3, :3] @ self._edge * self._stop.drop) ** 2)
        X = self._X_W @ images[len(images) // 2].X
        X[:3, 3] = places.mean(axis=0) + self._X_W[:3, 3]
        towards = self._X_W[:3, :3] @ (self._edge if self._stop.edge else self._way)
        self.found = FoundPlace(self.step.phase.name, X, np.maximum(spread, _LEAST), towards)

    def _gone_too_far(self, state: ControllerState) -> bool:
        """Whether nothing was found within reach; `why` says so."""
        phase, stop = self.step.phase, self._stop
        if stop.edge and self._going > self.path.duration:
            self.why = (
                f"phase '{phase.name}' found no edge within reach = {stop.reach:g} m along {stop.edge}: let it begin "
                "nearer or reach further"
            )
        if state.X_W_tip is not None and not self._images:
            gone = float(self._way @ ((self._tips.to_work @ state.X_W_tip)[:3, 3] - self._start))
            remedy = "begin nearer" if stop.edge else "begin nearer or reach further"
            most = _DEEPEST if stop.edge else stop.reach
            if gone > most:
                self.why = f"phase '{phase.name}' found nothing within {most:g} m along {stop.towards}: let it {remedy}"
        way = max(stop.reach, _DEEPEST) if stop.edge else stop.reach
        if not self.why and self._t > phase.timeout + self.path.duration + way / phase.speed:
            self.why = f"phase '{phase.name}' touched nothing steadily within {phase.timeout:g} s"
        return bool(self.why)


def axis(name: str) -> Array:
    """(3,) of '-z' and the like."""
    out = np.zeros(3)
    out["xyz".index(name[-1])] = -1.0 if name[0] == "-" else 1.0
    return out

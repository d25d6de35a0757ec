# SPDX-License-Identifier: Apache-2.0
"""A task as the list of steps that the player runs: phases as they stand, drawings as strokes."""

from __future__ import annotations

from dataclasses import dataclass

from seed_control.tasks.font import strokes_of_text
from seed_control.tasks.task import Control, Drawing, Phase, Task, Vector

Point = tuple[float, float]


@dataclass(frozen=True)
class Step:
    """A phase with the points of its path in the work frame, each (x, y, z) [m]; empty: stay."""

    phase: Phase
    points: tuple[Vector, ...] = ()


def steps_of(task: Task) -> list[Step]:
    """All steps of the task, in order."""
    steps = [Step(p, (p.to,) if p.to else ()) for p in task.phases]
    if task.draw is None:
        return steps
    return [*steps[:-1], *_drawing(task.draw), steps[-1]]


def strokes_of(drawing: Drawing) -> list[list[Point]]:
    """Polylines (x, y) [m] in the work frame."""
    if drawing.text:
        return strokes_of_text(drawing.text, drawing.height, drawing.origin, drawing.font)
    ox, oy = drawing.origin
    return [[(x + ox, y + oy) for x, y in s] for s in drawing.strokes]


def _drawing(drawing: Drawing) -> list[Step]:
    strokes = strokes_of(drawing)
    forces = drawing.forces or (None,) * len(strokes)
    out: list[Step] = []
    for number, (stroke, force) in enumerate(zip(strokes, forces, strict=True), start=1):
        control = drawing.control.scaled_to(force) if force else drawing.control
        out += _stroke(drawing, control, stroke, f"stroke {number}/{len(strokes)}")
    return out


def _stroke(drawing: Drawing, control: Control, stroke: list[Point], name: str) -> list[Step]:
    up, speed = drawing.clearance, drawing.travel_speed
    (x0, y0), (x1, y1) = stroke[0], stroke[-1]
    over, raised = (x0, y0, up), (x1, y1, up)
    line: tuple[Vector, ...] = tuple((x, y, 0.0) for x, y in stroke)
    return [
        Step(Phase(f"{name} over", over, speed=speed), (over,)),
        Step(Phase(f"{name} touch", control=control, until="settled", dwell=0.15)),
        Step(Phase(f"{name} draw", line[-1], speed=drawing.speed, control=control), line),
        Step(Phase(f"{name} raise", raised, speed=speed), (raised,)),
    ]

# SPDX-License-Identifier: Apache-2.0
"""What is shown: bent paths with one or two forces, played by the controller or led by a hand, drawn from a seed."""

from dataclasses import dataclass

import numpy as np

from seed_control.tasks import Task
from seed_control.tasks.task import Control, Phase, WorkFrame
from seed_control.teach import TeachSettings
from seed_core.spatial import Array

TOOLS = {"squeegee": "nominal", "pen": "pen"}  # with their scenarios
KINDS = tuple(f"{how} {tool}" for how in ("played", "led") for tool in TOOLS)


@dataclass(frozen=True, eq=False)
class DrawnDemonstration:
    """One demonstration.

    Attributes:
        path: (n, 2) [m] of the tip in the work frame. forces: (n,) [N] at each point. speed: [m/s].
    """

    kind: str
    seed: int
    path: Array
    forces: Array
    speed: float

    @property
    def tool(self) -> str:
        """That is held."""
        return self.kind.split()[1]

    @property
    def settings(self) -> TeachSettings:
        """With which it is taught: a blade along y lies down by itself."""
        return TeachSettings(resists=("x",) if self.tool == "squeegee" else ())

    def task(self) -> Task:
        """That plays it."""
        resists = self.settings.resists
        phases = [Phase("approach", _on(self.path[0], 0.015), speed=0.1)]
        parts = np.split(np.arange(len(self.path)), np.flatnonzero(np.diff(self.forces)) + 1)
        for number, part in enumerate(parts, start=1):
            control = Control((0.0, 0.0, -float(self.forces[part[0]])), torque_axes=resists, contact_resists=resists)
            begin = self.path[part[0]]
            phases.append(
                Phase(f"press {number}", _on(begin), speed=0.015, control=control, until="settled", dwell=0.15)
            )
            way = tuple(_on(p) for p in self.path[part[1:]])
            phases.append(Phase(f"wipe {number}", way[-1], through=way[:-1], speed=self.speed, control=control))
        phases.append(Phase("lift", _on(self.path[-1], 0.04), speed=0.03))
        frame = WorkFrame((0.45, 0.0, 0.0), (0.0, 0.0, 0.0))
        return Task(name="shown", tool=self.tool, frame=frame, tip_rpy=(180.0, 0.0, 0.0), phases=tuple(phases))


def _on(p: Array, height: float = 0.0) -> tuple[float, float, float]:
    return round(float(p[0]), 6), round(float(p[1]), 6), height


def draw(seed: int) -> DrawnDemonstration:
    """A demonstration; KINDS take turns: 0.1 to 0.2 m along x, aside by a bow and a corner, at 20 to 50 mm/s."""
    kind = KINDS[seed % len(KINDS)]
    rng = np.random.default_rng((seed, 0x7EAC))
    length, bow, corner = rng.uniform(0.1, 0.2), rng.uniform(-0.02, 0.02), rng.uniform(-0.4, 0.4)
    x = np.linspace(0.0, length, 41)
    y = bow * np.sin(np.pi * x / (0.6 * length)) * (x < 0.6 * length) + corner * np.maximum(x - 0.6 * length, 0.0)
    pen = kind.endswith("pen")
    first, second = rng.uniform(1.0, 3.0, 2) if pen else rng.uniform(5.0, 10.0, 2)
    forces = np.full(len(x), first)
    if rng.uniform() < 0.5:
        forces[x > 0.6 * length] = second
    return DrawnDemonstration(kind, seed, np.column_stack((x, y)), forces, float(rng.uniform(0.02, 0.05)))

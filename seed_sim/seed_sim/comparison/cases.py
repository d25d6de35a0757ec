# SPDX-License-Identifier: Apache-2.0
"""The scenarios of the comparison: plant, task and what is scored. Every method meets the same ones."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seed_control.tasks.task import Control, Phase, Task, WorkFrame
from seed_core.config import field
from seed_sim.comparison.bumps import Bumps
from seed_sim.scenario import Scenario, TableSection, load_scenario

NONE = Bumps()
FRAME = WorkFrame(position=(0.45, 0.0, 0.0))
REACH = 0.01  # [m] above the nominal table, from where force is wanted
SWING_RATE = 0.5  # [Hz]
PRESSING = 2.0  # [s] from there: approach, contact and coming to rest, the same for every method


@dataclass(frozen=True)
class Case:
    """One scenario.

    Attributes:
        name, says: what it is, in a word and in a sentence.
        force: [N] wanted. speed: [m/s] and way: [m] of the wipe.
        base: name of the shipped scenario. table: what is different about its table. servo: about its arm.
        bumps: on the table. swing: [m] amplitude of a table that moves at SWING_RATE.
        total_stiffness: range [N/m] from which the table's is drawn, evenly in its logarithm.
        steps: [N] further forces, each held for a while, instead of a wipe.
        bladed: the tool is a blade, whose torque along it is to vanish.
    """

    name: str
    says: str
    force: float = 10.0
    speed: float = 0.05
    way: float = 0.1
    base: str = "nominal"
    table: dict[str, Any] = field({}, doc="changes")
    servo: dict[str, Any] = field({}, doc="changes")
    bumps: Bumps = NONE
    swing: float = 0.0
    total_stiffness: tuple[float, float] | None = None
    steps: tuple[float, ...] = ()
    bladed: bool = True

    def scenario(self, seed: int) -> Scenario:
        """The plant of one seed."""
        base = load_scenario(self.base)
        table: TableSection = replace(base.table, **self.table)
        if self.total_stiffness is not None:
            low, high = np.log(self.total_stiffness)
            drawn = float(np.exp(np.random.default_rng([seed, 0xCA]).uniform(low, high)))
            table = replace(table, total_stiffness=drawn)
        return replace(base, table=table, servo=replace(base.servo, **self.servo))

    def task(self) -> Task:
        """Approach, press, then wipe or change the force, then lift."""
        control = Control(
            force=(0.0, 0.0, -self.force),
            torque_axes=("x",) if self.bladed else (),
            contact_resists=("x",) if self.bladed else (),
            approach_speed=0.03,
        )
        start = (0.0, 0.0, 0.0)
        phases = [
            Phase("approach", (0.0, 0.0, REACH), speed=0.1),
            Phase("press", start, speed=0.03, control=control, dwell=PRESSING),
        ]
        if self.steps:
            phases += [
                Phase(f"step {i} to {f:g} N", control=control.scaled_to(f), until="arrived", dwell=1.5)
                for i, f in enumerate(self.steps, start=1)
            ]
            end = start
        else:
            end = (self.way, 0.0, 0.0)
            phases.append(Phase("wipe", end, speed=self.speed, acceleration=0.2, control=control))
        phases.append(Phase("lift", (end[0], 0.0, 0.02), speed=0.05))
        tool = load_scenario(self.base).tool.name
        return Task(name=self.name, tool=tool, frame=FRAME, phases=tuple(phases))


CASES = (
    Case("nominal", "a blade on a table tilted up to 2 degrees and off by up to 3 mm; 10 N, 50 mm/s"),
    Case("hard table", "200 kN/m under the blade", table={"total_stiffness": 2e5}),
    Case("unknown stiffness", "300 N/m to 100 kN/m, drawn for each run", total_stiffness=(300.0, 1e5)),
    Case("bumps", "bumps of 1 mm, 15 mm long, every 30 mm", bumps=Bumps(1e-3)),
    Case("moving table", "up and down by 2 mm at 0.5 Hz", swing=2e-3),
    Case("steep and fast", "tilted 4 to 8 degrees along the way, 100 mm/s", speed=0.1, table={"tilt_y": (4.0, 8.0)}),
    Case(
        "cylinder",
        "a rounded tip along a cylinder of 80 to 500 mm, 5 N, 30 mm/s",
        force=5.0,
        speed=0.03,
        way=0.05,
        base="cylinder",
        bladed=False,
    ),
    Case("force steps", "10, 5, 10, 5 N, standing", steps=(5.0, 10.0, 5.0)),
    Case("pen", "a pen, 2 N, 30 mm/s", force=2.0, speed=0.03, way=0.06, base="pen", bladed=False),
    Case(
        "polishing",
        "15 N along a plate, friction 0.6, with the kinematics of a UR10e",
        force=15.0,
        base="ur10e",
        table={"friction": 0.6},
    ),
)
QUICK = ("nominal", "force steps", "pen")


def case_named(name: str) -> Case:
    """The case of that name; KeyError for none."""
    return {c.name: c for c in CASES}[name]

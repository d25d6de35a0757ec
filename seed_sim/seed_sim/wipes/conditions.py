# SPDX-License-Identifier: Apache-2.0
"""What a wipe is scored under: each condition is the squeegee's task and `nominal` cell but for one thing."""

from dataclasses import dataclass, replace

import numpy as np

from seed_control.tasks import Task, load_task
from seed_core.bushing import Stiffness
from seed_sim.scenario import Scenario, load_scenario

Leg = tuple[float, float, float]  # to x [m], at [m/s], with [m/s^2]
_OF_MEMBRANES = (0.93, 3.2, 0.52, 3400.0, 6300.0, 2040.0)  # [N m/rad, N/m] of a light grip, as a hidden draw had it
_WIPE: tuple[Leg, ...] = ((0.25, 0.05, 0.2),)


@dataclass(frozen=True)
class Condition:
    """One condition.

    Attributes:
        name: what it is called.
        drag: the blade is laid on in a drag of 15 mm, as the task has it; else it presses where it stands.
        legs: of the wipe.
        pitch: stiffness of the grasp about y [N m/rad], which the controller knows; None: the cell's, 3.
        correlated: [s] over which the poses' noise is correlated; 0: white.
        stated: the standard deviation that the poses state, over the true one.
        amplitude, frequency: [m], [Hz] of a table that moves up and down.
        friction: of the table; None: the cell's. stiffness: (6,) of the grasp [N m/rad, N/m], which the controller
            knows; empty: the cell's.
    """

    name: str
    drag: bool = True
    legs: tuple[Leg, ...] = _WIPE
    pitch: float | None = None
    correlated: float = 0.0
    stated: float = 1.0
    amplitude: float = 0.0
    frequency: float = 0.5
    friction: float | None = None
    stiffness: tuple[float, ...] = ()

    def task(self) -> Task:
        """The squeegee's task, with this wipe."""
        task = load_task("squeegee")
        approach, press, wipe, lift = task.phases
        if not self.drag:
            approach = replace(approach, to=(0.0, 0.0, 0.015))
            press = replace(press, to=None)
        names = ["wipe", *(f"wipe {i}" for i in range(2, len(self.legs) + 1))]
        legs = (
            replace(wipe, name=name, to=(x, 0.0, 0.0), speed=speed, acceleration=acceleration)
            for name, (x, speed, acceleration) in zip(names, self.legs, strict=True)
        )
        return replace(task, phases=(approach, press, *legs, lift))

    def scenario(self) -> Scenario:
        """The cell."""
        scenario = load_scenario("nominal")
        k = np.array(self.stiffness or scenario.grasp.stiffness.vector())
        k[1] = self.pitch or k[1]
        friction = scenario.table.friction if self.friction is None else self.friction
        return replace(
            scenario,
            grasp=replace(scenario.grasp, stiffness=Stiffness.from_vector(k)),
            table=replace(scenario.table, friction=friction),
        )


CONDITIONS = {
    c.name: c
    for c in (
        Condition("drag"),
        Condition("no drag", drag=False),
        Condition("step of speed", drag=False, legs=((0.25, 0.05, 5.0),)),
        Condition("slow ramp", drag=False, legs=((0.25, 0.05, 0.025),)),
        Condition("changing speed", legs=((0.08, 0.02, 5.0), (0.18, 0.08, 5.0), (0.25, 0.03, 5.0))),
        Condition("pitch 2", pitch=2.0),
        Condition("pitch 2, no drag", drag=False, pitch=2.0),
        Condition("noise over 0.3 s", correlated=0.3),
        Condition("noise over 1 s", correlated=1.0),
        Condition("noise over 3 s", correlated=3.0),
        Condition("stated x0.3", stated=0.3),
        Condition("stated x3", stated=3.0),
        Condition("table 1 mm", amplitude=1e-3),
        Condition("table 5 mm", amplitude=5e-3),
        Condition("rough table", friction=0.77, stiffness=_OF_MEMBRANES),
    )
}

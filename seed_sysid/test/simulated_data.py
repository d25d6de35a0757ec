# SPDX-License-Identifier: Apache-2.0
"""Data of a simulated identification without the motion between the poses and the settling."""

from collections.abc import Sequence

from seed_sim.identification.cell import SimulatedCell
from seed_sim.identification.scenario import IdentificationScenario
from seed_sim.identification.session import header
from seed_sysid.data.dataset import Dataset
from seed_sysid.run.excitation import designs
from seed_sysid.run.procedure import Command, average


def at_rest(scenario: IdentificationScenario, seed: int, anew: Sequence[str] = ()) -> tuple[Dataset, SimulatedCell]:
    """What a run of the scenario would measure, and the cell that knows the truth.

    anew: kinds of poses; before the first of each, at every grip, the tool is gripped anew.
    """
    cell = SimulatedCell(scenario, seed)
    p = scenario.procedure
    readings = max(1, round(p.settle.average * scenario.rate))
    samples, grasp = [], 0
    for grip, (width, targets) in enumerate(zip(p.widths, designs(p), strict=True)):
        to_come = set(anew)
        for target in targets:
            if target.kind in to_come:
                to_come.remove(target.kind)
                cell.grip_anew()
                grasp += 1
            command = Command(target.X_TC, width, grip, "measuring")
            samples.append(average(target, grip, cell.rest(command, readings), 1.0, False, grasp=grasp))
    return Dataset(header(scenario, seed, ""), samples), cell

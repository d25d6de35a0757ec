# SPDX-License-Identifier: Apache-2.0
"""Data of a simulated identification without the motion between the poses and the settling."""

from seed_sim.identification.cell import SimulatedCell
from seed_sim.identification.scenario import IdentificationScenario
from seed_sim.identification.session import header
from seed_sysid.data.dataset import Dataset
from seed_sysid.run.excitation import designs
from seed_sysid.run.procedure import Command, average


def at_rest(scenario: IdentificationScenario, seed: int) -> tuple[Dataset, SimulatedCell]:
    """What a run of the scenario would measure, and the cell that knows the truth."""
    cell = SimulatedCell(scenario, seed)
    p = scenario.procedure
    readings = max(1, round(p.settle.average * scenario.rate))
    samples = []
    for grip, (width, targets) in enumerate(zip(p.widths, designs(p), strict=True)):
        for target in targets:
            command = Command(target.X_TC, width, grip, "measuring")
            samples.append(average(target, grip, cell.rest(command, readings), 1.0, False))
    return Dataset(header(scenario, seed, ""), samples), cell

# SPDX-License-Identifier: Apache-2.0
"""What estimator and controller go by in a world, whatever is true of it."""

from dataclasses import dataclass, field
from typing import Any

from seed_core.hysteretic.spring import HystereticSpring, HystereticStiffness
from seed_core.membrane.map import MembraneMap
from seed_core.membrane.map_file import MembraneMapFile
from seed_core.wrench_model import WrenchModel
from seed_estimation.calibration.file import Calibration
from seed_sim.scenario import Scenario


@dataclass(frozen=True)
class Belief:
    """What is believed after the procedures, and what they say of themselves.

    Attributes:
        scenario: the cell as believed: hand as drawn, tool as weighed, `grasp.believed` the stiffness as identified.
        calibration: of range and cameras; None: hand as drawn, range as it comes.
        clock_offset: [s] that is taken off the images' stamps.
        spring, membranes: what the wrench is computed from; None: the stiffness.
        figures: what the procedures say about themselves; seconds: that each took.
        problems: what a procedure other than the identification could not do, in words.
    """

    scenario: Scenario
    calibration: Calibration | None = None
    clock_offset: float = 0.0
    spring: HystereticStiffness | None = None
    membranes: MembraneMapFile | None = None
    figures: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    problems: tuple[str, ...] = ()

    def wrench_model(self) -> WrenchModel | None:
        """The model at a new grasp; None: the map of the stiffness."""
        if self.membranes is not None:
            return MembraneMap(self.membranes)
        return HystereticSpring(self.spring) if self.spring is not None else None

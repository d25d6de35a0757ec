# SPDX-License-Identifier: Apache-2.0
"""The identification of a world's grasp on a force/torque sensor, by the suite's own procedure.

The sensor and its faults are those of `./seed identify`, drawn from the seed; the spring is the world's, and poses come
from the arm's kinematics with the flange as it is believed, as docs/identification.md recommends.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from seed_core.bushing import Stiffness
from seed_core.spatial import Array, inverse_pose
from seed_sim.identification.cell import SimulatedCell
from seed_sim.identification.scenario import Grasp, IdentificationScenario
from seed_sim.identification.session import simulate
from seed_sim.scenario import Scenario, tactile_of
from seed_sim.world.cameras import true_hand
from seed_sim.world.parameters import World
from seed_sim.world.spring import WorldSpring
from seed_sysid.fit.analysis import Analysis, analyse
from seed_sysid.parameters import ExcitationParameters, Procedure
from seed_sysid.report.summary import stiffness_file
from seed_sysid.stiffness_map import AXES, wrench_transform

# As far along x and z as a task of 10 N deflects the grasp: what is beyond the poses identified is guessed.
EXCITATION = ExcitationParameters(translation=(0.009, 0.005, 0.009))


@dataclass(frozen=True)
class Identified:
    """The stiffness at the scenario's grip, the analysis behind it, and figures of both against the truth."""

    stiffness: Stiffness
    analysis: Analysis
    figures: dict[str, Any]


class WorldCell(SimulatedCell):
    """The cell of an identification with the grasp and the flange of a world."""

    def __init__(self, scenario: IdentificationScenario, seed: int, believed: Scenario, world: World) -> None:
        super().__init__(scenario, seed)
        self.spring = WorldSpring(believed.grasp.stiffness, world.spring)
        X_EC = believed.hand.X_EC
        self._X_KC = inverse_pose(X_EC) @ true_hand(believed.hand, world).X_EC  # C as it is, in C by kinematics
        self._to_kinematic = wrench_transform(self._X_KC)

    def _spring(self, X_TC: Array, grip: int) -> Array:
        del grip
        X = inverse_pose(self._X_KC) @ X_TC @ self._X_KC
        return np.asarray(self._to_kinematic @ self.spring.static(X, self.stamp).vector())


def identification_of(scenario: Scenario) -> IdentificationScenario:
    """One grip of a scenario, at the procedure's defaults; its sensor has the faults that are drawn there."""
    grasp = scenario.grasp
    return IdentificationScenario(
        name=scenario.name,
        grasp=Grasp(
            stiffness=grasp.stiffness,
            spread=0.0,
            scatter=(0.0,) * 6,
            pressure=grasp.nominal_pressure,
            pressure_per_width=-grasp.pressure_slope,
        ),
        hand=scenario.hand,
        tactile=tactile_of(scenario),
        procedure=Procedure(widths=[grasp.nominal_width], excitation=EXCITATION),
    )


def identify(believed: Scenario, world: World, seed: int, scenario: IdentificationScenario | None = None) -> Identified:
    """Run the procedure and fit its samples.

    Args:
        believed: the cell as it is believed.
        world: what differs.
        seed: of the sensor and its faults.
        scenario: of the identification; default: `identification_of` the cell.

    Raises:
        SeedError: the run ended early, or its data give no stiffness.
    """
    scenario = scenario or identification_of(believed)
    cell = WorldCell(scenario, seed, believed, world)
    data, _ = simulate(scenario, seed, None, cell=cell)
    analysis = analyse(data, "kinematic", scenario.procedure.fit)
    stiffness_file(analysis, "")  # refuses what is undetermined, as for a user
    g = analysis.nominal
    found, true = analysis.solution.value.stiffness[g], cell.spring.stiffness.vector()
    half = analysis.solution.half_width[g]
    figures = {
        "found": dict(zip(AXES, found.tolist(), strict=True)),
        "half_width": dict(zip(AXES, half.tolist(), strict=True)),
        "drawn": dict(zip(AXES, true.tolist(), strict=True)),
        "error": dict(zip(AXES, (found / true - 1.0).tolist(), strict=True)),
        "covered": dict(zip(AXES, (np.abs(found - true) <= half).tolist(), strict=True)),
        "hysteretic": list(analysis.hysteretic),
        "warnings": list(analysis.warnings),
        "minutes": cell.stamp / 60.0,
    }
    return Identified(Stiffness.from_vector(found), analysis, figures)

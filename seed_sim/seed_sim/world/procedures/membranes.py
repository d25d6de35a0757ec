# SPDX-License-Identifier: Apache-2.0
"""The identification of a grasp between membranes in a world: what they do as the world's own cameras show it."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from seed_core.errors import FailedError, SeedError
from seed_sim.closed_loop.progress import Progress
from seed_sim.identification.membrane_cell import MembraneCell
from seed_sim.identification.scenario import IdentificationScenario
from seed_sim.identification.session import ToolLostError, simulate
from seed_sim.identification.tactile_poses import TactilePoses
from seed_sim.membrane.hold import MembraneHold
from seed_sim.scenario import Scenario
from seed_sim.world.cameras import WorldCameras
from seed_sim.world.parameters import World
from seed_sim.world.poses import make_estimator
from seed_sim.world.procedures.identify import membrane_identification_of
from seed_sysid.fit.analysis import Analysis, analyse

_CLOSER, _TIMES = 0.002, 3  # [m] of imprint, by which a gripper is closed further, and how often at most

T = TypeVar("T")
Cell = TypeVar("Cell", Scenario, IdentificationScenario)


class WorldTactilePoses(TactilePoses):
    """The estimator's view of membranes through the cameras of a world, of which it has the drawing."""

    def __init__(self, believed: Scenario, world: World, seed: int, method: str) -> None:
        self.hold = MembraneHold(believed.membrane, believed.tactile.tool)
        cameras = WorldCameras(believed, world, seed, self.hold)
        self._renderer = cameras
        self._estimator = make_estimator(believed, cameras, None, method, 1.0 / believed.measurement.rate)
        self.invalid = 0
        self.take_grasp(0.0)


def identify_membranes(
    believed: Scenario, world: World, seed: int, method: str = "rigid_fit", progress: Progress | None = None
) -> tuple[Scenario, Analysis]:
    """Run the procedure at the scenario's grip, and fit stiffness and membrane map to its samples.

    Where the grasp does not bear the work, the gripper is closed further and identified again, as the report asks for.

    Args:
        believed: the cell as it is believed, but for its membranes.
        world: what differs.
        seed: of the sensor and the images' noise.
        method: of the estimator.
        progress: is told the share of the poses of each identification.

    Returns:
        The cell with the grip that was settled on, and the analysis there, with its map.

    Raises:
        SeedError: the run ended early, or its data give no stiffness or no map.
    """
    at, analysis, _ = closed_until_borne(
        believed, lambda cell: (_identified(cell, world, seed, method, progress), None)
    )
    return at, analysis


def closed_until_borne(scenario: Cell, identify: Callable[[Cell], tuple[Analysis, T]]) -> tuple[Cell, Analysis, T]:
    """Identify; while the grasp does not bear its work, close the gripper by 2 mm and identify again, at most thrice.

    So it is done where the estimator loses the tool again and again, and where the data give no map of the membranes:
    most often the grasp does not bear poses as large as a map needs.

    Args:
        scenario: the cell, with the grip to begin with.
        identify: gives the analysis at a scenario's grip, and whatever goes with it.

    Returns:
        The cell with the grip that was settled on, and what `identify` gave there.

    Raises:
        SeedError: no identification came to its end with a map. Where a later one does not, what was found before
            counts.
    """
    found: tuple[Cell, Analysis, T] | None = None
    for times in range(_TIMES + 1):
        squeeze = scenario.membrane.squeeze + times * _CLOSER
        at = replace(scenario, membrane=replace(scenario.membrane, squeeze=squeeze))
        try:
            analysis, more = identify(at)
            if analysis.membrane is None:
                raise _NoMapError(f"no membrane map: {analysis.membrane_refused or 'no sample tells of membranes'}")
        except SeedError as error:
            if found is not None:
                break
            if times == _TIMES or not isinstance(error, ToolLostError | _NoMapError):
                raise
            continue
        found = at, analysis, more
        if not analysis.not_borne:
            break
    assert found is not None
    return found


class _NoMapError(FailedError):
    """The data of an identification give no map."""


def _identified(believed: Scenario, world: World, seed: int, method: str, progress: Progress | None) -> Analysis:
    scenario = membrane_identification_of(believed)
    cell = MembraneCell(scenario, seed, WorldTactilePoses(believed, world, seed, method))
    data, _ = simulate(scenario, seed, None, cell=cell, progress=progress)
    return analyse(data, "estimator", scenario.procedure.fit)

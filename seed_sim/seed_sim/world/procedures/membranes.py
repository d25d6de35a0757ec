# SPDX-License-Identifier: Apache-2.0
"""The identification of a grasp between membranes in a world: what they do as the world's own cameras show it."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from seed_core.errors import SeedError
from seed_core.membrane.map_file import MembraneMapFile
from seed_sim.closed_loop.progress import Progress
from seed_sim.identification.membrane_cell import MembraneCell
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
) -> tuple[Scenario, Analysis, MembraneMapFile]:
    """Run the procedure at the scenario's grip, and fit stiffness and membrane map to its samples.

    Where the grasp does not bear the work, the gripper is closed further and identified again, as the report asks for.

    Args:
        believed: the cell as it is believed, but for its membranes.
        world: what differs.
        seed: of the sensor and the images' noise.
        method: of the estimator.
        progress: is told the share of the poses of each identification.

    Returns:
        The cell with the grip that was settled on, the analysis there, and the map.

    Raises:
        SeedError: the run ended early, or its data give no stiffness or no map.
    """
    return closed_until_borne(believed, lambda scenario: _identified(scenario, world, seed, method, progress))


def closed_until_borne(
    scenario: Scenario, identify: Callable[[Scenario], tuple[Analysis, T]]
) -> tuple[Scenario, Analysis, T]:
    """Identify; while the grasp does not bear its work, close the gripper by 2 mm and identify again, at most thrice.

    So it is done where the estimator loses the tool again and again.

    Args:
        scenario: the cell, with the grip to begin with.
        identify: gives the analysis at a scenario's grip, and whatever goes with it.

    Returns:
        The cell with the grip that was settled on, and what `identify` gave there.

    Raises:
        SeedError: no identification came to its end. Where a later one does not, what was found before counts.
    """
    found: tuple[Scenario, Analysis, T] | None = None
    for times in range(_TIMES + 1):
        squeeze = scenario.membrane.squeeze + times * _CLOSER
        at = replace(scenario, membrane=replace(scenario.membrane, squeeze=squeeze))
        try:
            found = at, *identify(at)
        except SeedError as error:
            if found is not None:
                break
            if times == _TIMES or not isinstance(error, ToolLostError):
                raise
            continue
        if not found[1].not_borne:
            break
    assert found is not None
    return found


def _identified(
    believed: Scenario, world: World, seed: int, method: str, progress: Progress | None
) -> tuple[Analysis, MembraneMapFile]:
    scenario = membrane_identification_of(believed)
    cell = MembraneCell(scenario, seed, WorldTactilePoses(believed, world, seed, method))
    data, _ = simulate(scenario, seed, None, cell=cell, progress=progress)
    analysis = analyse(data, "estimator", scenario.procedure.fit)
    if analysis.membrane is None:
        raise SeedError(f"no membrane map: {analysis.membrane_refused or 'no sample tells of membranes'}")
    return analysis, analysis.membrane.file

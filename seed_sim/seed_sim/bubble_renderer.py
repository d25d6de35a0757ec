# SPDX-License-Identifier: Apache-2.0
"""The images of a scenario's bubbles, whichever grasp it has."""

from collections.abc import Mapping

from seed_core.hand import Hand
from seed_core.spatial import Array
from seed_estimation import PinholeCamera, TactileImages
from seed_sim.membrane.hold import MembraneHold
from seed_sim.scenario import Scenario, tactile_of
from seed_sim.tactile import MeshRenderer, TactileParameters, TactileRenderer
from seed_sim.tactile.renderer import Lenses


class HeldRenderer:
    """Images of a tool between membranes with mechanics. Poses have a history here: give them in order of time.

    Attributes:
        hold: the membranes, which a plant may share.
    """

    def __init__(
        self, parameters: TactileParameters, hand: Hand, seed: int, hold: MembraneHold, lenses: Lenses | None = None
    ) -> None:
        """lenses: of each finger's camera; default: those of the parameters' camera."""
        self.parameters, self.hand, self.hold = parameters, hand, hold
        self._mesh = MeshRenderer(parameters, hand, seed, hold.free, lenses)
        self.fingers = self._mesh.fingers

    @property
    def cameras(self) -> Mapping[str, PinholeCamera]:
        """Calibration of each finger's camera."""
        return self._mesh.cameras

    def render(self, X_CT: Array, stamp: float) -> dict[str, TactileImages]:
        """Images of the tool moved on to X_CT (4, 4) at time stamp [s]. Raises MembraneError."""
        return self._mesh.render(self.hold.at(X_CT, stamp).bubbles, stamp)

    def finger(self, name: str, X_CT: Array | None, stamp: float) -> TactileImages:
        """Images of one finger; X_CT is None with nothing in the grasp."""
        return self._mesh.finger(name, None if X_CT is None else self.hold.at(X_CT, stamp).bubbles[name].nodes, stamp)

    def no_contact(self, stamp: float) -> dict[str, TactileImages]:
        """Images with nothing in the grasp."""
        return self._mesh.no_contact(stamp)


def renderer_of(scenario: Scenario, seed: int, hold: MembraneHold | None = None) -> TactileRenderer | HeldRenderer:
    """The renderer of a scenario; hold: the plant's membranes, where images are to show them. Raises MembraneError."""
    if scenario.grasp.kind != "membrane":
        return TactileRenderer(tactile_of(scenario), scenario.hand, seed)
    hold = hold or MembraneHold(scenario.membrane, scenario.tactile.tool)
    return HeldRenderer(tactile_of(scenario), scenario.hand, seed, hold)

# SPDX-License-Identifier: Apache-2.0
"""The estimator's view in a simulated identification: rendered tactile images through the estimator.

Images are rendered while a pose is measured, on the way often enough for the estimator to follow, and at rest often
enough for it not to take the images for interrupted; not at a camera's rate, which would cost far more and tell
nothing new.
"""

from typing import Any

import numpy as np

from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array, so3_log
from seed_sim.identification.scenario import IdentificationScenario
from seed_sim.membrane.hold import MembraneHold

_STEP, _TURN = 3e-4, np.deg2rad(0.5)  # [m], [rad]; further than that from the last image, another one is taken
_LONGEST = 0.7  # of the gap between images at which the estimator gives up the track
_FRAMES = 4  # images averaged per pose
_BEFORE = 0.01  # [s] between images of the grasp at rest
REFERENCE_FRAMES, GRASP_FRAMES = 15, 15  # frames of the empty bubbles, and of the grasp at rest


class TactilePoses:
    """Looks at the tool's pose X_CT and returns what the estimator makes of it.

    Attributes:
        hold: the membranes that are seen; None on a bushing.
        invalid: estimates that were not valid.
    """

    def __init__(self, scenario: IdentificationScenario, seed: int) -> None:
        from seed_estimation import Estimator, EstimatorParameters
        from seed_sim.bubble_renderer import HeldRenderer
        from seed_sim.tactile import TactileRenderer

        self.hold: MembraneHold | None = None
        self._renderer: Any  # with `render` as a TactileRenderer's; hidden worlds have cameras of their own
        if scenario.grasp.kind == "membrane":
            self.hold = MembraneHold(scenario.membrane, scenario.tactile.tool)
            self._renderer = HeldRenderer(scenario.tactile, scenario.hand, seed, self.hold)
        else:
            self._renderer = TactileRenderer(scenario.tactile, scenario.hand, seed)
        parameters = EstimatorParameters(method=scenario.estimator)
        self._estimator = Estimator(parameters, scenario.hand, self._renderer.cameras)
        self._estimator.capture_reference([self._renderer.no_contact(0.0) for _ in range(REFERENCE_FRAMES)])
        self._last, self._frames, self._at = np.eye(4), 0, 0.0
        self.invalid = 0
        self.take_grasp(0.0)

    def take_grasp(self, t: float) -> None:
        """The gripper has closed on the tool, which rests where its frame counts from, at time t [s]."""
        before = [t - _BEFORE * (GRASP_FRAMES - i) for i in range(GRASP_FRAMES)]
        self._estimator.initialize_grasp([self._renderer.render(np.eye(4), stamp) for stamp in before])
        self._last, self._frames, self._at = np.eye(4), 0, t

    def __call__(self, X_CT: Array, stamp: float, measuring: bool) -> RelativePoseEstimate | None:
        """The estimate, valid or not, or None when no image was taken."""
        self._frames = self._frames + 1 if measuring else 0
        moved = float(np.linalg.norm(X_CT[:3, 3] - self._last[:3, 3])) > _STEP
        turned = float(np.linalg.norm(so3_log(X_CT[:3, :3].T @ self._last[:3, :3]))) > _TURN
        old = stamp - self._at > _LONGEST * self._estimator.parameters.max_gap
        if not (moved or turned or old or 0 < self._frames <= _FRAMES):
            return None
        return self.look(X_CT, stamp)

    def look(self, X_CT: Array, stamp: float) -> RelativePoseEstimate:
        """The estimate, valid or not, of an image taken now."""
        self._last, self._at = X_CT, stamp
        estimate = self._estimator.update(self._renderer.render(X_CT, stamp), stamp)
        self.invalid += int(not estimate.valid)
        return estimate

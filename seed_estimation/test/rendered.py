# SPDX-License-Identifier: Apache-2.0
"""Grasps of rendered bubbles."""

import numpy as np

from seed_core.hand import Hand
from seed_estimation import Estimator, EstimatorParameters
from seed_sim.tactile.parameters import TactileParameters
from seed_sim.tactile.renderer import TactileRenderer

PERIOD = 1.0 / 45.0  # [s]


def held(p: TactileParameters, seed: int, method: str = "rigid_fit") -> tuple[Estimator, TactileRenderer]:
    """An estimator with reference and grasp, and the bubbles that it looks at."""
    bubbles = TactileRenderer(p, Hand(), seed)
    estimator = Estimator(EstimatorParameters(method=method), Hand(), bubbles.cameras)
    estimator.capture_reference([bubbles.no_contact(-1.0 + i * PERIOD) for i in range(8)])
    estimator.initialize_grasp([bubbles.render(np.eye(4), (i - 8) * PERIOD) for i in range(8)])
    return estimator, bubbles

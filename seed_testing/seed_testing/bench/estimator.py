# SPDX-License-Identifier: Apache-2.0
"""Cost of an estimate: the rigid fit beside the published method with the public kit's Farneback settings.

CPU time of this process on one core, over the same pairs of rendered images.
"""

import cv2
import numpy as np

from seed_sim import Scenario, TactileRenderer
from seed_sim.tactile.trajectory import TrajectorySection, poses
from seed_testing.figures import figures
from seed_testing.validation.run import estimator_for
from seed_testing.validation.scores import Series

_RATE = 45.0  # [Hz]


def run(frames: int = 240) -> dict[str, object]:
    """Both methods over the same images, side by side: every eighth pair goes to the published one as well."""
    cv2.setNumThreads(1)
    scenario = Scenario(trajectory=TrajectorySection(duration=frames / _RATE, rate=_RATE))
    renderer = TactileRenderer(scenario.tactile, scenario.hand, 0)
    methods = {name: (estimator_for(scenario, name, renderer), Series()) for name in ("rigid_fit", "published")}
    for i, (stamp, X_CT) in enumerate(poses(scenario.trajectory, 0), start=1):
        images = renderer.render(X_CT, stamp)
        for name, (estimator, series) in methods.items():
            if name == "rigid_fit" or i % 8 == 0:
                series.estimate(estimator, images, stamp, X_CT)
    out: dict[str, object] = {
        name: {
            **figures("{}_ms", series.cpu_ms, "median", "p99"),
            "valid_fraction": float(np.mean([estimate.valid for estimate in series.estimates])),
        }
        for name, (_, series) in methods.items()
    }
    fit, published = (np.median(series.cpu_ms) for _, series in methods.values())
    return {**out, "times_faster": float(published / fit)}

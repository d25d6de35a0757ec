# SPDX-License-Identifier: Apache-2.0
"""The estimator over rendered gels: calibrated by a ball as real ones are, with the reference taken."""

import numpy as np

from seed_estimation.gel.calibration import calibrated
from seed_estimation.gel.image import GelImage
from seed_estimation.gel.sensor import Gel
from seed_estimation.gel.settings import GelSettings
from seed_estimation.gel.shading import Shading
from seed_estimation.sensors.estimator import SensorEstimator
from seed_estimation.sensors.parameters import SensorEstimatorParameters
from seed_sim.gel.renderer import GelRenderer
from seed_sim.tactile.cameras import mount

BALL = 0.002  # [m]
_DEPTH = 0.0008, 0.0010  # [m] from which to which it is pressed in, by hand
PLACES = 8, 6  # columns and rows of presses
_REFERENCE_FRAMES = 10
_LEAD = 2.0  # [s] before time 0 at which the reference is taken


def calibrate_gels(
    renderer: GelRenderer, settings: GelSettings | None = None, seed: int = 0, places: tuple[int, int] = PLACES
) -> dict[str, Shading]:
    """Shadings by finger, from a ball that is pressed into each gel all over."""
    out: dict[str, Shading] = {}
    for name, finger in renderer.fingers.items():
        rng = np.random.default_rng((seed, 0xBA11, len(out)))
        free = [finger.image(finger.surface.free, 0.0) for _ in range(_REFERENCE_FRAMES)]
        presses = []
        for x in np.linspace(-0.0085, 0.0085, places[0]):
            for y in np.linspace(-0.006, 0.006, places[1]):
                u, v = rng.normal((x, y), 3e-4)
                presses.append(finger.image(finger.ball(BALL, u, v, rng.uniform(*_DEPTH)), 0.0))
        out[name] = calibrated(free, presses, BALL, finger.camera, settings or GelSettings())
    return out


def gel_estimator(renderer: GelRenderer, shadings: dict[str, Shading]) -> SensorEstimator[GelImage]:
    """With the reference taken."""
    gels = {
        f: Gel(f, GelSettings(), camera, mount(renderer.hand, f), shadings[f]) for f, camera in renderer.cameras.items()
    }
    estimator = SensorEstimator(gels, SensorEstimatorParameters(), "gel")
    estimator.capture_reference([renderer.no_contact(-_LEAD + 0.01 * i) for i in range(_REFERENCE_FRAMES)])
    return estimator

# SPDX-License-Identifier: Apache-2.0
"""The suite's calibration of range and cameras, from rendered captures: free membranes, a cylinder held in poses."""

from __future__ import annotations

import numpy as np

from seed_core.hand import Hand
from seed_estimation.calibration.calibrate import FAR, NEAR, MembraneShape, calibrate
from seed_estimation.calibration.file import Calibration
from seed_estimation.contact.membrane import mean_depth
from seed_sim.tactile import TactileRenderer
from seed_sim.tactile.captures import captures

_START = -60.0  # [s]; before everything else of a run


def known_shape(renderer: TactileRenderer) -> MembraneShape:
    """The membrane at rest, as the renderer's parameters have it; the cameras must look straight at it."""
    p = renderer.parameters
    apex = abs(float(renderer.hand.X_CL[1, 3])) - p.tool.radius + p.squeeze
    return MembraneShape(p.rim_x, p.rim_z, p.height, apex)


def calibration(renderer: TactileRenderer, hand: Hand) -> Calibration:
    """Range offsets and camera poses, started from the believed `hand`, with the renderer's tool as the cylinder."""
    taken = captures(renderer, _START)
    still = {f: [frame[f].depth for frame in taken.no_contact] for f in renderer.cameras}
    held = {
        f: [np.asarray(mean_depth([frame[f].depth for frame in pose], NEAR, FAR)[0]) for pose in taken.grasped]
        for f in renderer.cameras
    }
    return calibrate(renderer.cameras, still, held, known_shape(renderer), taken.radius, hand)

# SPDX-License-Identifier: Apache-2.0
"""The suite's calibration of range and cameras, from rendered captures: free membranes, a cylinder held in poses."""

from typing import Any

import numpy as np

from seed_core.hand import Hand
from seed_core.spatial import pose_from_rpy
from seed_estimation.calibration.calibrate import FAR, NEAR, MembraneShape, calibrate
from seed_estimation.calibration.file import Calibration
from seed_estimation.contact.membrane import mean_depth
from seed_sim.tactile import TactileRenderer

_START = -60.0  # [s]; before everything else of a run
_POSES_DEG = ((0, 0, 0), (10, 0, 0), (-10, 0, 0), (0, 20, 0), (0, -20, 0))  # roll, pitch, yaw of the cylinder
_PERIOD = 1.0 / 45.0  # [s] between frames


def captures(renderer: TactileRenderer, frames: int = 150, per_pose: int = 20) -> dict[str, Any]:
    """What `calibrate` takes besides the hand.

    The membrane is as the renderer's parameters have it, and the cameras must look straight at it. The renderer's own
    tool is the cylinder and must be round.

    Args:
        frames: images without contact.
        per_pose: images of the grasped cylinder in each of its poses.
    """
    p = renderer.parameters
    stamps = iter(_START + _PERIOD * np.arange(frames + len(_POSES_DEG) * per_pose))
    still = [renderer.no_contact(float(next(stamps))) for _ in range(frames)]
    X_CT = [pose_from_rpy(np.deg2rad(rpy), (0.0, 0.0, 0.0)) for rpy in _POSES_DEG]
    held = [[renderer.render(X, float(next(stamps))) for _ in range(per_pose)] for X in X_CT]
    apex = abs(float(renderer.hand.X_CL[1, 3])) - p.tool.radius + p.squeeze
    return {
        "cameras": renderer.cameras,
        "no_contact": {f: [frame[f].depth for frame in still] for f in renderer.cameras},
        "grasped": {
            f: [np.asarray(mean_depth([frame[f].depth for frame in pose], NEAR, FAR)[0]) for pose in held]
            for f in renderer.cameras
        },
        "shape": MembraneShape(p.rim_x, p.rim_z, p.height, apex),
        "radius": p.tool.radius,
    }


def calibration(renderer: TactileRenderer, hand: Hand) -> Calibration:
    """Range offsets and camera poses, started from the believed `hand`."""
    return calibrate(**captures(renderer), hand=hand)

# SPDX-License-Identifier: Apache-2.0
"""Rendered captures for the calibration of range and cameras: free membranes, a cylinder held in a few poses."""

from typing import Any, Protocol

import numpy as np

from seed_core.hand import Hand
from seed_core.spatial import Array, pose_from_rpy
from seed_estimation import PinholeCamera, TactileImages
from seed_estimation.calibration.calibrate import FAR, NEAR, MembraneShape
from seed_estimation.contact.membrane import mean_depth
from seed_sim.tactile.parameters import TactileParameters

_START = -60.0  # [s]; before everything else of a run
_POSES_DEG = ((0, 0, 0), (10, 0, 0), (-10, 0, 0), (0, 20, 0), (0, -20, 0))  # roll, pitch, yaw of the cylinder
_PERIOD = 1.0 / 45.0  # [s] between frames


class CapturedBubbles(Protocol):
    """What is captured: a TactileRenderer, or the cameras of a hidden world.

    Attributes:
        parameters: of membrane and tool. hand: as drawn. cameras: calibration of the lenses by finger.
    """

    parameters: TactileParameters
    hand: Hand

    @property
    def cameras(self) -> dict[str, PinholeCamera]: ...

    def no_contact(self, stamp: float, /) -> dict[str, TactileImages]:
        """Images with nothing in the grasp."""
        ...

    def render(self, X_CT: Array, stamp: float, /) -> dict[str, TactileImages]:
        """Images of the tool at X_CT (4, 4)."""
        ...


def captures(bubbles: CapturedBubbles, frames: int = 150, per_pose: int = 20) -> dict[str, Any]:
    """What `calibrate` takes besides the hand.

    The membrane is as the renderer's parameters have it, and the cameras must look straight at it. The renderer's own
    tool is the cylinder and must be round.

    Args:
        bubbles: that are captured.
        frames: images without contact.
        per_pose: images of the grasped cylinder in each of its poses.
    """
    p = bubbles.parameters
    stamps = iter(_START + _PERIOD * np.arange(frames + len(_POSES_DEG) * per_pose))
    still = [bubbles.no_contact(float(next(stamps))) for _ in range(frames)]
    X_CT = [pose_from_rpy(np.deg2rad(rpy), (0.0, 0.0, 0.0)) for rpy in _POSES_DEG]
    held = [[bubbles.render(X, float(next(stamps))) for _ in range(per_pose)] for X in X_CT]
    apex = abs(float(bubbles.hand.X_CL[1, 3])) - p.tool.radius + p.squeeze
    return {
        "cameras": bubbles.cameras,
        "no_contact": {f: [frame[f].depth for frame in still] for f in bubbles.cameras},
        "grasped": {
            f: [np.asarray(mean_depth([frame[f].depth for frame in pose], NEAR, FAR)[0]) for pose in held]
            for f in bubbles.cameras
        },
        "shape": MembraneShape(p.rim_x, p.rim_z, p.height, apex),
        "radius": p.tool.radius,
    }

# SPDX-License-Identifier: Apache-2.0
"""The suite's calibration of range and cameras, from rendered captures: free membranes, a cylinder held in poses."""

from typing import NamedTuple

import numpy as np

from seed_core.hand import Hand
from seed_core.spatial import Array, pose_from_rpy
from seed_estimation import TactileImages
from seed_estimation.calibration.calibrate import FAR, NEAR, MembraneShape, calibrate
from seed_estimation.calibration.file import Calibration
from seed_estimation.contact.membrane import mean_depth
from seed_sim.tactile import TactileRenderer

Frames = list[dict[str, TactileImages]]
_START = -60.0  # [s]; before everything else of a run
_POSES_DEG = ((0, 0, 0), (10, 0, 0), (-10, 0, 0), (0, 20, 0), (0, -20, 0))  # roll, pitch, yaw of the cylinder
_PERIOD = 1.0 / 45.0  # [s] between frames


class Captures(NamedTuple):
    """Images that the calibration starts from.

    Attributes:
        no_contact: frames with nothing in the grasp.
        grasped: per pose, frames of the grasped cylinder.
        X_CT: per pose, the cylinder (4, 4); its axis is z_T.
        radius: of the cylinder [m].
    """

    no_contact: Frames
    grasped: list[Frames]
    X_CT: list[Array]
    radius: float


def captures(renderer: TactileRenderer, start: float = 0.0, frames: int = 150, per_pose: int = 20) -> Captures:
    """Captures with the renderer's own tool, which must be round, from time start [s] on."""
    stamps = iter(start + _PERIOD * np.arange(frames + len(_POSES_DEG) * per_pose + 1))
    still = [renderer.no_contact(float(next(stamps))) for _ in range(frames)]
    X_CT = [pose_from_rpy(np.deg2rad(rpy), (0.0, 0.0, 0.0)) for rpy in _POSES_DEG]
    held = [[renderer.render(X, float(next(stamps))) for _ in range(per_pose)] for X in X_CT]
    return Captures(still, held, X_CT, renderer.parameters.tool.radius)


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

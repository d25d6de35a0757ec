# SPDX-License-Identifier: Apache-2.0
"""Images for calibrating range and cameras: nothing touched, and a cylinder held in known poses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array, pose_from_rpy
from seed_estimation import TactileImages
from seed_sim.tactile.renderer import TactileRenderer

Frames = list[dict[str, TactileImages]]


class Captures(NamedTuple):
    """What the routine of calibration starts from.

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
    step = 1.0 / 45.0
    stamps = iter(start + step * np.arange(frames + 5 * per_pose + 1))
    still = [renderer.no_contact(float(next(stamps))) for _ in range(frames)]
    turns = ((0, 0, 0), (10, 0, 0), (-10, 0, 0), (0, 20, 0), (0, -20, 0))
    X_CT = [pose_from_rpy(np.deg2rad(turn), (0.0, 0.0, 0.0)) for turn in turns]
    held = [[renderer.render(X, float(next(stamps))) for _ in range(per_pose)] for X in X_CT]
    return Captures(still, held, X_CT, renderer.parameters.tool.radius)

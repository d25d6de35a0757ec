# SPDX-License-Identifier: Apache-2.0
"""The two cameras that are built into bubbles, with the calibration of a real specimen of each."""

import numpy as np

from seed_core.hand import Hand
from seed_core.spatial import Array
from seed_estimation import PinholeCamera
from seed_sim.tactile.geometry import Rays


def camera_model(name: str) -> PinholeCamera:
    """Calibration of a pmd PicoFlexx (224 x 171) or of a RealSense D405 (640 x 480)."""
    if name == "picoflexx":
        K = np.array(((214.06, 0.0, 116.25), (0.0, 214.06, 87.57), (0.0, 0.0, 1.0)))
        return PinholeCamera(224, 171, K, np.array((0.368, -4.494, 0.0, 0.0, 7.971)), "plumb_bob")
    K = np.array(((429.5, 0.0, 313.8), (0.0, 428.9, 247.7), (0.0, 0.0, 1.0)))
    return PinholeCamera(640, 480, K, np.array((-0.0568, 0.0607, 0.00076, 0.00099, -0.0202)), "inverse_brown_conrady")


def mount(hand: Hand, finger: str) -> Array:
    """X_CX (4, 4) of a finger's optical frame."""
    return hand.X_CL if finger == "left" else hand.X_CR


def coarse_factor(camera: PinholeCamera) -> int:
    """Pixels per cell of the grid on which the membrane's shape is computed."""
    return 2 if camera.width < 400 else 4


def coarse_rays(camera: PinholeCamera, hand: Hand, finger: str) -> Rays:
    """Rays in C through the centres of cells of coarse_factor x coarse_factor pixels that cover the image."""
    n = coarse_factor(camera)
    u = np.arange(0, camera.width, n) + 0.5 * (n - 1)
    v = np.arange(0, camera.height, n) + 0.5 * (n - 1)
    rays = camera.pixel_rays(np.stack(np.meshgrid(u, v), axis=-1))
    rays = np.where(np.isfinite(rays), rays, 0.0)
    X_CX = mount(hand, finger)
    directions = np.moveaxis(rays @ X_CX[:3, :3].T, -1, 0)
    return Rays(X_CX[:3, 3], np.ascontiguousarray(directions, np.float32), 1.0 if finger == "left" else -1.0)

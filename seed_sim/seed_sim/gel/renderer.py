# SPDX-License-Identifier: Apache-2.0
"""Colour images of two gels that hold a tool, and of one that a ball is pressed into."""

import cv2
import numpy as np
from numpy.random import Generator

from seed_core.hand import FINGERS, FINGERS_OF, Hand
from seed_core.spatial import Array, inverse_pose
from seed_estimation import PinholeCamera
from seed_estimation.gel.image import GelImage
from seed_sim.gel.light import Dots, Exposure, Lamps, seen_points
from seed_sim.gel.parameters import GelParameters, gel_camera
from seed_sim.gel.shapes import Field, ball_surface, tool_surface
from seed_sim.gel.surface import CELL, SIZE, GelSurface, Pressed
from seed_sim.tactile.cameras import mount
from seed_sim.tactile.membrane import followed

_LOOKS = 3  # steps to find where a pixel's ray meets the surface


class GelFinger:
    """One gel with its camera. Dots, lamps and noise come from the seed."""

    def __init__(self, p: GelParameters, X_CX: Array, camera: PinholeCamera, rng: Generator) -> None:
        self.p, self.X_CX, self.camera = p, X_CX, camera
        self.surface = GelSurface(p)
        self._rays = np.ascontiguousarray(np.moveaxis(camera.rays32[..., :2], -1, 0))
        self._lamps = Lamps(p, seen_points(camera, p.distance), rng)
        self._dots, self._exposure = Dots(p, rng), Exposure(p, rng)

    def tool(self, X_CT: Array, X_stuck: Array) -> Pressed:
        """The gel under the tool at X_CT (4, 4), of which it has followed X_stuck."""
        X_XC = inverse_pose(self.X_CX)
        s = self.surface
        reach = tool_surface(self.p.tool, X_XC @ X_CT @ self.p.T_held.pose, s.x, s.y)
        return s.press(reach, X_XC @ X_stuck @ self.X_CX)

    def ball(self, radius: float, x: float, y: float, depth: float) -> Pressed:
        """The gel under a ball that is pressed in by depth [m] about (x, y) [m] of the optical frame."""
        s = self.surface
        return s.press(ball_surface(radius, np.array((x, y, self.p.distance - depth + radius)), s.x, s.y), np.eye(4))

    def image(self, pressed: Pressed, stamp: float) -> GelImage:
        """What the camera delivers."""
        x, y = self._rays * np.float32(self.p.distance)
        for _ in range(_LOOKS if pressed.u.any() else 0):
            z = np.float32(self.p.distance) - _at(pressed.u, x, y)
            x, y = self._rays[0] * z, self._rays[1] * z
        slope = _at(pressed.slope[0], x, y), _at(pressed.slope[1], x, y)
        albedo = self._dots.at(_at(pressed.material[0], x, y), _at(pressed.material[1], x, y))
        return GelImage(self._exposure.counts(self._lamps.linear(slope) * albedo[..., None]), stamp)


class GelRenderer:
    """Both gels. X_CT is the tool's pose in the grasp; identity is the moment of grasp.

    Attributes:
        fingers: by name. cameras: calibration of each finger's camera.
    """

    def __init__(self, parameters: GelParameters, hand: Hand, seed: int) -> None:
        self.parameters, self.hand = parameters, hand
        names = FINGERS_OF[parameters.fingers]
        streams = dict(zip(FINGERS, np.random.SeedSequence(seed).spawn(len(FINGERS)), strict=True))
        camera = gel_camera(parameters)
        self.fingers = {
            f: GelFinger(parameters, mount(hand, f), camera, Generator(np.random.SFC64(streams[f]))) for f in names
        }

    @property
    def cameras(self) -> dict[str, PinholeCamera]:
        """Calibration of each finger's camera."""
        return {name: finger.camera for name, finger in self.fingers.items()}

    def render(self, X_CT: Array, stamp: float) -> dict[str, GelImage]:
        """Images of the tool at X_CT (4, 4) at time stamp [s]."""
        return {name: self.finger(name, X_CT, stamp) for name in self.fingers}

    def finger(self, name: str, X_CT: Array | None, stamp: float, X_stuck: Array | None = None) -> GelImage:
        """Image of one finger; X_CT is None with nothing in the grasp; X_stuck: what the gel has followed of it."""
        finger = self.fingers[name]
        if X_CT is None:
            return finger.image(finger.surface.free, stamp)
        X_stuck = followed(X_CT, self.parameters.slip) if X_stuck is None else X_stuck
        return finger.image(finger.tool(X_CT, X_stuck), stamp)

    def no_contact(self, stamp: float) -> dict[str, GelImage]:
        """Images with nothing in the grasp."""
        return {name: self.finger(name, None, stamp) for name in self.fingers}


def _at(field: Field, x: Field, y: Field) -> Field:
    """A field on the grid, at places (H, W) [m]."""
    scale = np.float32(1.0 / CELL)
    u, v = x * scale + np.float32(0.5 * (SIZE[0] - 1)), y * scale + np.float32(0.5 * (SIZE[1] - 1))
    return np.asarray(cv2.remap(field, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)

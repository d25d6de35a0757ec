# SPDX-License-Identifier: Apache-2.0
"""Depth and infrared images of both bubbles for a pose of the tool in the grasp."""

import cv2
import numpy as np

from seed_core.hand import Hand
from seed_core.spatial import Array, inverse_pose
from seed_estimation import PinholeCamera, TactileImages
from seed_sim.tactile.cameras import FINGERS, camera_model, coarse_factor, coarse_rays
from seed_sim.tactile.geometry import Image
from seed_sim.tactile.membrane import Membrane, Shape, followed
from seed_sim.tactile.noise import CameraNoise, D405Noise, PicoFlexxNoise
from seed_sim.tactile.parameters import TactileParameters
from seed_sim.tactile.texture import DotPattern, Light


class FingerRenderer:
    """One bubble. Dots and fixed pattern come from the seed, and so does the noise, frame by frame."""

    def __init__(
        self, finger: str, p: TactileParameters, hand: Hand, camera: PinholeCamera, rng: np.random.Generator
    ) -> None:
        rays = coarse_rays(camera, hand, finger)
        self.camera, self.membrane, self._p = camera, Membrane(rays, p), p
        self._n = coarse_factor(camera)
        self._dots = DotPattern(p, rng)
        self._light = Light(rays, self.membrane.rest, camera.shape, p, rng)
        self.noise = self._camera_noise(p, rng)

    def _camera_noise(self, p: TactileParameters, rng: np.random.Generator) -> CameraNoise:
        if p.camera == "picoflexx":
            return PicoFlexxNoise(self.camera.shape, p, rng)
        x, z = (self._fine(plane) for plane in self.membrane.rest.material)
        return D405Noise(self.camera.shape, p, rng, (x / p.rim_x) ** 2 + (z / p.rim_z) ** 2 < 1.0)

    def _fine(self, coarse: Image) -> Image:
        """A coarse field on the image's pixels."""
        h, w = coarse.shape
        fine = cv2.resize(coarse, (w * self._n, h * self._n), interpolation=cv2.INTER_LINEAR)
        return np.ascontiguousarray(fine[: self.camera.height, : self.camera.width])

    def clean(self, shape: Shape, stamp: float) -> tuple[Image, Image, Image]:
        """Depth [m], albedo and infrared [counts], each (H, W), as a camera without error would see them."""
        albedo = self._dots.at(np.stack([self._fine(plane) for plane in self._dots.cells(shape.material)]))
        ir = self._light.with_spot(albedo * self._fine(self._light.counts(shape, stamp)))
        return self._fine(shape.depth), albedo, ir

    def render(self, shape: Shape, stamp: float) -> TactileImages:
        """What the camera delivers."""
        depth, ir = self.noise.add_to(*self.clean(shape, stamp))
        return TactileImages(depth, ir, stamp)


class TactileRenderer:
    """Both bubbles. X_CT is the tool's pose in the grasp; identity is the moment of grasp."""

    def __init__(self, parameters: TactileParameters, hand: Hand, seed: int) -> None:
        self.parameters, self.hand = parameters, hand
        camera = camera_model(parameters.camera)
        names = FINGERS if parameters.fingers == "both" else (parameters.fingers,)
        streams = np.random.SeedSequence(seed).spawn(len(FINGERS))
        self.fingers = {
            name: FingerRenderer(name, parameters, hand, camera, np.random.Generator(np.random.SFC64(streams[i])))
            for i, name in enumerate(FINGERS)
            if name in names
        }

    @property
    def cameras(self) -> dict[str, PinholeCamera]:
        """Calibration of each finger's camera."""
        return {name: finger.camera for name, finger in self.fingers.items()}

    @property
    def reach(self) -> float:
        """Root mean square distance of the patch from its middle at the grasp [m]."""
        return float(np.mean([finger.membrane.sheet.reach for finger in self.fingers.values()]))

    def render(
        self, X_CT: Array, stamp: float, X_slid: Array | None = None, load: float = 0.0
    ) -> dict[str, TactileImages]:
        """Images of the tool at X_CT (4, 4) at time stamp [s].

        X_slid (4, 4) is how far the tool has slid through the membrane since the grasp: what the membrane has followed
        is X_CT X_slid^-1. Left out: it has not. load: share of the largest load that friction bears, see `friction`.
        """
        return {name: self.finger(name, X_CT, stamp, X_slid, load) for name in self.fingers}

    def finger(
        self, name: str, X_CT: Array | None, stamp: float, X_slid: Array | None = None, load: float = 0.0
    ) -> TactileImages:
        """Images of one finger, as `render` makes them; X_CT is None with nothing in the grasp."""
        finger = self.fingers[name]
        if X_CT is None:
            return finger.render(finger.membrane.rest, stamp)
        X_stuck = X_CT if X_slid is None else X_CT @ inverse_pose(X_slid)
        X_stuck = followed(X_stuck, self.parameters.slip)
        return finger.render(finger.membrane.press(X_CT, X_stuck, load), stamp)

    def no_contact(self, stamp: float) -> dict[str, TactileImages]:
        """Images with nothing in the grasp."""
        return {name: self.finger(name, None, stamp) for name in self.fingers}

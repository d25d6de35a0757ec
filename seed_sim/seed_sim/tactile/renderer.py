# SPDX-License-Identifier: Apache-2.0
"""Depth and infrared images of both bubbles, for a pose of the tool in the grasp or for membranes given by nodes."""

from collections.abc import Mapping
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from seed_core.hand import FINGERS, FINGERS_OF, Hand
from seed_core.spatial import Array, inverse_pose
from seed_estimation import PinholeCamera, TactileImages
from seed_sim.tactile.cameras import camera_model, coarse_factor, coarse_rays, mount
from seed_sim.tactile.geometry import Image, Rays
from seed_sim.tactile.membrane import DeformedMembrane, Membrane, followed
from seed_sim.tactile.mesh_view import MeshView
from seed_sim.tactile.noise import CameraNoise, D405Noise, PicoFlexxNoise
from seed_sim.tactile.parameters import TactileParameters
from seed_sim.tactile.texture import DotPattern, Light

Lenses = Mapping[str, PinholeCamera]  # by finger


class Nodes(Protocol):
    """A membrane as a mesh; seed_sim.membrane.BubbleState is one."""

    @property
    def nodes(self) -> Array: ...  # (n, 3) [m] in C
    @property
    def triangles(self) -> NDArray[Any]: ...  # (m, 3) indices
    @property
    def material(self) -> Array: ...  # (n, 2) [m] x and z on the flat sheet


class FingerRenderer:
    """One bubble. Dots and fixed pattern come from the seed, and so does the noise, frame by frame."""

    def __init__(
        self, rays: Rays, rest: DeformedMembrane, p: TactileParameters, camera: PinholeCamera, rng: Generator
    ) -> None:
        """rest: what the free membrane looks like."""
        self.camera, self._rest, self._p = camera, rest, p
        self._n = coarse_factor(camera)
        self._dots = DotPattern(p, rng)
        self._light = Light(rays, rest, camera.shape, p, rng)
        self.noise = self._camera_noise(p, rng)

    def _camera_noise(self, p: TactileParameters, rng: Generator) -> CameraNoise:
        if p.camera == "picoflexx":
            return PicoFlexxNoise(self.camera.shape, p, rng)
        x, z = (self._fine(plane) for plane in self._rest.material)
        return D405Noise(self.camera.shape, p, rng, (x / p.rim_x) ** 2 + (z / p.rim_z) ** 2 < 1.0)

    def _fine(self, coarse: Image) -> Image:
        """A coarse field on the image's pixels."""
        h, w = coarse.shape
        fine = cv2.resize(coarse, (w * self._n, h * self._n), interpolation=cv2.INTER_LINEAR)
        return np.ascontiguousarray(fine[: self.camera.height, : self.camera.width])

    def clean(self, shape: DeformedMembrane, stamp: float) -> tuple[Image, Image, Image]:
        """Depth [m], albedo and infrared [counts], each (H, W), as a camera without error would see them."""
        albedo = self._dots.at(np.stack([self._fine(plane) for plane in self._dots.cells(shape.material)]))
        ir = self._light.with_spot(albedo * self._fine(self._light.counts(shape, stamp)))
        return self._fine(shape.depth), albedo, ir

    def render(self, shape: DeformedMembrane, stamp: float) -> TactileImages:
        """What the camera delivers."""
        depth, ir = self.noise.add_to(*self.clean(shape, stamp))
        return TactileImages(depth, ir, stamp)


class _Bubbles:
    """What both renderers share.

    Attributes:
        fingers: by name.
        cameras: calibration of each finger's camera.
    """

    def __init__(self, parameters: TactileParameters, hand: Hand, lenses: Lenses | None) -> None:
        self.parameters, self.hand = parameters, hand
        self._lenses = lenses or dict.fromkeys(FINGERS, camera_model(parameters.camera))
        self._names = FINGERS_OF[parameters.fingers]
        self.fingers: dict[str, FingerRenderer] = {}

    def _add(self, finger: str, rays: Rays, rest: DeformedMembrane, seed: int) -> None:
        """A finger of its own stream of random numbers."""
        stream = np.random.SeedSequence(seed).spawn(len(FINGERS))[FINGERS.index(finger)]
        rng = Generator(np.random.SFC64(stream))
        self.fingers[finger] = FingerRenderer(rays, rest, self.parameters, self._lenses[finger], rng)

    @property
    def cameras(self) -> dict[str, PinholeCamera]:
        """Calibration of each finger's camera."""
        return {name: finger.camera for name, finger in self.fingers.items()}


class TactileRenderer(_Bubbles):
    """Both bubbles. X_CT is the tool's pose in the grasp; identity is the moment of grasp."""

    def __init__(self, parameters: TactileParameters, hand: Hand, seed: int, lenses: Lenses | None = None) -> None:
        """lenses: of each finger's camera; default: those of the parameters' camera."""
        super().__init__(parameters, hand, lenses)
        self.membranes: dict[str, Membrane] = {}
        for name in self._names:
            rays = coarse_rays(self._lenses[name], hand, name)
            self.membranes[name] = Membrane(rays, parameters)
            self._add(name, rays, self.membranes[name].rest, seed)

    @property
    def reach(self) -> float:
        """Root mean square distance of the patch from its middle at the grasp [m]."""
        return float(np.mean([membrane.sheet.reach for membrane in self.membranes.values()]))

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
        finger, membrane = self.fingers[name], self.membranes[name]
        if X_CT is None:
            return finger.render(membrane.rest, stamp)
        X_stuck = X_CT if X_slid is None else X_CT @ inverse_pose(X_slid)
        X_stuck = followed(X_stuck, self.parameters.slip)
        return finger.render(membrane.press(X_CT, X_stuck, load), stamp)

    def no_contact(self, stamp: float) -> dict[str, TactileImages]:
        """Images with nothing in the grasp."""
        return {name: self.finger(name, None, stamp) for name in self.fingers}


class MeshRenderer(_Bubbles):
    """Both bubbles, from the nodes of their membranes."""

    def __init__(
        self,
        parameters: TactileParameters,
        hand: Hand,
        seed: int,
        free: Mapping[str, Nodes],
        lenses: Lenses | None = None,
    ) -> None:
        """free: both membranes with nothing in the grasp, by finger; lenses: as of TactileRenderer."""
        super().__init__(parameters, hand, lenses)
        self._views: dict[str, MeshView] = {}
        for name in self._names:
            rays, f = coarse_rays(self._lenses[name], hand, name), free[name]
            self._views[name] = MeshView(rays, mount(hand, name), f.nodes, f.triangles, f.material)
            self._add(name, rays, self._views[name].rest, seed)

    def render(self, bubbles: Mapping[str, Nodes], stamp: float) -> dict[str, TactileImages]:
        """Images of both membranes at time stamp [s]."""
        return {name: self.finger(name, bubbles[name].nodes, stamp) for name in self.fingers}

    def finger(self, name: str, nodes: Array | None, stamp: float) -> TactileImages:
        """Images of one finger whose nodes (n, 3) lie there in C [m]; None with nothing in the grasp."""
        view = self._views[name]
        return self.fingers[name].render(view.rest if nodes is None else view.shape(nodes), stamp)

    def no_contact(self, stamp: float) -> dict[str, TactileImages]:
        """Images with nothing in the grasp."""
        return {name: self.finger(name, None, stamp) for name in self.fingers}

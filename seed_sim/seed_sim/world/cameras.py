# SPDX-License-Identifier: Apache-2.0
"""What the cameras of one world deliver: true mounts, lenses and scale, a depth that lags, fingers that are skewed."""

from dataclasses import replace
from math import exp

import numpy as np

from seed_core.hand import FINGERS, Frame, Hand
from seed_core.spatial import Array, rpy_from_rotation, so3_exp
from seed_estimation import PinholeCamera, TactileImages
from seed_sim.bubble_renderer import HeldRenderer
from seed_sim.membrane.hold import MembraneHold
from seed_sim.scenario import Scenario, tactile_of
from seed_sim.tactile import TactileRenderer
from seed_sim.tactile.cameras import camera_model
from seed_sim.tactile.friction import Friction
from seed_sim.tactile.geometry import Image, dome_depth
from seed_sim.tactile.parameters import TactileParameters
from seed_sim.world.parameters import CameraWorld, ImageWorld, World

_FORGOTTEN = 5.0  # [time constants] after which nothing is left in the depth's filter


def true_hand(hand: Hand, world: World) -> Hand:
    """The hand as it is, where `hand` is what its drawing says."""
    cell, images = world.cell, world.images
    flange = _moved(hand.X_EC, np.deg2rad(cell.flange_turn_deg), 1e-3 * np.array(cell.flange_shift_mm))
    return replace(hand, E_C=flange, C_L=_mount(hand.X_CL, images.left), C_R=_mount(hand.X_CR, images.right))


def _mount(X_CX: Array, camera: CameraWorld) -> Frame:
    return _moved(X_CX, np.deg2rad(camera.turn_deg), 1e-3 * np.array(camera.shift_mm))


def _moved(X: Array, turn: Array, shift: Array) -> Frame:
    """X (4, 4) turned about its own origin by a rotation vector [rad] and shifted [m], both in the parent's axes."""
    R = so3_exp(turn) @ X[:3, :3]
    px, py, pz = (X[:3, 3] + shift).tolist()
    r, p, y = np.rad2deg(rpy_from_rotation(R)).tolist()
    return Frame((px, py, pz), (r, p, y))


def true_tactile(scenario: Scenario, world: World) -> TactileParameters:
    """Membrane and camera noise as they are."""
    p, images = tactile_of(scenario), world.images
    hold = 1e-3 * images.creep_hold_mm
    return replace(
        p, slip=max(p.slip, images.slip), range_offset=max(p.range_offset, images.range_error), hold=hold or p.hold
    )


class WorldCameras:
    """Both cameras of one world.

    Attributes:
        renderer: of the world as it is.
        parameters: membrane and noise as they are. hand, cameras: hand and lenses as they are believed.
        early: by finger, by how long its image of a pair is taken before the pair's time [s]; one of them is 0.
    """

    def __init__(self, scenario: Scenario, world: World, seed: int, hold: MembraneHold | None = None) -> None:
        """seed: of dots, fixed patterns and noise; hold: the membranes that are seen, if a plant has them already.

        Raises:
            MembraneError: the scenario's membranes cannot be inflated, or the tool pierces them.
        """
        p = true_tactile(scenario, world)
        self.parameters, self.hand = p, scenario.hand
        self.early = _early(world.images, 1.0 / scenario.measurement.rate)
        self.world, self._of = world.images, {"left": world.images.left, "right": world.images.right}
        self.cameras = {f: camera_model(p.camera) for f in FINGERS}
        lenses = {f: _with_focal(c, self._of[f].focal) for f, c in self.cameras.items()}
        hand = true_hand(scenario.hand, world)
        self.renderer: TactileRenderer | HeldRenderer
        if scenario.grasp.kind == "membrane":
            hold = hold or MembraneHold(scenario.membrane, scenario.tactile.tool)
            self.renderer = HeldRenderer(p, hand, seed, hold, lenses)
        else:
            self.renderer = TactileRenderer(p, hand, seed, lenses)
        self._filtered: dict[str, tuple[float, Image]] = {}  # by finger: when, and the depth
        self._aged = False
        reach = self.renderer.reach if isinstance(self.renderer, TactileRenderer) else 0.0
        self._friction = Friction(p.hold, p.kinetic, reach) if p.hold and reach else None

    def age(self) -> None:
        """What happens to membranes and cameras between the reference and the grasp."""
        self._aged = True
        if isinstance(self.renderer, TactileRenderer):
            for name, m in self.renderer.membranes.items():
                m.dome = dome_depth(m.rays, m.p, m.p.height + 1e-3 * self._of[name].shape_mm)

    def no_contact(self, t: float) -> dict[str, TactileImages]:
        """Images at time t [s] with nothing in the grasp."""
        return {f: self._seen(f, self.renderer.finger(f, None, t), t) for f in self.early}

    def render(self, X_CT: Array, t: float) -> dict[str, TactileImages]:
        """The pair of images of time t [s], with the tool resting at X_CT (4, 4)."""
        return {f: self.finger(f, X_CT, t) for f in self.early}

    def finger(self, name: str, X_CT: Array, t: float) -> TactileImages:
        """One finger's image of the pair of time t [s], with the tool at X_CT (4, 4) when it is taken."""
        if isinstance(self.renderer, HeldRenderer):
            return self._seen(name, self.renderer.finger(name, X_CT, t - self.early[name]), t)
        X_slid, load = None, 0.0
        if self._friction is not None:
            X_slid, load, _ = self._friction.step(X_CT, t - self.early[name])
        return self._seen(name, self.renderer.finger(name, X_CT, t, X_slid, load), t)

    def _seen(self, name: str, images: TactileImages, t: float) -> TactileImages:
        """With scale, drift and lag of the depth, and the stamp that the camera gives."""
        one, world = self._of[name], self.world
        taken = t - self.early[name]
        depth = images.depth * np.float32(1.0 + one.depth_scale)
        if self._aged and one.range_mm:
            depth = depth + np.float32(1e-3 * one.range_mm)
        if world.depth_lag > 0.0:
            depth = self._filter(name, depth, taken)
        return replace(images, depth=depth, stamp=(taken if world.skew_stamped else t) + world.clock)

    def _filter(self, name: str, depth: Image, t: float) -> Image:
        """First-order in time; a pixel without depth keeps what was there."""
        before = self._filtered.get(name)
        if before is not None and 0.0 <= t - before[0] < _FORGOTTEN * self.world.depth_lag:  # a grasp taken anew
            share = np.float32(1.0 - exp(-(t - before[0]) / self.world.depth_lag))
            old = before[1]
            state = old + share * (depth - old)
            state = np.where(np.isfinite(state), state, np.where(np.isfinite(depth), depth, old))
        else:
            state = depth
        self._filtered[name] = (t, state)
        return np.where(np.isfinite(depth), state, np.float32(np.nan))


def _early(images: ImageWorld, period: float) -> dict[str, float]:
    """By finger [s]. Images that tell their own times are paired with the nearest: no more than half a period apart."""
    skew = images.skew
    if images.skew_stamped:
        skew -= period * round(skew / period)
    return {"left": max(-skew, 0.0), "right": max(skew, 0.0)}


def _with_focal(camera: PinholeCamera, error: float) -> PinholeCamera:
    """The camera with its focal length changed by a relative error."""
    K = camera.K.copy()
    K[0, 0] *= 1.0 + error
    K[1, 1] *= 1.0 + error
    return PinholeCamera(camera.width, camera.height, K, camera.D, camera.model)

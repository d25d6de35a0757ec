# SPDX-License-Identifier: Apache-2.0
"""seed/Wipe-v0: wipe a strip of a table with a grasped squeegee, by hybrid set-points, 25 a second.

The controller of the suite runs inside, at 250 Hz: an action says what it shall do, not where the arm shall be.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray

from seed_core.errors import SeedError
from seed_core.hand import FINGERS
from seed_estimation.images.tactile_images import eight_bits
from seed_sim.closed_loop.relative_poses import ESTIMATORS, FROM_IMAGES
from seed_sim.learning.episode import WORLDS, Episode, Wanted, WorldName
from seed_sim.learning.picture import picture
from seed_sim.learning.strip import CELLS, FAILED, Strip
from seed_sim.scenario import load_scenario
from seed_sim.tactile.cameras import camera_model

MAX_FORCE, MAX_TORQUE, MAX_SPEED = 15.0, 0.5, 0.1  # [N], [N m], [m/s]: what an action of 1 asks for
Observation = dict[str, NDArray[Any]]


def action_of(
    force: float = 0.0, torque: float = 0.0, velocity: tuple[float, float, float] = (0, 0, 0)
) -> NDArray[Any]:
    """The action (5,) that asks for this force [N], torque [N m] and velocity [m/s] in the task frame."""
    scaled = (force / MAX_FORCE, torque / MAX_TORQUE, *(v / MAX_SPEED for v in velocity))
    return np.clip(np.array(scaled, np.float32), -1.0, 1.0)


class WipeEnv(gymnasium.Env[Observation, NDArray[Any]]):
    """A cell without ROS and without a clock. A seed of `reset` is an episode, bit for bit.

    Observation, in the task frame (origin at the strip's start, z out of the table):
        relative_pose: (6,) X_CT as estimated: rotation vector [rad], translation [m]. covariance: (6, 6) of it.
        wrench: (6,) torque [N m] and force [N] of the tool on the table about its tip, as estimated.
        slip: (1,) share of the tool's motion that the membrane does not follow. age: (1,) [s] of the estimate.
        arm_pose: (7,) flange as reported: position [m], quaternion x y z w. reference: (3,) [m] wanted tip.
        clean: (25,) 1 where the strip is clean.
        left, right: (171, 224) infrared; left_depth, right_depth: (171, 224) [m], 0 without a reading; with images.
    Action (5,), each -1 to 1: pressing force of 15 N (0 and below: none), torque about the tool's x of 0.5 N m while
        pressing, velocity of the tip along x, y and, while not pressing, z, of 0.1 m/s.
    Reward: share of the strip that became clean (passed with 10 N within 2 N), less 0.1 a second times the relative
        error of the force, at most 1. Terminated when all is clean, or with -1 when the arm holds: `reason` of info.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 25}

    def __init__(
        self,
        estimator: str | None = None,
        images: bool = False,
        world: WorldName = "known",
        scenario: str = "nominal",
        render_mode: str | None = None,
    ) -> None:
        """A cell; nothing is built before `reset`.

        Args:
            estimator: of the relative pose: truth, noisy, or one that works on images; default: noisy, or with images
                rigid_fit.
            images: observe the tactile images as well.
            world: known: what the controller believes, only the table is drawn; hidden: stiffness, hand, weight, table
                and cameras are drawn with each reset, and nobody is told.
            scenario: name or file.
            render_mode: rgb_array or None.

        Raises:
            SeedError: unknown names, or images without an estimator that makes them.
        """
        estimator = estimator or ("rigid_fit" if images else "noisy")
        if estimator not in ESTIMATORS:
            raise SeedError(f"estimator '{estimator}' is unknown; known: {', '.join(ESTIMATORS)}")
        if images and estimator not in FROM_IMAGES:
            raise SeedError(f"estimator '{estimator}' makes no images; with images: {', '.join(FROM_IMAGES)}")
        if world not in WORLDS:
            raise SeedError(f"world '{world}' is unknown; known: {', '.join(WORLDS)}")
        if render_mode not in (None, "rgb_array"):
            raise SeedError(f"render_mode '{render_mode}' is unknown; known: rgb_array")
        self._scenario = load_scenario(scenario)
        self._estimator, self._world, self._images, self.render_mode = estimator, world, images, render_mode
        self._episode: Episode | None = None
        self._strip = Strip()
        self.action_space = Box(-1.0, 1.0, (5,), np.float32)
        spaces: dict[str, gymnasium.Space[Any]] = {
            "relative_pose": _box(6, 1.0),
            "covariance": Box(-1.0, 1.0, (6, 6), np.float32),
            "wrench": _box(6, 200.0),
            "slip": Box(0.0, 1.0, (1,), np.float32),
            "age": Box(0.0, 1.0, (1,), np.float32),
            "arm_pose": _box(7, 2.0),
            "reference": _box(3, 1.0),
            "clean": Box(0.0, 1.0, (CELLS,), np.float32),
        }
        if images:
            shape = camera_model(self._scenario.tactile.camera).shape
            for finger in FINGERS:
                spaces[finger] = Box(0, 255, shape, np.uint8)
                spaces[f"{finger}_depth"] = Box(0.0, 2.0, shape, np.float32)
        self._spaces = spaces
        self.observation_space = Dict(spaces)  # type: ignore[assignment]  # Dict is no Space of dict there

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002  Gymnasium's
    ) -> tuple[Observation, dict[str, Any]]:
        """A new cell, its tool above the start of the strip, the controller enabled."""
        super().reset(seed=seed)
        self._episode = Episode(self._scenario, self._estimator, self._world, int(self.np_random.integers(2**31)))
        self._strip = Strip()
        return self._observed(self._episode), self._info(self._episode)

    def step(self, action: NDArray[Any]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """0.04 s of the cell.

        Raises:
            SeedError: before `reset`, or with an action that is not (5,) and finite.
        """
        episode = self._running()
        given = np.asarray(action, float)
        if given.shape != (5,) or not np.isfinite(given).all():
            raise SeedError(f"action {action} must be 5 finite numbers from -1 to 1: force, torque, velocity x, y, z")
        a = np.clip(given, -1.0, 1.0)
        wanted = Wanted(max(MAX_FORCE * float(a[0]), 0.0), MAX_TORQUE * float(a[1]), MAX_SPEED * a[2:])
        before = float(self._strip.clean.mean())
        episode.drive(wanted, self._strip)
        reward = self._strip.reward(before, 1.0 / episode.rate)
        failed = bool(episode.failure)
        if failed:
            reward += FAILED
        return self._observed(episode), reward, failed or self._strip.done, False, self._info(episode)

    def render(self) -> NDArray[np.uint8] | None:
        """The cell from the side, (240, 480, 3)."""
        return None if self.render_mode is None else picture(self._running(), self._strip)

    def _running(self) -> Episode:
        if self._episode is None:
            raise SeedError("no episode has begun: call reset first")
        return self._episode

    def _observed(self, e: Episode) -> Observation:
        estimate = e.estimate
        values: dict[str, Any] = {
            "relative_pose": e.relative_pose,
            "covariance": estimate.covariance,
            "wrench": e.wrench,
            "slip": [estimate.slip],
            "age": [e.state.image_age],
            "arm_pose": e.arm_pose,
            "reference": e.reference,
            "clean": self._strip.clean,
        }
        if self._images:
            for finger, pair in e.images.items():
                values[finger], values[f"{finger}_depth"] = eight_bits(pair.ir), np.nan_to_num(pair.depth)
        return {name: _within(self._spaces[name], value) for name, value in values.items()}

    def _info(self, e: Episode) -> dict[str, Any]:
        """What the policy is not to see: the truth, and in words what went wrong."""
        return {
            "time": e.time,
            "force": e.pressing_force,
            "lean": e.lean,
            "tip": e.tip_true,
            "mode": e.state.mode,
            "reason": e.failure,
            "refused": e.refusal,
            "success": self._strip.done,
        }


def _box(n: int, bound: float) -> Box:
    return Box(-bound, bound, (n,), np.float32)


def _within(space: Any, value: Any) -> NDArray[Any]:
    """The value in the space's bounds and type, an array of its own."""
    return np.asarray(np.clip(np.asarray(value, float), space.low, space.high), space.dtype)

# SPDX-License-Identifier: Apache-2.0
"""The Gymnasium environment: what it promises to those who learn on it."""

import warnings
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import seed_sim.learning
from seed_core.errors import SeedError
from seed_sim.learning.strip import CELLS, FORCE, FORCE_PRICE, LENGTH, Strip
from seed_sim.learning.wipe import WipeEnv, action_of

pytest.importorskip("pydrake", reason="needs Drake")

PRESS, DOWN = action_of(force=10.0), action_of(velocity=(0.0, 0.0, -0.1))


def flat(observation: dict[str, Any]) -> np.ndarray:
    return np.concatenate([np.ravel(observation[name]).astype(float) for name in sorted(observation)])


def episode(env: Any, seed: int, steps: int = 12) -> tuple[list[np.ndarray], list[float], dict[str, Any]]:
    """Random actions that press more often than not; observations, rewards, the last info."""
    rng = np.random.default_rng(1)
    observation, info = env.reset(seed=seed)
    seen, rewards = [flat(observation)], []
    for _ in range(steps):
        action = rng.uniform(-0.2, 1.0, 5) * (1.0, 0.2, 0.3, 0.3, 0.3)
        observation, reward, terminated, _, info = env.step(action)
        seen.append(flat(observation))
        rewards.append(reward)
        if terminated:
            break
    return seen, rewards, info


@pytest.mark.parametrize("name", seed_sim.learning.IDS)
def test_gymnasium_s_own_checker_passes(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # it warns of what it dislikes
        check_env(gymnasium.make(name, render_mode="rgb_array").unwrapped)


@pytest.mark.parametrize("name", seed_sim.learning.IDS)
def test_the_same_seed_is_the_same_episode_bit_for_bit_and_another_is_not(name: str) -> None:
    first, again = (episode(gymnasium.make(name).unwrapped, 5) for _ in range(2))
    assert len(first[0]) > 2
    for a, b in zip(first[0], again[0], strict=True):
        np.testing.assert_array_equal(a, b)
    assert first[1] == again[1]
    other = episode(gymnasium.make(name).unwrapped, 6)
    assert not np.array_equal(first[0][-1], other[0][-1])


def test_pressing_and_dragging_wipes_the_strip() -> None:
    env = WipeEnv(estimator="truth")
    observation, info = env.reset(seed=3)
    total, dragging, terminated, truth = 0.0, False, False, []
    while not terminated and info["time"] < 12.0:
        dragging = dragging or abs(observation["wrench"][5] + FORCE) < 1.0
        observation, reward, terminated, _, info = env.step(
            action_of(force=FORCE, velocity=(0.06 if dragging else 0.0, 0.0, 0.0))
        )
        total += reward
        if dragging:
            truth.append(info["force"])
    assert info["success"], info
    assert terminated
    assert observation["clean"].sum() == CELLS
    # 1 for the strip, less 0.1 a second while the force builds up, about a second and a half
    assert 0.8 < total < 1.0
    assert np.abs(np.array(truth[10:]) - FORCE).max() < 0.5  # [N]
    assert observation["wrench"][5] == pytest.approx(-info["force"], abs=0.2)  # the estimate is on the table: -z


def test_without_force_the_tip_follows_the_velocity_within_its_bounds() -> None:
    env = WipeEnv(estimator="truth")
    _, start = env.reset(seed=0)
    for _ in range(10):
        _, _, _, _, info = env.step(action_of(velocity=(0.05, 0.0, 0.0)))
    assert info["tip"][0] - start["tip"][0] == pytest.approx(0.4 * 0.05, abs=0.003)  # 0.4 s at 0.05 m/s
    for _ in range(10):
        observation, _, terminated, _, info = env.step(DOWN)
    assert not terminated
    assert observation["reference"][2] == pytest.approx(0.02, abs=1e-6)  # [m]: stays above the table
    assert info["force"] == 0.0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_quaternion_of_the_arm_goes_on_from_step_to_step_and_begins_alike(seed: int) -> None:
    env = WipeEnv()
    seen = [env.reset(seed=seed)[0]["arm_pose"][3:]]
    for _ in range(60):
        seen.append(env.step(PRESS)[0]["arm_pose"][3:])
    np.testing.assert_allclose(seen, [(1.0, 0.0, 0.0, 0.0)] * 61, atol=0.05)  # the hand points down


def test_the_pose_of_the_arm_is_the_one_that_the_controller_was_told(monkeypatch: pytest.MonkeyPatch) -> None:
    env, told = WipeEnv(estimator="truth"), []
    noisy = replace(env._scenario.measurement, kinematics_noise=1.0)  # [mm]
    env._scenario = replace(env._scenario, measurement=noisy)
    env.reset(seed=0)
    episode = env._running()
    add = episode._steering.controller.add_kinematics
    monkeypatch.setattr(
        episode._steering.controller, "add_kinematics", lambda t, X: (told.append(X[:3, 3].copy()), add(t, X))[1]
    )
    for _ in range(5):
        seen = (episode.X_work @ np.append(env.step(PRESS)[0]["arm_pose"][:3], 1.0))[:3]
        np.testing.assert_allclose(seen, told[-1], atol=1e-6)
    assert np.linalg.norm(seen - episode.plant.X_WE[:3, 3]) > 1e-4  # [m]


def test_a_hold_ends_the_episode_with_its_reason() -> None:
    env = WipeEnv(estimator="truth", scenario="nominal")
    env.reset(seed=0)
    env._running()._steering.controller.hold(env._running().time, "the gripper was opened")
    _, reward, terminated, truncated, info = env.step(PRESS)
    assert (terminated, truncated, info["success"]) == (True, False, False)
    assert info["reason"] == "the gripper was opened"
    assert reward < -0.9


def test_a_pass_cleans_only_with_the_wanted_force_and_wrong_force_costs() -> None:
    strip = Strip()
    strip.passed(np.array((0.5 * LENGTH / CELLS, 0.0, 0.0)), FORCE + 2.5)
    assert not strip.clean.any()
    assert strip.reward(0.0, 0.04) == pytest.approx(-FORCE_PRICE * 0.04 * 0.25)  # 2.5 N of 10 N off
    strip.passed(np.array((0.5 * LENGTH / CELLS, 0.0, 0.0)), FORCE)
    strip.passed(np.array((LENGTH + 0.001, 0.0, 0.0)), FORCE)  # beyond its end
    assert strip.clean.sum() == 1
    assert strip.clean[0]
    assert strip.reward(0.0, 0.04) == pytest.approx(1.0 / CELLS)


def test_an_action_asks_for_what_its_numbers_say() -> None:
    np.testing.assert_allclose(action_of(7.5, -0.25, (0.05, 0.0, -0.2)), (0.5, -0.5, 0.5, 0.0, -1.0))


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"estimator": "best"}, "known: truth, noisy"),
        ({"estimator": "truth", "images": True}, "makes no images"),
        ({"world": "open"}, "known: known, hidden"),
        ({"render_mode": "human"}, "known: rgb_array"),
        ({"scenario": "moon"}, "scenario 'moon' is unknown"),
    ],
)
def test_mistakes_are_told(given: dict[str, Any], says: str) -> None:
    with pytest.raises(SeedError, match=says):
        WipeEnv(**given)


def test_a_step_before_reset_or_with_another_action_is_told() -> None:
    env = WipeEnv(estimator="truth")
    with pytest.raises(SeedError, match="call reset first"):
        env.step(PRESS)
    env.reset(seed=0)
    for action in (np.zeros(4), np.full(5, np.nan)):
        with pytest.raises(SeedError, match="5 finite numbers"):
            env.step(action)

# SPDX-License-Identifier: Apache-2.0
"""Gymnasium environments around the closed loop without ROS; importing this registers them.

import gymnasium
import seed_sim.learning  # or gymnasium.make("seed_sim.learning:seed/Wipe-v0")

env = gymnasium.make("seed/Wipe-v0")
"""

from typing import Any

from gymnasium.envs.registration import register, registry

MAX_STEPS = 500  # of an episode: 20 s
IDS: dict[str, dict[str, Any]] = {
    "seed/Wipe-v0": {},
    "seed/WipeHidden-v0": {"world": "hidden"},
    "seed/WipeImages-v0": {"images": True},
}

for _id, _kwargs in IDS.items():
    if _id not in registry:
        register(_id, "seed_sim.learning.wipe:WipeEnv", max_episode_steps=MAX_STEPS, kwargs=_kwargs)

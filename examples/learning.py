# SPDX-License-Identifier: Apache-2.0
"""A policy in the Gymnasium environment: press, wait for the force, wipe (docs/learning.md).

The policy here is three lines by hand; any library that speaks Gymnasium takes the environment as it is. A world that
the controller does not know: "seed/WipeHidden-v0"; with the tactile images: "seed/WipeImages-v0".

    pip install ./seed_{core,ur,estimation,control,sysid,sim}
    python examples/learning.py
"""

import gymnasium

import seed_sim.learning  # registers seed/Wipe-v0 and its relatives
from seed_sim.learning.wipe import action_of

env = gymnasium.make("seed/Wipe-v0")
print(f"{', '.join(seed_sim.learning.IDS)}; actions {env.action_space.shape}")

for seed in range(3):
    observation, info = env.reset(seed=seed)  # the same seed is the same episode, bit for bit
    total, dragging, over = 0.0, False, False
    while not over:
        pressing = -observation["wrench"][5]  # [N]: the wrench is of the tool on the table, whose z points up
        dragging = dragging or abs(pressing - 10.0) < 1.0
        action = action_of(force=10.0, velocity=(0.05 if dragging else 0.0, 0.0, 0.0))
        observation, reward, terminated, truncated, info = env.step(action)
        total += reward
        over = terminated or truncated
    end = "wiped" if info["success"] else info["reason"] or "out of time"
    print(f"seed {seed}: {end} after {info['time']:.1f} s, return {total:.2f}, last force {info['force']:.2f} N")

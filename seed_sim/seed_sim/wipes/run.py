# SPDX-License-Identifier: Apache-2.0
"""One wipe under a condition, scored over all of it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from seed_sim.closed_loop.recording import Recording, rms
from seed_sim.closed_loop.run import SeedSteering, play, start_pose
from seed_sim.plant.arm import MovingTable
from seed_sim.plant.plant import Plant
from seed_sim.wipes.conditions import CONDITIONS, Condition
from seed_sim.wipes.poses import CorrelatedPoses

Rows = NDArray[np.bool_]


class Wipe(NamedTuple):
    """What a wipe came to, all of the plant's truth.

    Attributes:
        force: rms error of the force along the work frame's z [N]; the whole wanted force where it did not come to its
            end.
        worst: largest error [N]. lean: largest turn of the tool about the axes that hold their angle [degrees].
        unknowable: [N] mean error of the images' force over the wipe, which nothing else could tell.
        ended: why it did not come to its end, '' if it did.
    """

    condition: str
    seed: int
    force: float
    worst: float
    lean: float
    unknowable: float
    ended: str


def wipe(condition: str | Condition, seed: int, law: str = "seed") -> Wipe:
    """One wipe under that condition; the seed draws table, arm and noise."""
    c = CONDITIONS[condition] if isinstance(condition, str) else condition
    task, scenario = c.task(), c.scenario()
    plant = Plant(scenario, seed, task.frame.pose, start_pose(scenario, task))
    if c.amplitude:
        rng = np.random.default_rng([seed, 0x71])
        since, side = rng.uniform(0.0, 0.5 / c.frequency), rng.choice((-1.0, 1.0))
        plant.arm.error = MovingTable(plant.arm.error, side * c.amplitude, c.frequency, float(since))
    poses = CorrelatedPoses(scenario, seed, c.correlated, c.stated)
    recording = play(task, plant, SeedSteering(plant, scenario, law, "noisy", seed, poses))
    wiped = np.isin(recording["phase"], [i for i, name in enumerate(recording.phases) if name.startswith("wipe")])
    wanted = max(abs(p.control.force[2]) for p in task.phases if p.control is not None)
    if not recording.finished or not wiped.any():
        return Wipe(c.name, seed, wanted, wanted, _lean(recording), 0.0, recording.message)
    error = (recording["force"] - recording["wanted_force"])[wiped, 2]
    first, last = recording["t"][wiped][[0, -1]]
    noise = [e[2] for t, e in poses.noise if first <= t <= last]
    unknowable = scenario.grasp.stiffness.translation[2] * abs(float(np.mean(noise)))
    return Wipe(c.name, seed, rms(error), float(np.abs(error).max()), _lean(recording, wiped), unknowable, "")


def _lean(recording: Recording, rows: Rows | slice = slice(None)) -> float:
    held = [i for i in range(3) if not recording.torque_axes[i]]
    lean = recording["lean"][rows][:, held]
    return float(np.rad2deg(np.linalg.norm(lean, axis=1).max(initial=0.0)))

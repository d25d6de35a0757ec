# SPDX-License-Identifier: Apache-2.0
"""Up to which frequency the true force follows a wanted one that rises and falls."""

from math import sqrt

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, rotation_from_rpy
from seed_sim.closed_loop.run import SETTLE, SeedSteering
from seed_sim.plant.plant import Plant
from seed_sim.scenario import load_scenario
from seed_sim.wipes.poses import CorrelatedPoses

FREQUENCIES = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0)  # [Hz]
MEAN, AMPLITUDES = 10.0, (0.5, 1.0)  # [N] of the wanted force and of its sines
_WORK = make_pose(None, (0.45, 0.0, 0.0))
_START = 0.003  # [m] of the tip above the table
_HALF = sqrt(0.5)  # gain at half the power
_BEGINS, _COUNTS, _LASTS = 2.5, 3.5, 4.0  # [s] when the force begins to swing, when it counts, and for how long


def gain(frequency: float, seed: int, law: str = "seed", amplitude: float = AMPLITUDES[-1]) -> complex:
    """True over wanted force at a frequency [Hz], with phase; the tool stands, and the poses are noisy and late.

    amplitude: [N] of the wanted sine. What bounds a large one is the acceleration of the gripper.
    """
    scenario = load_scenario("nominal")
    X_W_tip = _WORK @ make_pose(rotation_from_rpy((np.pi, 0.0, 0.0)), (0.0, 0.0, _START))
    X_WE = X_W_tip @ inverse_pose(scenario.tool.X_Ttip) @ inverse_pose(scenario.hand.X_EC)
    plant = Plant(scenario, seed, _WORK, X_WE)
    steering = SeedSteering(plant, scenario, law, "noisy", seed, CorrelatedPoses(scenario, seed, 0.0, 1.0))
    times, forces = [], []
    for i in range(round((_COUNTS + _LASTS) * steering.rate)):
        t = i / steering.rate
        state = steering.sense(t)
        swing = amplitude * np.sin(2.0 * np.pi * frequency * (t - _BEGINS)) if t > _BEGINS else 0.0
        following = t > SETTLE and state.mode not in ("holding", "disabled")
        steering.steer(t, _pressing(X_W_tip, MEAN + swing) if following else None)
        if t >= _COUNTS:
            times.append(t)
            forces.append(-plant.contact_wrench.force[2])
    return _swing(np.array(times), np.array(forces), frequency) / amplitude


def _swing(t: Array, force: Array, frequency: float) -> complex:
    """Amplitude [N] with phase over whole periods, so that the mean is of no account."""
    n = round(np.floor(_LASTS * frequency) / frequency * len(t) / _LASTS)
    phase = 2.0 * np.pi * frequency * (t[:n] - _BEGINS)
    turning = np.exp(-1j * phase)
    return complex(2.0 * np.mean((force[:n] - force[:n].mean()) * turning) * 1j)


def _pressing(X_W_tip: Array, force: float) -> HybridSetpoint:
    load = Wrench(np.zeros(3), np.array((0.0, 0.0, -force)))
    about_x = (True, False, False)
    return HybridSetpoint(X_W_tip, load, np.diag((0.0, 0.0, 1.0)), about_x, contact_resists=about_x)


def bandwidth(gains: list[tuple[float, complex]]) -> float:
    """Frequency [Hz] up to which the gain stays above 1 / sqrt(2), between those that were measured (f, gain)."""
    before, above = 0.0, 1.0
    for frequency, g in gains:
        size = abs(g)
        if size < _HALF:
            return float(before + (frequency - before) * (above - _HALF) / (above - size))
        before, above = frequency, size
    return before

# SPDX-License-Identifier: Apache-2.0
"""What goes wrong in a run, drawn from its seed."""

from dataclasses import dataclass

import numpy as np

from seed_core.spatial import Array

KINDS = (
    "axis lost",
    "frozen poses",
    "late stamps",
    "cliff",
    "missing wall",
    "moving table",
    "initialized while pressing",
    "wrong masks",
    "arm holds",
)
_AXES = ((2,), (0,), (1,), (3,), (4,), (5,), (2, 5), (0, 1, 2))  # of `RelativePoseEstimate.observed`


@dataclass(frozen=True)
class Fault:
    """One run's set-point, and what is wrong.

    Attributes:
        kind: one of KINDS; seed: it was drawn from.
        force: (3,) [N] wanted of the tool on the environment, in the work frame, where it is not zero.
        torque_x: the torque about T's x is controlled, too.
        speed: [m/s] of wiping along x, from the first second of contact on; 0: standing.
        since: [s] from which moment on it is wrong.
        again: the operator enables once more, a second after a hold.
        axes: of `observed`, that are lost; told: their last value goes on being reported, else zero is.
        shift: [s] of the images' stamps.
        edge: [m] from where the tool first touches to the end of the table, along x.
        amplitude, frequency: [m], [Hz] of the table.
        share: of the poses that are far off; bias: (6,) turn and way [rad, m] of them, or of all.
    """

    kind: str
    seed: int
    force: Array
    torque_x: bool
    speed: float
    since: float
    again: bool
    axes: tuple[int, ...]
    told: bool
    shift: float
    edge: float
    amplitude: float
    frequency: float
    share: float
    bias: Array


def draw(kind: str, seed: int) -> Fault:
    """The fault of that kind and seed."""
    rng = np.random.default_rng([seed, KINDS.index(kind), 0xFA])
    size, side = float(rng.uniform(1.0, 15.0)), float(rng.uniform(0.3, 1.0))
    force = np.array((0.0, 0.0, -size))
    if kind == "missing wall":
        force = size * np.array((0.0, -side, -1.0)) / float(np.hypot(side, 1.0))
    speed = float(rng.uniform(0.02, 0.08)) * float(kind == "cliff" or rng.random() < 0.6)
    direction = rng.standard_normal(3)
    way = direction / np.linalg.norm(direction) * rng.uniform(1e-3, 12e-3)
    return Fault(
        kind=kind,
        seed=seed,
        force=force,
        torque_x=bool(rng.random() < 0.5) and kind != "missing wall",
        speed=speed,
        since=float(rng.uniform(0.6, 3.5)),
        again=bool(rng.random() < 0.5) or kind == "initialized while pressing",
        axes=_AXES[rng.integers(len(_AXES))],
        told=bool(rng.random() < 0.5),
        shift=float(rng.uniform(0.03, 0.25)) * (1.0 if rng.random() < 0.5 else -1.0),
        edge=float(rng.uniform(0.02, 0.08)) if kind == "cliff" else 2.0,
        amplitude=float(rng.uniform(2e-3, 8e-3)),
        frequency=float(rng.uniform(0.3, 2.0)),
        share=float(rng.uniform(0.1, 0.9)) if rng.random() < 0.5 else 1.0,
        bias=np.array((*(np.deg2rad(5.0) * rng.standard_normal(3)), *way)),
    )

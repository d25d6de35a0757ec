# SPDX-License-Identifier: Apache-2.0
"""The draw of a world from its seed: every value uniform within the ranges below."""

from dataclasses import replace

import numpy as np

from seed_core.errors import SeedError
from seed_core.hand import FINGERS
from seed_core.vector3 import Vector3
from seed_sim.world.parameters import (
    KINDS,
    CameraWorld,
    CellWorld,
    ImageWorld,
    Kind,
    ProcedureWorld,
    SpringWorld,
    World,
)

STIFFNESS = 0.05  # relative, either way, each axis
STIFFENING = 0.15  # at full deflection
HYSTERESIS = 0.06  # of full scale
CENTRE_MM = 3.0  # either way, each axis
MOUNT_DEG, MOUNT_MM = 0.5, 0.5  # either way, each axis of each camera
FOCAL, DEPTH_SCALE = 0.01, 0.01  # relative, either way, each camera
SHAPE_MM = 0.2  # either way, each membrane
DEPTH_LAG = 0.040  # [s] from 0
CLOCK = 0.010  # [s] either way
LATE = 0.100  # [s] from 0, in draws with late stamps
SKEW = 0.015  # [s] from 0
MASS = 0.03  # relative, either way
SLIP = 0.10  # from 0
FLANGE_MM, FLANGE_DEG = 0.5, 0.25  # either way, each axis
DOME = 0.02  # relative, either way: rim along x, rim along z, height
TILT_DEG = 3.0  # of the table, either way, each axis
FRICTION = (0.1, 0.8)  # of the table


def draw_world(seed: int, kind: Kind = "spring", *, late_stamps: bool = False) -> World:
    """The world of a seed.

    Args:
        seed: of the draw.
        kind: 'spring', or 'membrane': the grasp is two membranes with mechanics, drawn from the same seed.
        late_stamps: stamps are 0 to 100 ms late, instead of 10 ms either way.

    Raises:
        SeedError: the kind is unknown.
    """
    if kind not in KINDS:
        raise SeedError(f"kind '{kind}' of a world is unknown; known: {', '.join(KINDS)}")
    rng = np.random.default_rng([seed, 0x301D])

    def either(bound: float) -> float:
        return float(rng.uniform(-bound, bound))

    def axes(bound: float) -> Vector3:
        return either(bound), either(bound), either(bound)

    def camera() -> CameraWorld:
        return CameraWorld(axes(MOUNT_DEG), axes(MOUNT_MM), either(FOCAL), either(DEPTH_SCALE), either(SHAPE_MM))

    turn, shift = axes(STIFFNESS), axes(STIFFNESS)
    world = World(
        kind=kind,
        seed=seed,
        spring=SpringWorld(
            scale=(1.0 + turn[0], 1.0 + turn[1], 1.0 + turn[2], 1.0 + shift[0], 1.0 + shift[1], 1.0 + shift[2]),
            stiffening=STIFFENING,
            hysteresis=HYSTERESIS,
            centre_mm=axes(CENTRE_MM),
        ),
        images=ImageWorld(
            left=camera(),
            right=camera(),
            depth_lag=float(rng.uniform(0.0, DEPTH_LAG)),
            clock=float(rng.uniform(0.0, LATE)) if late_stamps else either(CLOCK),
            skew=float(rng.uniform(0.0, SKEW)),
            skew_stamped=bool(rng.integers(2)),
            slip=float(rng.uniform(0.0, SLIP)),
            range_error=1.0,
        ),
        cell=CellWorld(
            flange_shift_mm=axes(FLANGE_MM),
            flange_turn_deg=axes(FLANGE_DEG),
            mass=either(MASS),
            tilt_deg=TILT_DEG,
            friction=float(rng.uniform(*FRICTION)),
        ),
        procedures=ProcedureWorld(dome=axes(DOME), run=True),
    )
    return _on_membranes(world) if kind == "membrane" else world


def _on_membranes(world: World) -> World:
    """Without what membranes with mechanics bring themselves, and with cameras whose range was calibrated elsewhere."""
    sides = {f: replace(getattr(world.images, f), shape_mm=0.0) for f in FINGERS}
    images = replace(world.images, slip=0.0, range_error=0.0, **sides)
    return replace(world, spring=SpringWorld(), images=images)

# SPDX-License-Identifier: Apache-2.0
"""The table's shape of one seed."""

from math import pi, radians, tan

import numpy as np

from seed_core.spatial import Array
from seed_sim.plant.surfaces.section import SurfaceSection
from seed_sim.plant.surfaces.shapes import Corner, Plane, Ridge, Round, Saddle, Shape, Waves

_WAVES = 12


def draw_shapes(section: SurfaceSection, edge: float, rng: np.random.Generator) -> tuple[tuple[Shape, ...], float]:
    """The bodies that make the table, and by how much they are turned about z [rad].

    Args:
        section: kind of shape, and the ranges that it is drawn from.
        edge: [m] where a plane ends, along x.
        rng: of the seed.
    """
    radius, at, turn = rng.uniform(*section.radius), rng.uniform(*section.at), radians(rng.uniform(*section.turn))
    match section.kind:
        case "cylinder" | "sphere":
            return (Round(radius, at, section.kind == "sphere", section.hollow),), turn
        case "saddle":
            return (Saddle(radius, at),), turn
        case "relief":
            return (_waves(section, rng),), turn
        case "wedge":
            angle = radians(section.angle)
            return (Plane(), Ridge(at + section.rise, section.rise * tan(angle), angle)), turn
        case "step":
            height = 1e-3 * section.step
            upper = Corner(at, height, -1.0) if height > 0.0 else Corner(at, 0.0, 1.0)
            return (Plane() if height > 0.0 else Corner(at, height, -1.0), upper), turn
    return (Corner(edge, 0.0, 1.0),), 0.0


def _waves(section: SurfaceSection, rng: np.random.Generator) -> Waves:
    slope, heading = np.tan(np.deg2rad(rng.uniform(*section.slope))), rng.uniform(0.0, 2.0 * pi, _WAVES)
    numbers = 2.0 * pi / rng.uniform(*section.wavelength, _WAVES)  # [rad/m]
    phases: Array = rng.uniform(0.0, 2.0 * pi, _WAVES)
    # each wave adds (amplitude number)^2 / 2 to the mean square of the slope: all of them alike
    amplitudes = slope * np.sqrt(2.0 / _WAVES) / numbers
    waves = numbers[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    return Waves(waves, amplitudes, phases, -float(amplitudes @ np.cos(phases)))

# SPDX-License-Identifier: Apache-2.0
"""The soft grasp of the plant: stiffness, damping and pressure by gripper width, and what step can integrate it."""

from math import ceil

import numpy as np

from seed_core.bushing import Stiffness
from seed_core.errors import SeedError
from seed_core.hand import FINGERS, GripperPressure
from seed_core.spatial import Array, skew
from seed_sim.plant.tools import ToolInertia
from seed_sim.scenario import GraspSection

MOST_SUBSTEPS = 10
_WEAKEST, _FIRMEST = 0.3, 4.0  # times the nominal stiffness


class PlantError(SeedError):
    """A plant that cannot be simulated."""


class Grip:
    """The bushing's constants at the present gripper width: a firmer grip is a stiffer one (Sec. VI of the paper).

    Attributes:
        width: [m] between the fingers.
        substeps: parts that a step of the plant is cut into.
    """

    def __init__(self, grasp: GraspSection, inertia: ToolInertia | None, step: float, name: str) -> None:
        """The grip at its nominal width on a tool; inertia is None for a tool that is welded to the gripper.

        Raises:
            PlantError: no step that is small enough.
        """
        self._grasp, self._inertia, self._step = grasp, inertia, step
        self._pressure = GripperPressure(grasp.nominal_width, grasp.nominal_pressure, grasp.pressure_slope)
        self._firmness = 1.0  # stiffness relative to that at the nominal width
        self.width = grasp.nominal_width
        self.substeps = 1 if inertia is None else self._cut_step(inertia, name)

    def _cut_step(self, inertia: ToolInertia, name: str) -> int:
        """The bushing is integrated explicitly, which is stable only while rate x step < 1."""
        rate = fastest_rate(inertia, self.stiffness, self._grasp.damping_ratio)
        parts = max(ceil(rate * self._step / 0.5), 1)
        if parts > MOST_SUBSTEPS:
            raise PlantError(
                f"scenario '{name}': the grasp's fastest mode, {rate:.0f} rad/s, would need {parts} "
                f"sub-steps of a millisecond, at most {MOST_SUBSTEPS} are taken: give the tool the inertia of the "
                "gripper pads (grasp.pad_mass, grasp.pad_radius), or less stiffness or damping"
            )
        return parts

    @property
    def stiffness(self) -> Stiffness:
        """Of the grasp at this width."""
        return self._grasp.stiffness.scaled(self._firmness)

    @property
    def damping(self) -> tuple[Array, Array]:
        """Constants (3,) [N m s/rad] and (3,) [N s/m] of the grasp at this width."""
        assert self._inertia is not None
        return damping_of(self._inertia, self.stiffness, self._grasp.damping_ratio)

    @property
    def pressures(self) -> dict[str, float]:
        """In each bubble at this width [hPa]."""
        return dict.fromkeys(FINGERS, self.pressure)

    @property
    def pressure(self) -> float:
        """In the bubbles at this width [hPa]."""
        return self._pressure.at_width(self.width)

    @property
    def push(self) -> float:
        """Of each finger on the tool [N]."""
        return self.push_at(self.width)

    @property
    def rise(self) -> float:
        """Of that push per closed metre of width [N/m]."""
        return self._grasp.grip_rise

    def push_at(self, width: float) -> float:
        """Of each finger [N] with the fingers at a width [m] that the grip is not told of yet."""
        return max(self._grasp.grip_force + self.rise * (self._grasp.nominal_width - width), 0.0)

    def set_width(self, width: float) -> None:
        """Close to width [m].

        Raises:
            PlantError: the stiffness would leave 0.3 to 4 times the nominal one, or cannot be integrated.
        """
        g = self._grasp
        firmness = 1.0 + g.stiffening * (g.nominal_width - width)
        if not _WEAKEST <= firmness <= _FIRMEST:
            narrow, wide = sorted(g.nominal_width + (1.0 - f) / g.stiffening for f in (_WEAKEST, _FIRMEST))
            raise PlantError(
                f"gripper width = {width:.4f} m must be from {max(narrow, 0.0):.4f} to {wide:.4f} m: beyond, the grip "
                f"would not be {_WEAKEST:g} to {_FIRMEST:g} times as stiff as at {g.nominal_width:.4f} m"
            )
        if self._inertia is not None:
            rate = fastest_rate(self._inertia, g.stiffness.scaled(firmness), g.damping_ratio)
            if (product := rate * self._step / self.substeps) >= 0.95:
                raise PlantError(
                    f"so firm a grip cannot be integrated with this tool (rate x step = {product:.2f}, below "
                    "0.95 is needed): close less"
                )
        self.width, self._firmness = width, firmness


def damping_of(inertia: ToolInertia, stiffness: Stiffness, ratio: float) -> tuple[Array, Array]:
    """Constants (3,) [N m s/rad] and (3,) [N s/m] with the given damping ratio on each axis by itself."""
    rotation = 2.0 * ratio * np.sqrt(np.array(stiffness.rotation) * np.diag(inertia.about_T))
    return rotation, 2.0 * ratio * np.sqrt(np.array(stiffness.translation) * inertia.moving_mass)


def fastest_rate(inertia: ToolInertia, stiffness: Stiffness, ratio: float) -> float:
    """Fastest rate of a tool held by a bushing of that damping ratio on each axis, see `rate_of`."""
    D = np.diag(np.concatenate(damping_of(inertia, stiffness, ratio)))
    return rate_of(inertia, np.diag(stiffness.vector()), D)


def rate_of(inertia: ToolInertia, K: Array, D: Array) -> float:
    """Fastest rate of the held tool [rad/s, 1/s]: an explicit step dt follows it only while rate dt < 1.

    From the eigenvalues of the damped linear system, rotation and translation coupled by the centre of mass; K and D
    (6, 6) of rotation, translation [N m/rad, N/m] and [N m s/rad, N s/m].
    """
    M, m = np.zeros((6, 6)), inertia.moving_mass
    c = m * skew(inertia.moving_com)
    M[:3, :3], M[:3, 3:], M[3:, :3], M[3:, 3:] = inertia.about_T, c, -c, m * np.eye(3)
    A = np.block([[np.zeros((6, 6)), np.eye(6)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    return float(np.abs(np.linalg.eigvals(A)).max())

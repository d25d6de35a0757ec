# SPDX-License-Identifier: Apache-2.0
"""Mass and centre of mass of the tool, from how it hangs in the grasp in free space in a few orientations.

At rest in free space the spring carries the weight, about T's origin and written in T:

    force = -m g_T,    torque = -com x m g_T,    g_T = R_TW (0, 0, -g)

Both are linear, in m and in m com. Only the product of stiffness and deflection is seen: a wrong stiffness gives a
wrong mass in proportion. A known mass turns that around and checks the vertical stiffness.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from seed_core.bushing import Bushing
from seed_core.errors import SeedError
from seed_core.hand import GRAVITY, UPRIGHT
from seed_core.spatial import Array, Wrench, inverse_pose, skew

_LEAST_TURN = np.deg2rad(10.0)  # between orientations, for the whole centre of mass


class PayloadError(SeedError):
    """The tool cannot be weighed from these samples."""


@dataclass(frozen=True)
class Payload:
    """Result of a payload identification.

    Attributes:
        mass, mass_std: [kg].
        center_of_mass, center_of_mass_std: (3,) in T [m]; along directions that no orientation showed it is zero, with
            an infinite deviation.
        residual: root mean square of what the model leaves of the forces [N].
        stiffness_ratio: force expected of the known mass over force measured; 1 if the stiffness is right. None
            without a known mass.
    """

    mass: float
    mass_std: float
    center_of_mass: Array
    center_of_mass_std: Array
    residual: float
    stiffness_ratio: float | None = None


class PayloadFit:
    """Collects samples (X_WT, X_CT) of a tool at rest in free space; `result` fits them."""

    def __init__(self, bushing: Bushing, up: ArrayLike = UPRIGHT) -> None:
        """up: (3,) against gravity, in W."""
        self._bushing, self._up = bushing, np.asarray(up)
        self._g: list[Array] = []  # of each sample, in T [m/s^2]
        self._springs: list[Wrench] = []

    def add(self, X_WT: Array, X_CT: Array, spring: Wrench | None = None) -> None:
        """One sample: the tool's pose in the world, and in the grasp, each (4, 4).

        spring: load on the tool about T's origin, in T, by another model than the bushing.
        """
        self._g.append(-GRAVITY * (self._up @ X_WT[:3, :3]))
        self._springs.append(self._bushing.wrench(inverse_pose(X_CT)) if spring is None else spring)

    def result(self, known_mass: float | None = None) -> Payload:
        """Least squares over all samples; known_mass [kg] cross-checks the stiffness.

        Raises:
            PayloadError: fewer than 10 samples, or a tool too light for the noise.
        """
        if len(self._g) < 10:
            raise PayloadError(f"{len(self._g)} samples are too few to weigh the tool; hold still for at least 10")
        g, force = np.array(self._g), np.array([s.force for s in self._springs])
        mass = -float((g * force).sum() / (g * g).sum())
        residuals = force + mass * g
        sigma = float(np.sqrt((residuals**2).sum() / max(residuals.size - 1, 1)))
        mass_std = sigma / float(np.sqrt((g * g).sum()))
        if mass < 3.0 * mass_std or mass <= 0.0:
            raise PayloadError(
                f"the tool weighs {1e3 * mass:.1f} g, not distinguishable from nothing "
                f"(deviation {1e3 * mass_std:.1f} g): is it grasped, and hanging free?"
            )
        com, com_std = self._center_of_mass(g, mass)
        size = float(np.sqrt((residuals**2).mean()))
        return Payload(mass, mass_std, com, com_std, size, known_mass / mass if known_mass is not None else None)

    def _center_of_mass(self, g: Array, mass: float) -> tuple[Array, Array]:
        """com of torque = m g x com ... = skew(m g) com; what no orientation shows stays zero."""
        A = np.concatenate([skew(mass * gi) for gi in g])
        b = np.concatenate([s.torque for s in self._springs])
        U, s, Vt = np.linalg.svd(A, full_matrices=False)
        seen = s > np.sin(_LEAST_TURN) * s[0] / 2.0
        inverse = np.where(seen, 1.0 / np.where(seen, s, 1.0), 0.0)
        com = Vt.T @ (inverse * (U.T @ b))
        rest = b - A @ com
        sigma = float(np.sqrt((rest @ rest) / max(len(b) - 3, 1)))
        unseen = (np.abs(Vt[~seen]) > 1e-9).any(axis=0)
        return np.asarray(com), np.where(unseen, np.inf, sigma * np.sqrt(Vt.T**2 @ inverse**2))

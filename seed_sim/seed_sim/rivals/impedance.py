# SPDX-License-Identifier: Apache-2.0
"""Cartesian impedance with torques: no position servo; a spring and damper to the path, a wanted force along free axes.

What libfranka's examples and UR's direct torque control make: F = K (x_ref - x) - D x', with K = 0 along free axes and
the wanted load there, and an integral of what the estimated load misses (libfranka's force_control example).
The arm obeys up to what its joints' friction leaves: UR's direct_torque compensates 70 to 80 % of the Coulomb friction
by default (script manual, coulomb_scale); users see small torques move nothing (forum.universal-robots.com/t/42062).
Franka's data sheet states a guiding force of about 2 N and a stiffness of 10 to 3000 N/m, 1 to 300 N m/rad.
"""

from dataclasses import dataclass

import numpy as np

from seed_core.config import field
from seed_core.spatial import Array
from seed_sim.rivals.law import Wanted

PERIOD = 0.001  # [s] of a torque interface
HELD = np.array((300.0,) * 3 + (3000.0,) * 3)  # [N m/rad, N/m] of held axes: the largest that the data sheet has
MASS = 4.0  # [kg] of the arm as seen at the tip: ours, of an arm of 18 kg that is half stretched out
INERTIA = 0.1  # [kg m^2] likewise
HELD_DAMPING = 1.4 * np.sqrt(HELD * np.array((INERTIA,) * 3 + (MASS,) * 3))  # [N m s/rad, N s/m]
STICTION_SPEED = np.array((5e-3,) * 3 + (5e-4,) * 3)  # [rad/s, m/s] above which friction is fully there
_LARGEST = 20.0  # [N] of the integral's force: anti wind-up


@dataclass(frozen=True)
class ImpedanceSettings:
    """What a user sets along free axes."""

    damping: float = field(300.0, unit="N s/m", low=1.0, high=1e5, doc="along free axes")
    integral: float = field(2.0, unit="1/s", low=0.0, high=100.0, doc="gain on what the estimated load misses")
    lever: float = field(0.1, unit="m", low=0.01, high=1.0, doc="at which the damping counts for rotation")


class Impedance:
    """The law: load (6,) that the arm's motors are told to make, from errors of pose and speed."""

    def __init__(self, settings: ImpedanceSettings) -> None:
        s = self.settings = settings
        self._damping = s.damping * np.array((s.lever * s.lever,) * 3 + (1.0,) * 3)
        self._integral = np.zeros(6)

    def step(self, wanted: Wanted, measured: Array, off: Array, speed: Array) -> Array:
        """Commanded load (6,) [N m, N].

        Args:
            wanted: on the free axes.
            measured: estimated load of the tool on the environment (6,).
            off: of the tip from its reference (6,) [rad, m].
            speed: of the tip (6,) [rad/s, m/s].
        """
        free, held = wanted.free, 1.0 - wanted.free
        more = self._integral + PERIOD * self.settings.integral * wanted.error(measured)
        self._integral = np.clip(more, -_LARGEST, _LARGEST)
        pushed = wanted.load + self._integral - self._damping * speed
        return np.asarray(free * pushed - held * (HELD * off + HELD_DAMPING * speed))

    def reset(self) -> None:
        """Pose control again."""
        self._integral = np.zeros(6)


@dataclass(frozen=True)
class JointFriction:
    """What friction compensation leaves at the tip."""

    force: float = field(1.0, unit="N", low=0.0, high=50.0, doc="Coulomb, along each axis")
    torque: float = field(0.1, unit="N m", low=0.0, high=10.0, doc="Coulomb, about each axis")


FRANKA = JointFriction(1.0, 0.1)
"""Half of the guiding force that the data sheet states."""

UR_DIRECT_TORQUE = JointFriction(3.0, 0.3)
"""A fifth of the Coulomb friction of a UR5e's large joints, 6 to 12 N m, at a lever of 0.5 m."""


class TorqueArm:
    """The arm's motion at the tip under the commanded load, friction and what the environment does to it."""

    def __init__(self, friction: JointFriction, bias: Array) -> None:
        """bias: (6,) [N m, N] by which the motors miss what they are told, along all axes."""
        self._friction = np.array((friction.torque,) * 3 + (friction.force,) * 3)
        self._inertia = np.array((INERTIA,) * 3 + (MASS,) * 3)
        self._bias = bias
        self.speed = np.zeros(6)  # [rad/s, m/s]

    def step(self, commanded: Array, on_environment: Array) -> Array:
        """Way (6,) [rad, m] of the tip in one PERIOD, under commanded load and load of the tool on the environment."""
        driving = commanded + self._bias - on_environment
        # implicit in friction's slope, which is steep at rest
        slope = PERIOD * self._friction / (self._inertia * STICTION_SPEED)
        free = self.speed + PERIOD * driving / self._inertia
        slow = free / (1.0 + slope)
        lost = PERIOD * self._friction / self._inertia
        self.speed = np.where(np.abs(slow) < STICTION_SPEED, slow, free - np.sign(free) * lost)
        return np.asarray(PERIOD * self.speed)

# SPDX-License-Identifier: Apache-2.0
"""What pulls at a held tool: sudden pulls, knocks, heavy tools that are lifted, and membranes that become slippery."""

from dataclasses import dataclass
from math import cos, hypot, pi, sin

import numpy as np

from seed_core.spatial import Array, Wrench
from seed_sim.membrane import MembraneParameters, random_membrane
from seed_sim.tactile.parameters import HANDLE, ToolShape

KINDS = ("pull", "heavy", "knock", "slippery")
TOOLS = (HANDLE, ToolShape(), ToolShape())  # a cylinder is drawn twice as often
_START = 0.25  # [s] of rest
RADIUS = 0.010  # [m] by which torque about y counts in a drawn size
_ASIDE = np.deg2rad(30.0)  # from the tool's axis, at most: further aside a tool is locked by its shape


@dataclass(frozen=True)
class Pull:
    """One grasp and what pulls at it.

    Attributes:
        membrane, tool, mass: what is held; mass [kg] moves with the tool.
        strength: peak of the load over what friction of the first grip bears.
        direction: (3,) in C. lever: [m] of the load about y.
        rise, stay, fall: [s] of the load. repeats: times that it comes. friction: factor on friction at its peak.
    """

    kind: str
    seed: int
    membrane: MembraneParameters
    tool: ToolShape
    mass: float
    strength: float
    direction: tuple[float, float, float]
    lever: float
    rise: float
    stay: float
    fall: float
    repeats: int = 1
    friction: float = 1.0

    @property
    def begins(self) -> float:
        """[s]"""
        return _START

    @property
    def ends(self) -> float:
        """When the load is gone [s]."""
        return _START + self.repeats * self._period - (self._period - self.rise - self.stay - self.fall)

    @property
    def _period(self) -> float:
        return self.rise + self.stay + self.fall + 0.4

    def share(self, t: float) -> float:
        """Of the peak at t [s]; smooth at both ends."""
        since = t - _START
        if since <= 0.0 or since >= self.repeats * self._period:
            return 0.0
        since %= self._period
        if since < self.rise:
            return 0.5 - 0.5 * cos(pi * since / self.rise)
        since -= self.rise + self.stay
        if since < 0.0:
            return 1.0
        return 0.5 + 0.5 * cos(pi * since / self.fall) if since < self.fall else 0.0

    def peak(self, grip: float) -> float:
        """[N] of the force, where each finger pushes with grip [N] at first."""
        return self.strength * 2.0 * self.membrane.friction * grip / hypot(1.0, self.lever / RADIUS)

    def load(self, t: float, grip: float) -> Wrench:
        """On the tool about T's origin, in C, at t [s]."""
        share = self.share(t) if self.kind != "slippery" else float(t > 0.0) * min(t / _START, 1.0)
        force = share * self.peak(grip) * np.array(self.direction)
        return Wrench(np.array((0.0, self.lever * float(np.linalg.norm(force)), 0.0)), force)

    def friction_at(self, t: float) -> float:
        """Coulomb's coefficient at t [s]."""
        return self.membrane.friction * (1.0 + (self.friction - 1.0) * self.share(t))


def draw(kind: str, seed: int) -> Pull:
    """A grasp and a pull of one of KINDS, drawn from a seed."""
    rng = np.random.default_rng((seed, KINDS.index(kind), 0x6219))
    angle = float(rng.uniform(-_ASIDE, _ASIDE))
    sign = float(rng.choice((-1.0, 1.0)))
    times = {name: float(rng.uniform(*bounds)) for name, bounds in _TIMES[kind].items()}
    return Pull(
        kind=kind,
        seed=seed,
        membrane=random_membrane(int(rng.integers(1 << 30)), 0.008),
        tool=TOOLS[int(rng.integers(len(TOOLS)))],
        mass=float(rng.uniform(0.15, 0.35)),
        strength=float(rng.uniform(*_STRENGTH[kind])),
        direction=(sin(angle), 0.0, sign * cos(angle)),
        lever=float(rng.uniform(-0.006, 0.006)),
        rise=times["rise"],
        stay=times["stay"],
        fall=times["fall"],
        repeats=2 if kind == "knock" else 1,
        friction=float(rng.uniform(0.45, 0.6)) if kind == "slippery" else 1.0,
    )


_STRENGTH = {"pull": (1.2, 1.9), "heavy": (1.1, 1.6), "knock": (1.3, 1.9), "slippery": (0.65, 0.75)}
_TIMES: dict[str, dict[str, tuple[float, float]]] = {
    "pull": {"rise": (0.1, 0.4), "stay": (0.2, 0.5), "fall": (0.1, 0.3)},
    "heavy": {"rise": (0.3, 0.7), "stay": (0.5, 0.8), "fall": (0.2, 0.4)},
    "knock": {"rise": (0.03, 0.08), "stay": (0.02, 0.05), "fall": (0.03, 0.08)},
    "slippery": {"rise": (0.1, 0.3), "stay": (0.4, 0.6), "fall": (0.1, 0.3)},
}


def tool_inertia(pull: Pull) -> Array:
    """(6, 6) about T's origin: torque, force."""
    M = np.zeros((6, 6))
    M[:3, :3] = pull.mass * np.diag((0.04, 0.02, 0.04)) ** 2
    M[3:, 3:] = pull.mass * np.eye(3)
    return M

# SPDX-License-Identifier: Apache-2.0
"""What is kept of a simulated run to look at it: ten moments a second, each some hundred numbers."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

from seed_core.spatial import Array, Wrench

if TYPE_CHECKING:
    from seed_sim.plant.plant import Plant

INTERVAL = 0.1  # [s] between two moments
LONGEST = 9000  # moments: the last 15 minutes are kept


class Moment(NamedTuple):
    """The cell at one time.

    Attributes:
        t: [s] since the film began.
        X_WE, X_CT: (4, 4) flange, and tool in the grasp.
        q: (6,) joint angles [rad]; none of an arm without joints.
        wrench: of the tool on what it touches, about the tip, in the world.
        nodes: of the membranes by finger (n, 3) in C [m]; none where the grasp is a spring.
    """

    t: float
    X_WE: Array
    X_CT: Array
    q: tuple[float, ...]
    wrench: Wrench
    nodes: dict[str, Array]


class Film:
    """Moments of a run; given to a `Plant`, which shows it every step.

    Attributes:
        moments: the last ones, oldest first.
    """

    def __init__(self) -> None:
        self.moments: deque[Moment] = deque(maxlen=LONGEST)
        self._last = float("-inf")  # [s] of the plant
        self._t = -INTERVAL

    def look(self, plant: Plant) -> None:
        """Keep this moment if the last is long enough ago; a plant that was reset goes on in the film."""
        if 0.0 <= plant.time - self._last < INTERVAL - 1e-9:
            return
        self._last, self._t = plant.time, self._t + INTERVAL
        hold = plant.membranes
        nodes = {} if hold is None else {f: b.nodes.copy() for f, b in hold.state.bubbles.items()}
        q = tuple(float(a) for a in plant.arm.q)
        X_WE = plant.X_WE.copy()
        self.moments.append(Moment(self._t, X_WE, plant.X_CT.copy(), q, plant.contact_wrench, nodes))

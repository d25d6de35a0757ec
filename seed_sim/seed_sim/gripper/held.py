# SPDX-License-Identifier: Apache-2.0
"""A tool between two membranes in a gripper that stands still, in time: what happens as something pulls at it.

One solve of the membranes per step; the tool's motion is implicit in their tangent, so a step may be long.
"""

from typing import NamedTuple

import numpy as np

from seed_core.errors import SeedError
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, so3_exp
from seed_estimation.slip.incipient import edge_weights
from seed_sim.gripper.pulls import Pull, tool_inertia
from seed_sim.membrane import GraspState, MembraneError, MembraneGrasp
from seed_sim.membrane.grasp import SIDES
from seed_sim.membrane.state import push_of

DT = 0.005  # [s]
WIDTH = 0.02  # [m] of the fingers at the first grip
SLID = 0.005  # [m] on the membranes from which a grasp counts as broken
_DAMPING = 0.3  # ratio, as the plant's grasps
_MOST_STEP = 0.004  # [m] of the tool in a step


class TornError(SeedError):
    """The tool has left the grasp."""


class TrueSlip(NamedTuple):
    """How far the membranes do not follow the tool: share of its motion, the same at the edge, and way [m]."""

    share: float
    incipient: float
    slid: float


class HeldTool:
    """Membranes, tool and time. `advance` steps; what is attributes is the truth.

    Attributes:
        t: [s]. X_CT: (4, 4). state: of the membranes. grip: [N] of each finger, mean. slid: [m] on the membranes.
    """

    def __init__(self, pull: Pull, squeeze: float | None = None, start: float = 0.0) -> None:
        """Closed on the tool, at rest, at time start [s]. squeeze: [m], by default the membrane's own.

        Raises:
            MembraneError: the membranes cannot be closed on it.
        """
        self.pull = pull
        self._grasp = MembraneGrasp(pull.membrane, pull.tool)
        self.first = self._squeeze = pull.membrane.squeeze
        self.state = self._grasp.close(pull.membrane.squeeze)
        self.grip = self.first_grip = push_of(self.state)
        if squeeze is not None:
            self._squeeze = squeeze
            self.state = self._grasp.close(squeeze)
            self.grip = push_of(self.state)
        self._rest: GraspState = self.state
        self.t, self.X_CT, self.slid = start, np.eye(4), 0.0
        self._V: Array = np.zeros(6)
        self._M = tool_inertia(pull)
        self._edges = {finger: _edge_weights(self._rest, finger) for finger in SIDES}

    def squeeze_at(self, width: float) -> float:
        """Imprint [m] at a width [m]."""
        return self.first + 0.5 * (WIDTH - width)

    def stiffness_at(self, squeezes: list[float]) -> list[tuple[Array, float]]:
        """As an identification finds them: stiffness (6,) and grip [N] at each imprint [m]. Restarts the grasp."""
        found = []
        for squeeze in squeezes:
            state = self._grasp.close(squeeze)
            found.append((np.maximum(np.diag(state.tangent), 1e-3), push_of(state)))
        self.state = self._grasp.close(self._squeeze)
        return found

    def advance(self, width: float | None = None) -> None:
        """One step DT; width [m] of the fingers at its end, if they move. Raises TornError."""
        R = self.X_CT[:3, :3]
        load = self.pull.load(self.t + DT, self.first_grip).rotated(R.T).vector()
        K = self.state.tangent
        D = 2.0 * _DAMPING * np.diag(np.sqrt(np.maximum(np.diag(K), 1e-3) * np.diag(self._M)))
        right = self._M @ self._V / DT + self.state.wrench.vector() + load
        V = np.linalg.solve(self._M / DT + D + DT * K, right)
        length = DT * float(np.linalg.norm(V[3:]) + 0.04 * np.linalg.norm(V[:3]))
        self._V = np.asarray(V * min(1.0, _MOST_STEP / max(length, 1e-12)))
        motion = self._V * DT
        self.X_CT = self.X_CT @ make_pose(so3_exp(motion[:3]), motion[3:])
        self.t += DT
        friction = self.pull.friction_at(self.t)
        for bubble in self._grasp.bubbles.values():
            bubble.contact.friction = friction * bubble.p.friction / self.pull.membrane.friction
        if width is not None:
            self._squeeze = self.squeeze_at(width)
        try:
            self.state = self._grasp.solve(self.X_CT, self.t, self._squeeze)
        except MembraneError as error:
            raise TornError(str(error)) from error
        if not self.state.converged:
            self.X_CT = self.state.X_CT.copy()  # it waits for the next step where it was
        self.grip = push_of(self.state)
        self.slid = self.slip().slid
        if self.slid > SLID:
            raise TornError(f"the tool slid by more than {1e3 * SLID:g} mm")

    def slip(self) -> TrueSlip:
        """How far both membranes do not follow the tool since the grasp."""
        _, lag, move = self._lags()
        edge = np.concatenate([self._edges[finger] for finger in SIDES])[:, None]
        size, at_edge = float((move**2).sum()), float(((edge * move) ** 2).sum())
        if size < len(move) * 1e-4**2:
            return TrueSlip(0.0, 0.0, 0.0)
        slid = float(np.sqrt(np.square(lag).sum(axis=1).mean()))
        return TrueSlip(float((lag * move).sum()) / size, float((lag * edge * move).sum()) / max(at_edge, 1e-12), slid)

    def lag(self) -> Array:
        """Turn about y [rad] and shift along x and z (3,) [m] in which both membranes, as one body, do not follow."""
        places, lag, _ = self._lags()
        x, z, one, zero = places[:, 0], places[:, 1], np.ones(len(lag)), np.zeros(len(lag))
        body = np.concatenate((np.column_stack((z, one, zero)), np.column_stack((-x, zero, one))))
        return np.asarray(np.linalg.lstsq(body, lag.T.ravel(), rcond=None)[0])

    def _lags(self) -> tuple[Array, Array, Array]:
        """Nodes that touched at first, along the patches: places, what they lag behind, the tool's motion [m]."""
        places, lags, moves = [], [], []
        for finger in SIDES:
            held = self._rest.bubbles[finger].touching
            p0 = self._rest.bubbles[finger].nodes[held]
            moves.append((p0 @ self.X_CT[:3, :3].T + self.X_CT[:3, 3] - p0)[:, ::2])
            lags.append(moves[-1] - (self.state.bubbles[finger].nodes[held] - p0)[:, ::2])
            places.append(p0[:, ::2])
        return np.concatenate(places), np.concatenate(lags), np.concatenate(moves)

    @property
    def spring(self) -> Wrench:
        """True load of the grasp on the tool about T's origin, in C."""
        return self.state.wrench.rotated(self.X_CT[:3, :3])

    @property
    def X_TC(self) -> Array:
        """(4, 4)"""
        return inverse_pose(self.X_CT)


def _edge_weights(state: GraspState, finger: str) -> Array:
    bubble = state.bubbles[finger]
    p = bubble.nodes[bubble.touching][:, ::2].astype(np.float32)
    return edge_weights(p, p)

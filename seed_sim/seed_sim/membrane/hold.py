# SPDX-License-Identifier: Apache-2.0
"""A grasp of two membranes along one run: solved once per time and pose, for plant, images and pressures alike."""

import numpy as np

from seed_core.spatial import Array, Wrench, make_pose, so3_exp
from seed_sim.membrane.grasp import MembraneGrasp
from seed_sim.membrane.parameters import MembraneError, MembraneParameters
from seed_sim.membrane.state import GraspState
from seed_sim.tactile.parameters import ToolShape

_PATIENCE = 0.5, 25  # [s] and solves in a row that may not settle
_SETTLED = 1e-3  # [N, and N m over 0.1 m] of a load that is looked for
_LOOKS = 25  # solves of that search


class MembraneHold:
    """The tool between both membranes, from the closing of the gripper on.

    Attributes:
        state: of the last solve.
        grasped: the state right after closing, at X_CT = identity.
        free: both bubbles with nothing in the grasp, by finger.
        solves, unsettled: how many since the grasp, and how many of them found no equilibrium and kept the last one.
        most_sliding: largest share of the touching nodes that slid since.
    """

    def __init__(self, parameters: MembraneParameters, tool: ToolShape) -> None:
        """Inflates the bubbles and closes on the tool.

        Raises:
            MembraneError: the membranes cannot be inflated, or the tool pierces them.
        """
        self._grasp = MembraneGrasp(parameters, tool)
        self.parameters, self.tool, self.free = parameters, tool, self._grasp.free()
        self.close(parameters.squeeze)

    def close(self, squeeze: float, t: float = 0.0) -> None:
        """Open the gripper and close it on the tool anew, to an imprint of `squeeze` [m], at time t [s].

        Raises:
            MembraneError: the tool pierces the membranes, or they find no equilibrium.
        """
        self.grasped = self._grasp.close(squeeze)
        self._closed = self._grasp.save()
        self.restart(t)

    @property
    def time(self) -> float:
        """Of the last solve [s]."""
        return self._at[1]

    def restart(self, t: float = 0.0) -> None:
        """Right after the closing of the gripper again, at time t [s]."""
        self._grasp.restore(self._closed, t)
        self.state = self.grasped
        self.solves = self.unsettled = self._failed = 0
        self._settled = t  # [s] of the last solve before some that did not
        self.most_sliding = 0.0
        self._at = (np.eye(4), t)

    def at(self, X_CT: Array, t: float) -> GraspState:
        """With the tool moved on to X_CT (4, 4) at time t [s]; asked for the same once more, the same is told.

        Raises:
            MembraneError: the tool pierces a membrane, or no equilibrium is found for long.
        """
        before, then = self._at
        if t <= then and np.array_equal(before, X_CT):
            return self.state
        self._at = (X_CT.copy(), max(t, then))
        self.state = self._grasp.solve(X_CT, self._at[1])
        self._count()
        return self.state

    def squeeze(self, squeeze: float) -> GraspState:
        """Close or open the fingers to an imprint of `squeeze` [m], with the tool where it is. Raises MembraneError."""
        self.state = self._grasp.set_squeeze(squeeze)
        if not self.state.converged:
            raise MembraneError(f"the membranes find no equilibrium with squeeze = {squeeze:g} m: close less")
        return self.state

    def under(self, load: Wrench) -> Array:
        """X_CT (4, 4) at which the membranes bear the load: their wrench on the tool about T, in T, is minus it.

        Raises:
            MembraneError: they do not bear it.
        """
        X = self.state.X_CT.copy()
        for _ in range(_LOOKS):
            off = self.state.wrench.vector() + load.vector()
            if np.abs(off * np.repeat((10.0, 1.0), 3)).max() < _SETTLED:
                return X
            motion = np.linalg.solve(self.state.tangent, off)  # of T relative to C, in T: against the spring
            length = np.linalg.norm(motion[3:]) + 0.04 * np.linalg.norm(motion[:3])
            motion *= min(1.0, 0.002 / max(float(length), 1e-12))
            X = X @ make_pose(so3_exp(motion[:3]), motion[3:])
            self.at(X, self._at[1])
        raise MembraneError(
            f"the membranes do not bear {np.round(load.vector(), 3)} (N m, N): {np.abs(off).max():.2g} is left over"
        )

    @property
    def pressures(self) -> dict[str, float]:
        """Absolute pressure in each bubble [hPa]."""
        return {name: 0.01 * (self.parameters.ambient + b.pressure) for name, b in self.state.bubbles.items()}

    def _count(self) -> None:
        self.solves += 1
        if self.state.converged or self._failed == 0:
            self._settled = self._at[1]
        self.most_sliding = max(self.most_sliding, self.state.sliding_share)
        if self.state.converged:
            self._failed = 0
            return
        self.unsettled += 1
        self._failed += 1
        lasting = self._at[1] - self._settled
        if self._failed >= _PATIENCE[1] and lasting >= _PATIENCE[0]:
            raise MembraneError(
                f"the membranes find no equilibrium, {self._failed} times in a row for {lasting:.2f} s: the tool is "
                "torn out of the grasp; load it less or squeeze more"
            )

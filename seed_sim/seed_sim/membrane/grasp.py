# SPDX-License-Identifier: Apache-2.0
"""Two bubbles on one tool, along the path of the tool in the hand."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array, Wrench, inverse_pose, skew, so3_exp, so3_log
from seed_sim.membrane.bubble import Bubble, Memory
from seed_sim.membrane.mesh import ellipse_mesh
from seed_sim.membrane.parameters import MembraneError, MembraneParameters
from seed_sim.membrane.state import BubbleState, GraspState
from seed_sim.membrane.surface import ToolSurface
from seed_sim.tactile.parameters import ToolShape

SIDES = {"left": 1.0, "right": -1.0}  # of each finger along y_C
_ARM = 0.04  # [m] at which a rotation moves the membrane
_CUTS = 5  # halvings of a step that does not settle
# Times the longest step: one way to where an equilibrium ends may settle where another does not
_TRIES = (1.0, 0.7, 0.45)
_FARTHEST = 1.0  # [m] of the tool from the grasp
_BALANCED, _YIELDS = 0.01, 6  # [N] by which one finger may push more, and in how many steps the hand gives way


class Saved(NamedTuple):
    """A grasp to come back to."""

    bubbles: tuple[Memory, ...]
    X_CT: Array
    squeeze: float
    aside: float  # [m] along y of C: of the middle of both fingers
    t: float


class MembraneGrasp:
    """Both bubbles on the tool. Path-dependent: friction remembers where the tool has been.

    Attributes:
        height: [m] of the free, inflated dome over its rim.
        squeeze: [m] imprint of the tool in each free bubble at X_CT = identity; mean of both.
    """

    def __init__(self, parameters: MembraneParameters, tool: ToolShape) -> None:
        """Inflates both bubbles, away from the tool.

        Raises:
            MembraneError: the membrane cannot be inflated.
        """
        self.parameters, self.tool = parameters, tool
        self.surface = ToolSurface(tool, parameters.edge)
        self.mesh = ellipse_mesh(parameters.rim_x, parameters.rim_z, parameters.spacing)
        self.bubbles = {name: Bubble(parameters.of(s), self.mesh, self.surface, s) for name, s in SIDES.items()}
        self.height = min(b.free_height for b in self.bubbles.values())
        self.squeeze = self._aside = 0.0
        self._X_CT = np.eye(4)
        self._t = 0.0
        self._closed = False
        self._blank = self.save()

    # -- geometry ------------------------------------------------------------------------------------------------------
    def rim(self, squeeze: float) -> float:
        """Distance of each rim's plane from C [m], where both bubbles are alike."""
        return self.tool.radius - squeeze + self.height

    def _place(self, side: float, squeeze: float) -> float:
        """y in C [m] of a rim's plane."""
        return side * self.rim(squeeze) + self._aside

    def _pose_of(self, side: float, X_TC: Array, squeeze: float) -> tuple[Array, Array]:
        """R_TF, p_TF of a bubble."""
        R = X_TC[:3, :3]
        return R, X_TC[:3, 3] + R[:, 1] * self._place(side, squeeze)

    def _check(self, X_CT: Array, squeeze: float) -> Array:
        """X_TC; refuses what is no pose, and a tool that would pass through a rim's plane."""
        if X_CT.shape != (4, 4) or not np.isfinite(X_CT).all():
            raise MembraneError("X_CT must be a (4, 4) pose of finite numbers")
        if not 0.0 <= squeeze < self.height:
            raise MembraneError(
                f"squeeze = {squeeze:g} m: the tool pierces the membrane; must be at least 0 m and less than the free "
                f"dome's height {self.height:.4g} m"
            )
        distance = float(np.linalg.norm(X_CT[:3, 3]))
        if distance > _FARTHEST:
            raise MembraneError(f"the tool lies {distance:.3g} m from the grasp, more than {_FARTHEST:g} m")
        X_TC = inverse_pose(X_CT)
        plane = self.mesh.flat
        for name, side in SIDES.items():
            rim = np.column_stack([plane[:, 0], np.full(len(plane), self._place(side, squeeze)), plane[:, 1]])
            depth = -float(self.surface.distance(rim @ X_TC[:3, :3].T + X_TC[:3, 3]).min())
            depth = max(depth, float(side * (X_CT[1, 3] - self._place(side, squeeze))))
            if depth > 0.0:
                raise MembraneError(
                    f"the tool pierces the {name} membrane: it passes the plane of the rim by {depth:.3g} m (most: 0); "
                    "move it less or lower the squeeze"
                )
        return X_TC

    # -- API -----------------------------------------------------------------------------------------------------------
    def free(self) -> dict[str, BubbleState]:
        """Both bubbles with nothing in the grasp, with the rims where the parameters' squeeze puts them."""
        now = self.save()
        self._recall(self._blank)
        try:
            return {name: self._bubble_state(name, self.parameters.squeeze) for name in SIDES}
        finally:
            self._recall(now)

    def close(self, squeeze: float | None = None) -> GraspState:
        """Close on the tool at X_CT = identity, from apart; the hand gives way until both fingers push alike.

        Raises:
            MembraneError: the tool pierces a membrane, or no equilibrium is found.
        """
        goal = self.parameters.squeeze if squeeze is None else squeeze
        self._check(np.eye(4), goal)
        self._recall(self._blank)
        self.squeeze, self._X_CT, self._closed = 0.0, np.eye(4), True
        state = self._travel(np.eye(4), goal, self._t)
        for _ in range(_YIELDS):
            push = float(state.wrench.force[1])
            if not state.converged or abs(push) < _BALANCED:
                break
            self._aside -= push / float(state.tangent[4, 4])
            state = self._travel(np.eye(4), goal, self._t)
        if not state.converged:
            self._recall(self._blank)
            self._closed = False
            raise MembraneError(
                f"the membranes find no equilibrium when closing to squeeze = {goal:g} m (reached "
                f"{state.bubbles['left'].pressure:.0f} Pa); lower the squeeze or `step`"
            )
        return state

    def set_squeeze(self, squeeze: float) -> GraspState:
        """Close or open the fingers with the tool where it is; squeeze [m]."""
        return self._travel(self._X_CT, squeeze, self._t)

    def solve(self, X_CT: Array, t: float = 0.0, squeeze: float | None = None) -> GraspState:
        """Move the tool to X_CT (4, 4) by time t [s]; where no equilibrium is found the last good state stays.

        squeeze: [m] to which the fingers close or open at the same time; None: they stay.

        Raises:
            MembraneError: not closed, X_CT is no pose, or the tool pierces a membrane.
        """
        return self._travel(np.asarray(X_CT, float), self.squeeze if squeeze is None else squeeze, t)

    def save(self) -> Saved:
        """The state, to come back to."""
        return Saved(tuple(b.memory() for b in self.bubbles.values()), self._X_CT, self.squeeze, self._aside, self._t)

    def restore(self, state: Saved, t: float | None = None) -> None:
        """Come back to a saved state, as if it had come about at time t [s]; default: when it was saved."""
        self._recall(state)
        self._closed = state is not self._blank
        if t is not None:
            self._t = t
            for bubble in self.bubbles.values():
                bubble.t = t

    def energy(self) -> float:
        """[J] of sheets, gas and normal contact springs, up to a constant."""
        return sum(b.energy() for b in self.bubbles.values())

    # -- path ----------------------------------------------------------------------------------------------------------
    def _recall(self, state: Saved) -> None:
        for bubble, memory in zip(self.bubbles.values(), state.bubbles, strict=True):
            bubble.recall(memory)
        self._X_CT, self.squeeze, self._aside, self._t = state.X_CT, state.squeeze, state.aside, state.t

    def _travel(self, X_CT: Array, squeeze: float, t: float) -> GraspState:
        if not self._closed:
            raise MembraneError("the grasp is not closed yet: call close() first")
        X_TC = self._check(X_CT, squeeze)
        before = self.save()
        X0, s0 = inverse_pose(self._X_CT), self.squeeze
        turn = so3_log(X_TC[:3, :3] @ X0[:3, :3].T)
        shift = X_TC[:3, 3] - X0[:3, 3]
        length = float(np.linalg.norm(shift)) + _ARM * float(np.linalg.norm(turn)) + abs(squeeze - s0)
        steps = max(1, math.ceil(length / self.parameters.step))

        def place(share: float) -> tuple[Array, float]:
            X = np.eye(4)
            X[:3, :3] = so3_exp(share * turn) @ X0[:3, :3] if share < 1.0 else X_TC[:3, :3]
            X[:3, 3] = X0[:3, 3] + share * shift
            return X, s0 + share * (squeeze - s0)

        for bubble in self.bubbles.values():
            bubble.iterations = 0
        for shorter in _TRIES:
            for bubble in self.bubbles.values():
                bubble.age(t)
            converged = all(self._moves(bubble, place, shorter / steps) for bubble in self.bubbles.values())
            if converged:
                break
            self._recall(before)
        iterations = sum(b.iterations for b in self.bubbles.values())
        if converged:
            self._X_CT, self.squeeze, self._t = X_CT.copy(), squeeze, t
        return self._state(iterations, converged)

    def _moves(self, bubble: Bubble, place: Callable[[float], tuple[Array, float]], longest: float) -> bool:
        """Take a bubble along a way in steps of at most so large a share of it; whether it settles at the end.

        place: X_TC (4, 4) and squeeze [m] at a share of the way.
        """
        done, part = 0.0, longest
        least = part * 0.5**_CUTS
        while done < 1.0 - 1e-9:
            share = min(1.0, done + part)
            X, squeeze = place(share)
            if bubble.move(self._pose_of(bubble.side, X, squeeze), jump=0.5 * part < least):
                bubble.linearise()
                done, part = share, min(2.0 * part, longest)
                continue
            part *= 0.5
            if part < least:
                return False
        return True

    # -- state ---------------------------------------------------------------------------------------------------------
    def _bubble_state(self, name: str, squeeze: float) -> BubbleState:
        bubble, out = self.bubbles[name], np.array((0.0, self._place(SIDES[name], squeeze), 0.0))
        touching, patch = bubble.touching()
        return BubbleState(
            bubble.x + out, self.mesh.triangles, self.mesh.flat, touching, patch + out, *bubble.areas(),
            bubble.pressure, bubble.volume, bubble.wrench(),
        )  # fmt: skip

    def _state(self, iterations: int, converged: bool) -> GraspState:
        X_TC = inverse_pose(self._X_CT)
        tangent, wrench = np.zeros((6, 6)), Wrench.zero()
        for bubble in self.bubbles.values():
            _, origin = self._pose_of(bubble.side, X_TC, self.squeeze)
            shift = np.eye(6)
            shift[3:, :3] = -skew(origin - X_TC[:3, 3])
            tangent += bubble.tangent @ shift
            wrench = wrench.plus(bubble.wrench())
        states = {name: self._bubble_state(name, self.squeeze) for name in SIDES}
        return GraspState(self._X_CT, states, wrench, tangent, iterations, converged)

# SPDX-License-Identifier: Apache-2.0
"""One bubble: its equilibrium with gas and tool, by Newton's method along the path of the tool.

Frame F of the bubble lies at the middle of its rim, with C's axes. The unknowns are the nodes in F.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array, Wrench
from seed_sim.membrane.band import Band, Factors
from seed_sim.membrane.contact import Contact, ContactLoad, Mask
from seed_sim.membrane.gas import add_curvature, area_vectors, volume
from seed_sim.membrane.mesh import Index, SheetMesh, moulded_dome
from seed_sim.membrane.parameters import MembraneError, MembraneParameters
from seed_sim.membrane.sheet import Corners, Sheet
from seed_sim.membrane.surface import ToolSurface

_MOST = 40  # Newton steps of one solve
_CALM = 8  # of them that may leave more unbalanced than before
_HALVINGS = 5  # of a step that leaves more unbalanced
_TURNS = 12  # of friction and equilibrium
_LAGGED = 0.02  # [N] unbalanced with friction of the turn before
_JUMP, _OIL = 150, 50.0  # steps of a patch that lets go in a jump, and [N/m] damping of the first
_ENOUGH = 10.0  # [tolerances] that will do where no step comes nearer
_WORTH = 0.45  # share of the unbalanced forces that a step with old factors may leave
_LONGEST = 0.5  # [spacings] that a node moves in one Newton step
_DEEPEST = 0.0025  # [m] that a node may lie inside the tool
_AT_NODES = 0.25  # share of the sheet that may touch at nodes; the rest may in the middle of their sides
_STRETCH = 4.0  # [1] Green's strain at which rubber is torn: a stretch of 3


Pose = tuple[Array, Array]  # R_TF (3, 3) and p_TF (3,) [m]


class Memory(NamedTuple):
    """All that a bubble remembers."""

    x: Array
    anchors: Array
    crept: Array
    content: float  # [J] absolute pressure times volume
    contact: ContactLoad | None
    pose: Pose | None
    factors: Factors | None
    sensitivity: Array | None
    tangent: Array
    t: float


class Bubble:
    """One bubble in its own frame F.

    Attributes:
        x: (n, 3) [m] nodes in F. volume: [m^3] of the dome. pressure: [Pa] above the ambient.
        height: [m] of the free, inflated dome. iterations: Newton steps of the last call.
    """

    def __init__(self, p: MembraneParameters, mesh: SheetMesh, surface: ToolSurface, side: float) -> None:
        """side: +1 for the left bubble, whose dome points to -y, -1 for the right one."""
        self.p, self.mesh, self.side = p, mesh, side
        reference = moulded_dome(mesh, p, side)
        # the triangles run so that their area vectors point outwards
        self.triangles = mesh.triangles if side > 0.0 else mesh.triangles[:, ::-1]
        self.sheet = Sheet(reference, self.triangles, p.Et, p.poisson)
        ends, area = _places(self.sheet, ~mesh.rim)
        self._band = Band(self.triangles, ~mesh.rim, mesh.flat, ends)
        self.contact = Contact(surface, ends, area, p.friction, p.normal_stiffness, p.shear_stiffness)
        self.x = reference
        self.content: float | None = None  # [J]; unknown until the bubble is inflated
        self.iterations = 0
        self.load: ContactLoad | None = None
        self._pose: Pose | None = None
        self._factors_now: Factors | None = None
        self._sensitivity: Array | None = None
        self._nearest = math.inf, self.x  # [N] unbalanced, and nodes of the last move
        self.tangent = np.zeros((6, 6))
        self.t = 0.0
        self._inflate()

    # -- state ---------------------------------------------------------------------------------------------------------
    def memory(self) -> Memory:
        """All that the path has left, to come back to."""
        return Memory(
            self.x, self.contact.anchors, self.sheet.crept, self._content(), self.load, self._pose, self._factors_now,
            self._sensitivity, self.tangent, self.t,
        )  # fmt: skip

    def recall(self, memory: Memory) -> None:
        """Come back to what `memory` held."""
        self.x, self.contact.anchors, self.sheet.crept, self.content = memory[:4]
        self.load, self._pose, self._factors_now, self._sensitivity, self.tangent, self.t = memory[4:]

    def _content(self) -> float:
        if self.content is None:
            raise MembraneError("the bubble holds no gas yet")
        return self.content

    @property
    def volume(self) -> float:
        """[m^3] with the dead volume."""
        return volume(self.sheet.corners(self.x)) + self.p.dead_volume

    @property
    def pressure(self) -> float:
        """[Pa] above the ambient."""
        return self._content() / self.volume - self.p.ambient

    @property
    def height(self) -> float:
        """[m] of the dome's highest node over the rim's plane."""
        return float((-self.side * self.x[:, 1]).max())

    # -- equilibrium ---------------------------------------------------------------------------------------------------
    def _inflate(self) -> None:
        """From the moulded shape to the gauge pressure, then close the valve."""
        p = self.p
        for share in (0.25, 0.5, 0.75, 1.0, 1.0):  # the last one with the sheet crept
            if not self._settle(None, share * p.pressure):
                raise MembraneError(
                    f"the membrane cannot be inflated to pressure = {p.pressure:g} Pa with Et = {p.Et:g} N/m and "
                    f"moulded = {p.moulded:g} m: no equilibrium at {share * p.pressure:g} Pa; raise Et or lower it"
                )
            self._bear()
            if share == 1.0:
                self.sheet.crept = p.creep * self.sheet.strain(self.x)
        if p.creep > 0.0 and not self._settle(None, p.pressure):
            raise MembraneError(
                f"the membrane does not settle after creep = {p.creep:g} at pressure = {p.pressure:g} Pa"
            )
        self.content = (p.pressure + p.ambient) * self.volume
        self.free_height = self.height

    def _bear(self) -> None:
        """Refuse a sheet that is stretched to tearing."""
        strain = float(np.abs(self.sheet.strain(self.x)[:, :2]).max())
        if not strain < _STRETCH:
            stretch, most = math.sqrt(1.0 + 2.0 * strain), math.sqrt(1.0 + 2.0 * _STRETCH)
            raise MembraneError(
                f"the membrane is stretched by {stretch:.3g} at pressure = {self.p.pressure:g} Pa, at most {most:.3g}: "
                f"raise Et = {self.p.Et:g} N/m or lower the pressure"
            )

    def _gas(self, corners: Corners, gauge: float | None) -> tuple[float, float]:
        """Gauge pressure [Pa] and its fall per volume [Pa/m^3]."""
        if gauge is not None:
            return gauge, 0.0
        whole = volume(corners) + self.p.dead_volume
        absolute = self._content() / whole
        return absolute - self.p.ambient, absolute / whole

    def residual(self, x: Array, pose: Pose | None, gauge: float | None = None) -> tuple[Array, ContactLoad | None]:
        """Unbalanced forces (n, 3) [N] at nodes x, sheet minus gas minus tool (at the rim: its reaction); contact."""
        c = self.sheet.corners(x)
        force = self.sheet.load(x, stiffness=False, corners=c).force
        force -= self._gas(c, gauge)[0] * area_vectors(c, self.sheet)
        touch = self._touch(x, pose, force)
        return force, touch

    def _touch(self, x: Array, pose: Pose | None, force: Array) -> ContactLoad | None:
        """Contact with the tool at `pose`; subtracts its forces from `force` (n, 3)."""
        if pose is None:
            return None
        R, origin = pose
        touch = self.contact.load(x @ R.T + origin, stiffness=False)
        force -= self._at_nodes(touch, touch.force @ R)
        return touch

    def _at_nodes(self, touch: ContactLoad, values: Array) -> Array:
        """(n, ...) sums at the nodes of what acts on the ends of touching places (k, 2, ...)."""
        size = math.prod(values.shape[2:])
        at = self.contact.ends[touch.places].reshape(-1, 1) * size + np.arange(size)
        flat = np.bincount(at.ravel(), values.ravel(), len(self.x) * size)
        return np.asarray(flat.reshape(len(self.x), *values.shape[2:]), float)

    def _factors(
        self, x: Array, pose: Pose | None, gauge: float | None, damping: float, touch: ContactLoad | None = None
    ) -> Factors:
        """Of the equations' slope at nodes x; damping [N/m] goes onto its diagonal; touch: the contact, if known."""
        c = self.sheet.corners(x)
        K = self.sheet.load(x, corners=c).stiffness
        assert K is not None
        pressure, fall = self._gas(c, gauge)
        add_curvature(c, -pressure, K)
        places, blocks = np.empty(0, int), np.empty((0, 2, 2, 3, 3))
        if pose is not None:
            R, origin = pose
            touch = touch or self.contact.load(x @ R.T + origin)
            assert touch.stiffness is not None
            places, blocks = touch.places, R.T @ touch.stiffness @ R
        band = self._band.matrix(K, places, blocks)
        self._band.add_diagonal(band, damping)
        return Factors(self._band, band, fall, area_vectors(c, self.sheet).ravel()[self._band.rows])

    def _settle(
        self,
        pose: Pose | None,
        gauge: float | None = None,
        x: Array | None = None,
        factors: Factors | None = None,
    ) -> bool:
        """Newton's method from x (default: the present nodes); moves the nodes and returns True where it settles.

        Factors serve as long as each step with them takes enough of the unbalanced forces away.
        """
        x = self.x if x is None else x
        rows, cap = self._band.rows, _LONGEST * self.p.spacing
        last, step, halvings, best = math.inf, np.zeros(len(rows)), 0, (math.inf, x)
        for count in range(_MOST):
            whole, touch = self.residual(x, pose, gauge)
            force = whole.ravel()[rows]
            norm = math.sqrt(float(force @ force))
            if not math.isfinite(norm):
                return False
            if norm < self.p.tolerance:
                self.x, self.load = x, touch
                return True
            best = min(best, (norm, x), key=lambda b: b[0])
            if count > _CALM and norm > last and halvings < _HALVINGS:
                # nodes that stick and slip in turn, or touch and leave: the equilibrium lies between
                halvings += 1
                step *= 0.5
                x = x.copy()
                x.ravel()[rows] -= step
                continue
            if factors is None or norm > _WORTH * last:
                # a slack sheet has no stiffness across itself yet
                factors = self._factors(x, pose, gauge, 0.0 if gauge is None else min(100.0, 30.0 * norm))
                if factors.info != 0:
                    return False
            last, halvings = norm, 0
            self.iterations += 1
            step = -factors.solve(force)
            step *= min(1.0, cap / max(float(np.abs(step).max()), 1e-15))
            x = x.copy()
            x.ravel()[rows] += step
        self._nearest = min(self._nearest, best, key=lambda b: b[0])
        return self._accept(best[1], pose, gauge) if best[0] < _ENOUGH * self.p.tolerance else False

    def _accept(self, x: Array, pose: Pose | None, gauge: float | None) -> bool:
        """Take nodes x for the equilibrium."""
        self.x, self.load = x, self.residual(x, pose, gauge)[1]
        return True

    def _settle_by_turns(self, pose: Pose) -> bool:
        """As _settle, but what friction bears is held in each solve and taken from the one before.

        For states between which Newton's method jumps: with the bound held, each solve is a minimum of energy.
        """
        start = self.x
        touch = self.residual(start, pose)[1]
        bound, norm = None, math.inf
        try:
            for _ in range(_TURNS):
                assert touch is not None
                goal = self.contact.bounds(touch)
                bound = goal if bound is None else 0.5 * (bound + goal)
                self.contact.bound = bound
                settled = self._settle(pose)
                self.contact.bound = None
                if not settled:
                    norm = math.inf
                    break
                force, touch = self.residual(self.x, pose)
                norm = float(np.linalg.norm(force.ravel()[self._band.rows]))
                if norm < _ENOUGH * self.p.tolerance:
                    break
        finally:
            self.contact.bound = None
        if norm < _LAGGED:
            return self._accept(self.x, pose, None)
        self.x = start
        return False

    def move(self, pose: Pose, jump: bool = False) -> bool:
        """To the equilibrium with the tool at pose (R_TF (3, 3), p_TF (3,) [m]); False where none is found.

        jump: where no equilibrium is near, let the patch slide to one in a jump.
        """
        start, anchors, self._nearest = self.x, self.contact.anchors, (math.inf, self.x)
        guess = start
        if self._pose is not None and self._sensitivity is not None:
            R0, o0 = self._pose
            motion = np.concatenate([_small_rotation(pose[0] @ R0.T), pose[1] - o0])
            guess = start.copy()
            guess.ravel()[self._band.rows] += self._sensitivity @ motion
        settled = self._settle(pose, x=guess, factors=self._factors_now)
        settled = settled or self._settle(pose, x=start) or self._settle_by_turns(pose) or (jump and self._jump(pose))
        if not settled:
            return False
        assert self.load is not None
        if self.load.depth > _DEEPEST:
            self.x, self.contact.anchors = start, anchors
            return False
        self.contact.keep(self.load)
        self._pose = pose
        return True

    def _jump(self, pose: Pose) -> bool:
        """To an equilibrium beyond one that has ceased to exist: a patch that lets go in a jump.

        Damped steps, as of a membrane in oil, on which nodes that slide take their anchors along.
        """
        before, anchors = self.x, self.contact.anchors
        x, rows, cap, first = self._nearest[1], self._band.rows, _LONGEST * self.p.spacing, 0.0
        for _ in range(_JUMP):
            whole, touch = self.residual(x, pose)
            assert touch is not None
            force = whole.ravel()[rows]
            norm = math.sqrt(float(force @ force))
            self.contact.keep(touch)
            if norm < _ENOUGH * self.p.tolerance:
                self.x, self.load = x, touch
                return True
            first = max(first, norm)
            factors = self._factors(x, pose, None, _OIL * norm / first)
            if factors.info != 0 or not math.isfinite(norm):
                break
            self.iterations += 1
            step = -factors.solve(force)
            x = x.copy()
            x.ravel()[rows] += step * min(1.0, cap / max(float(np.abs(step).max()), 1e-15))
        self.x, self.contact.anchors = before, anchors
        return False

    def age(self, t: float) -> None:
        """Let sheet and gas flow up to time t [s]."""
        dt, self.t = t - self.t, max(t, self.t)
        if dt <= 0.0:
            return
        if self.p.creep > 0.0:
            goal = self.p.creep * self.sheet.strain(self.x)
            self.sheet.crept = self.sheet.crept + (1.0 - math.exp(-dt / self.p.creep_time)) * (goal - self.sheet.crept)
        if self.p.leak > 0.0:
            least = self.p.ambient * self.volume
            self.content = max(self._content() - self.p.leak * dt * self.volume, least)

    # -- what the tool feels -------------------------------------------------------------------------------------------
    def linearise(self) -> None:
        """Stiffness about the present equilibrium: of the nodes to the tool's motion, and of the load on the tool."""
        assert self._pose is not None
        R, origin = self._pose
        # sliding goes on sliding; nodes that have just touched stick from now on
        touch = self.contact.load(self.x @ R.T + origin)
        assert touch.stiffness is not None
        factors = self._factors(self.x, self._pose, None, 0.0, touch)
        ends = self.contact.ends[touch.places]
        point = self.x[ends] @ R.T + origin  # (k, 2, 3)
        arms, pull = _skews(point), _skews(touch.force)
        move = np.zeros((*point.shape, 6))  # of each end in T per motion (rotation, translation) of F in T
        move[..., :3] = -_skews(point - origin)
        move[..., 3:] = np.eye(3)
        turned = np.einsum("kabij,kbjm->kaim", touch.stiffness, move)
        turned[..., :3] -= pull
        right = self._at_nodes(touch, R.T @ turned).reshape(-1, 6)
        u = -factors.solve(right[self._band.rows])
        whole = np.zeros((3 * len(self.x), 6))
        whole[self._band.rows] = u
        w = move + R @ whole.reshape(-1, 3, 6)[ends]
        df = np.einsum("kabij,kbjm->kaim", touch.stiffness, w)
        tangent = np.concatenate([(arms @ df + pull @ w).sum((0, 1)), df.sum((0, 1))])
        self.tangent, self._sensitivity, self._factors_now = tangent, u, factors

    def wrench(self) -> Wrench:
        """On the tool about T, in T."""
        if self.load is None or self._pose is None:
            return Wrench.zero()
        R, origin = self._pose
        point = self.x[self.contact.ends[self.load.places]] @ R.T + origin
        return Wrench(-np.cross(point, self.load.force).sum((0, 1)), -self.load.force.sum((0, 1)))

    def touching(self) -> tuple[NDArray[Any], Array]:
        """(n,) bool which nodes touch the tool; (k, 3) [m] all places that do, in F."""
        touching, ends = np.zeros(len(self.x), bool), np.empty((0, 2), int)
        if self.load is not None:
            ends = self.contact.ends[self.load.places]
            touching[ends[ends[:, 0] == ends[:, 1], 0]] = True
        return touching, 0.5 * self.x[ends].sum(axis=1)

    def areas(self) -> tuple[float, float]:
        """[m^2] of the sheet that touches the tool, and of that which slides on it."""
        if self.load is None:
            return 0.0, 0.0
        area = self.contact.area[self.load.places]
        return float(area.sum()), float(area[self.load.sliding].sum())

    def energy(self) -> float:
        """[J] of sheet, gas (against the ambient, up to a constant) and normal contact springs."""
        gas = -self._content() * math.log(self.volume) + self.p.ambient * self.volume
        return self.sheet.load(self.x, stiffness=False).energy + gas + (self.load.energy if self.load else 0.0)


def _places(sheet: Sheet, free: Mask) -> tuple[Index, Array]:
    """Where a sheet may touch: the nodes (e, 2) of each place, and its area (e,) [m^2]; free: (n,) nodes that move."""
    pairs = np.sort(np.concatenate([sheet.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
    sides, of = np.unique(pairs, axis=0, return_inverse=True)
    beside = np.bincount(of.ravel(), np.tile(sheet.area / 3.0, 3), len(sides))
    moves, nodes = free[sides].any(axis=1), np.flatnonzero(free)
    ends = np.concatenate([np.stack([nodes, nodes], axis=1), sides[moves]])
    return ends, np.concatenate([_AT_NODES * sheet.node_area[nodes], (1.0 - _AT_NODES) * beside[moves]])


def _skews(v: Array) -> Array:
    """(..., 3, 3) of (..., 3)."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def _small_rotation(R: Array) -> Array:
    """(3,) [rad] of a rotation of at most a few degrees."""
    return 0.5 * np.array((R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]))

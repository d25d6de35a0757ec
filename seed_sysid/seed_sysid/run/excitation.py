# SPDX-License-Identifier: Apache-2.0
"""The poses that an identification visits: each axis both ways, loading and unloading, and chosen combinations.

A pose is a displacement xi (6,) = [roll, pitch, yaw (rad), x, y, z (m)] of C in T. Every axis runs to both ends and
back through half of each, so that loading and unloading can be told apart; the centre is visited again and again, so
that drift shows; the rest are combinations, picked one by one so that they add most to the information about
stiffness, sensor bias and frame offset together (D-optimal, greedy). The last twelve of them may load the grasp as the
work to come does: pressed at the tip, dragged there by friction, and turned a little about x and z, as a tool that
leans on its work. A map that is not linear must have seen these together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from seed_core.bushing import Model
from seed_core.config import ConfigError
from seed_core.spatial import Array, pose_from_rpy
from seed_sysid.parameters import ExcitationParameters, LimitParameters, Procedure
from seed_sysid.stiffness_map import AXES, frame_derivatives, stiffness_map

_CANDIDATES = 160
_RAMP = (0.5, 1.0, 0.5, -0.5, -1.0, -0.5)  # shares of the amplitude: out, back, out, back
# Share of the work's load; where it is dragged [deg] in the plane of x and y; signs of the turns about x and z
_WORK = (
    (0.6, 0.0, 0, 0),
    (1.0, 0.0, 1, 1),
    (1.0, 180.0, 1, -1),
    (0.6, 180.0, 0, 0),
    (1.0, 90.0, -1, 1),
    (1.0, 0.0, -1, 1),
    (1.0, 270.0, 1, 1),
    (1.0, 180.0, -1, 1),
    (1.0, 0.0, 1, -1),
    (1.0, 180.0, 1, 1),
    (1.0, 0.0, -1, -1),
    (1.0, 180.0, -1, -1),
)
_LEANS = 0.4  # share of the amplitudes by which the tool is turned so
_LEVER = 0.05  # [m]; makes torques and forces, turns and translations comparable


@dataclass(frozen=True)
class Target:
    """One pose to visit: its name, why it is there ('home', an axis, 'combination' or 'work'), and xi (6,).

    load: (6,) [N m, N] about T's origin, in T, that the grasp is to bear at a pose of the work; else empty.
    turn: (6,) what xi has beside the displacement for that load; else empty.
    """

    name: str
    kind: str
    xi: tuple[float, ...]
    load: tuple[float, ...] = ()
    turn: tuple[float, ...] = ()

    @property
    def X_TC(self) -> Array:
        """(4, 4)."""
        return pose_from_rpy(self.xi[:3], self.xi[3:])

    def scaled(self, factor: float) -> Target:
        """The same direction, nearer to the centre."""
        return replace(self, xi=tuple(factor * v for v in self.xi))


def design(parameters: ExcitationParameters, limits: LimitParameters, model: Model = "midpoint") -> list[Target]:
    """The poses of one grip, in the order of visiting.

    Raises:
        ConfigError: too few poses to visit every axis.
    """
    ramps = np.kron(np.eye(6), np.array(_RAMP)[:, None])  # (36, 6) shares of the amplitudes, axis by axis
    combinations = parameters.poses - len(ramps) - parameters.homes
    if combinations < 0:
        raise ConfigError(
            f"excitation.poses = {parameters.poses} is too few: {len(_RAMP)} on each of 6 axes and "
            f"{parameters.homes} of the centre need {len(ramps) + parameters.homes}"
        )
    single = [within_limits(share * parameters.amplitudes, parameters, limits) for share in ramps]
    loads = work_loads(parameters)
    if combinations < len(loads):
        raise ConfigError(
            f"excitation.poses = {parameters.poses} is too few: excitation.work_force needs "
            f"{len(loads) - combinations} more, or must be 0 0 0"
        )
    combinations -= len(loads)
    chosen = _combinations(np.array(single), combinations, parameters, limits, model)
    kinds = [axis for axis in AXES for _ in _RAMP] + ["combination"] * combinations + ["work"] * len(loads)
    at_work = [load / parameters.guess.vector() + turn for load, turn in loads]
    targets = _with_homes([*single, *chosen, *at_work], kinds, parameters.homes)
    of_work = iter(loads)
    return [_loaded(t, *next(of_work)) if t.kind == "work" else t for t in targets]


def _loaded(target: Target, load: Array, turn: Array) -> Target:
    return replace(target, load=tuple(load.tolist()), turn=tuple(turn.tolist()))


def work_loads(parameters: ExcitationParameters) -> list[tuple[Array, Array]]:
    """At each pose of the work the grasp's load on the tool (6,), about T's origin, in T [N m, N], and turns (6,)."""
    x, y, z = parameters.work_force
    if not any(parameters.work_force):
        return []
    loads = []
    for share, deg, roll, yaw in _WORK:
        force = share * np.array((x * np.cos(np.deg2rad(deg)), y * np.sin(np.deg2rad(deg)), z))
        turn = _LEANS * parameters.amplitudes * (roll, 0.0, yaw, 0.0, 0.0, 0.0)
        loads.append((np.concatenate((np.cross(parameters.work_tip, force), force)), turn))
    return loads


def designs(procedure: Procedure) -> list[list[Target]]:
    """The poses of every grip; each grip has combinations of its own, so that together they show more."""
    p = procedure
    return [
        design(replace(p.excitation, seed=p.excitation.seed + grip), p.limits, p.fit.model)
        for grip in range(len(p.widths))
    ]


def within_limits(xi: Array, parameters: ExcitationParameters, limits: LimitParameters) -> Array:
    """xi (6,), drawn towards the centre until deflection and expected wrench stay within the planned limits."""
    load, share = parameters.guess.vector() * xi, limits.planned_share
    uses = (
        np.linalg.norm(load[3:]) / (share * limits.force),
        np.linalg.norm(load[:3]) / (share * limits.torque),
        np.linalg.norm(xi[3:]) / limits.translation,
        np.linalg.norm(xi[:3]) / np.deg2rad(limits.rotation_deg),
    )
    return xi / max(1.0, *(float(u) for u in uses))


def information_rows(xi: Array, parameters: ExcitationParameters, model: Model = "midpoint") -> Array:
    """(n, 6, 18) derivatives of the measured wrench by relative stiffness, frame offset and bias, made comparable."""
    B, coordinates = stiffness_map(np.array([pose_from_rpy(v[:3], v[3:]) for v in xi]), model)
    load = parameters.guess.vector() * coordinates
    J = np.zeros((len(xi), 6, 18))
    J[:, :, :6] = B * load[:, None, :]
    J[:, :, 6:12] = frame_derivatives(np.einsum("nij,nj->ni", B, load)) * np.repeat([1.0, _LEVER], 3)
    J[:, :, 12:] = np.eye(6)
    J[:, :3] /= _LEVER
    return J


def _combinations(
    single: Array, count: int, parameters: ExcitationParameters, limits: LimitParameters, model: Model
) -> list[Array]:
    rng = np.random.default_rng(parameters.seed)
    signs = rng.choice((-1.0, 1.0), size=(_CANDIDATES, 6)) * rng.uniform(0.4, 1.0, size=(_CANDIDATES, 6))
    largest = parameters.combined * parameters.amplitudes
    candidates = np.array([within_limits(s * largest, parameters, limits) for s in signs])
    rows = information_rows(candidates, parameters, model)
    start = information_rows(single, parameters, model).reshape(-1, 18)
    information, gains = start.T @ start, np.einsum("nki,nkj->nij", rows, rows)
    chosen: list[int] = []
    for _ in range(count):
        score = np.linalg.slogdet(information + gains)[1]
        score[chosen[-_CANDIDATES // 2 :]] = -np.inf  # spread: none twice before half of them were taken
        chosen.append(int(np.argmax(score)))
        information = information + gains[chosen[-1]]
    return [candidates[i] for i in chosen]


def _with_homes(xi: list[Array], kinds: list[str], homes: int) -> list[Target]:
    """The poses with visits of the centre at both ends and evenly between."""
    at = {round(i * len(xi) / (homes - 1)) for i in range(homes)}
    out: list[Target] = []
    for i in range(len(xi) + 1):
        if i in at:
            out.append(Target(f"{len(out):03d}-home", "home", (0.0,) * 6))
        if i < len(xi):
            out.append(Target(f"{len(out):03d}-{kinds[i]}", kinds[i], tuple(float(v) for v in xi[i])))
    return out

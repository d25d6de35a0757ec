# SPDX-License-Identifier: Apache-2.0
"""Whether Assumption 2 holds for this hand: is the stiffness diagonal and positive?

A full symmetric 6x6 K (21 numbers per hand, the diagonal scaled per grip) is fitted to what the grips share; its
off-diagonal parts, divided by the root of the two diagonals they join, are couplings between -1 and 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seed_core.spatial import Array, inverse_pose
from seed_sysid.fit.identification_fit import Problem, Solution
from seed_sysid.stiffness_map import AXES, offset_pose, skews, stiffness_map, wrench_transform

_COUPLED = 0.05  # a coupling below this moves no force by more than the other axis' load times 5 %
_SIGNIFICANT = 5.0  # standard deviations
PAIRS = tuple((i, j) for i in range(6) for j in range(i + 1, 6))


@dataclass(frozen=True)
class Assumption:
    """The verdict.

    Attributes:
        K: full symmetric stiffness (6, 6) at the mean of the grips, [rotation, translation].
        coupling, coupling_std: K_ij / sqrt(K_ii K_jj) (6, 6), 0 on the diagonal.
        eigenvalues: of K scaled to a unit diagonal (6,); all must be positive.
    """

    holds: bool
    K: Array
    coupling: Array
    coupling_std: Array
    eigenvalues: Array
    warnings: tuple[str, ...]


def check_diagonal(problem: Problem, solution: Solution) -> Assumption:
    """Fit what the diagonal model leaves over with the 15 couplings (and the frame offset again, which can mimic some).

    The residuals are moved back into T, where a coupling a_ij adds a_ij sqrt(k_i k_j) (xi_j along i, xi_i along j).
    """
    m = stiffness_map(problem.X_TC, problem.parameters.model)
    back = wrench_transform(inverse_pose(offset_pose(solution.offset[:3], solution.offset[3:])))
    scale = np.sqrt(np.maximum(solution.stiffness, 1e-9))[problem.grip]
    w = np.einsum("nij,nj->ni", m.B, solution.stiffness[problem.grip] * m.xi)
    columns = [_pair(m.B, m.xi * scale, scale, i, j) for i, j in PAIRS]
    columns += _nuisances(m.B * m.xi[:, None, :], w, problem.grip)
    A, y = np.stack(columns, axis=-1), -solution.residuals @ back.T
    good = solution.inlier
    noise = np.maximum(solution.noise_of(problem)[good], 1e-9)
    A2, y2 = (A[good] / noise[:, :, None]).reshape(-1, A.shape[-1]), (y[good] / noise).ravel()
    a, *_ = np.linalg.lstsq(A2, y2, rcond=1e-10)
    dof = max(1, len(y2) - A2.shape[1])
    variance = float(((y2 - A2 @ a) ** 2).sum()) / dof
    std = np.sqrt(np.maximum(np.diag(np.linalg.pinv(A2.T @ A2, rcond=1e-12)), 0.0) * variance)
    return _verdict(a[: len(PAIRS)], std[: len(PAIRS)], solution)


def _pair(B: Array, scaled_xi: Array, scale: Array, i: int, j: int) -> Array:
    """(n, 6) wrench for a unit coupling of axes i and j."""
    load = np.zeros_like(scaled_xi)
    load[:, i], load[:, j] = scale[:, i] * scaled_xi[:, j], scale[:, j] * scaled_xi[:, i]
    return np.asarray(np.einsum("nij,nj->ni", B, load))


def _nuisances(diagonal: Array, w: Array, grip: np.ndarray) -> list[Array]:
    """Columns (n, 6) of what is fitted along: stiffness and bias of each grip, frame offset."""
    out = []
    for g in np.unique(grip):
        mine = (grip == g)[:, None]
        out += [diagonal[:, :, j] * mine for j in range(6)]
        out += [np.eye(6)[j] * mine for j in range(6)]
    torque, force = -skews(w[:, :3]), -skews(w[:, 3:])
    zero = np.zeros_like(torque)
    offset = np.concatenate([np.concatenate([torque, force], axis=1), np.concatenate([force, zero], axis=1)], axis=2)
    return out + [offset[:, :, j] for j in range(6)]


def _verdict(a: Array, std: Array, solution: Solution) -> Assumption:
    coupling, deviation = np.zeros((6, 6)), np.zeros((6, 6))
    for (i, j), value, s in zip(PAIRS, a, std, strict=True):
        coupling[i, j] = coupling[j, i] = value
        deviation[i, j] = deviation[j, i] = s
    k = solution.stiffness.mean(axis=0)
    root = np.sqrt(np.maximum(k, 0.0))
    eigenvalues = np.asarray(np.linalg.eigvalsh(np.eye(6) + coupling), dtype=float)
    strong = [
        f"{AXES[i]}-{AXES[j]} {coupling[i, j]:+.2f}"
        for i, j in PAIRS
        if abs(coupling[i, j]) > _COUPLED and abs(coupling[i, j]) > _SIGNIFICANT * deviation[i, j]
    ]
    warnings = []
    if strong:
        warnings.append(
            f"Assumption 2 is doubtful: axes are coupled ({', '.join(strong)}); a diagonal stiffness leaves that out"
        )
    if eigenvalues.min() <= 0.0 or (k <= 0.0).any():
        warnings.append("Assumption 2 fails: the full stiffness is not positive")
    return Assumption(
        not warnings, np.outer(root, root) * (np.eye(6) + coupling), coupling, deviation, eigenvalues, tuple(warnings)
    )

# SPDX-License-Identifier: Apache-2.0
"""Assumption 2 put to the test: is the stiffness of this hand diagonal and positive?

A full symmetric 6x6 K (21 numbers per hand, the diagonal scaled per grip) is fitted to what the grips share; its
off-diagonal parts, divided by the root of the two diagonals they join, are couplings between -1 and 1.
"""

from dataclasses import dataclass

import numpy as np

from seed_core.spatial import Array, inverse_pose
from seed_sysid.fit.identification_fit import Solution
from seed_sysid.fit.load_model import LoadModel, Problem, Unknowns
from seed_sysid.stiffness_map import AXES, offset_pose, wrench_transform

_COUPLED = 0.05  # a coupling below this moves no force by more than the other axis' load times 5 %
_SIGNIFICANT = 5.0  # standard deviations
_I, _J = np.triu_indices(6, 1)  # the 15 pairs of axes


@dataclass(frozen=True)
class Assumption2:
    """The verdict; the assumption holds where there are no warnings.

    Attributes:
        coupling: K_ij / sqrt(K_ii K_jj) (6, 6), 0 on the diagonal.
        eigenvalues: of K scaled to a unit diagonal (6,); all must be positive.
    """

    coupling: Array
    eigenvalues: Array
    warnings: tuple[str, ...]

    @property
    def holds(self) -> bool:
        return not self.warnings


def check_assumption_2(problem: Problem, solution: Solution) -> Assumption2:
    """Fit what the diagonal model leaves over with the 15 couplings (and its own unknowns again, which can mimic some).

    The residuals are moved back into T, where a coupling a_ij adds a_ij sqrt(k_i k_j) (xi_j along i, xi_i along j).
    """
    model, k = LoadModel(problem, solution.inlier), solution.value.stiffness
    B, xi = model.map
    scale = np.sqrt(np.maximum(k, 1e-9))[problem.grip]
    root = (scale[:, _I] * scale[:, _J])[:, None]
    couplings = root * (B[:, :, _I] * xi[:, None, _J] + B[:, :, _J] * xi[:, None, _I])
    none = np.zeros(6)
    again = model.jacobian(Unknowns(k, none, np.zeros_like(k), none, none)).reshape(len(xi), 6, -1)
    A = np.concatenate([couplings, again[:, :, : 12 * len(k) + 6]], axis=2)
    y = -solution.residuals @ wrench_transform(inverse_pose(offset_pose(solution.value.offset))).T
    noise = np.maximum(solution.sample_noise, 1e-9)
    A = (A / noise[:, :, None])[solution.inlier].reshape(-1, A.shape[2])
    y = (y / noise)[solution.inlier].ravel()
    a = np.linalg.lstsq(A, y, rcond=1e-10)[0]
    variance = float(((y - A @ a) ** 2).sum()) / max(1, len(y) - A.shape[1])
    std = np.sqrt(np.maximum(np.diag(np.linalg.pinv(A.T @ A, rcond=1e-12)), 0.0) * variance)
    return _verdict(a[: len(_I)], std[: len(_I)], k.mean(axis=0))


def _verdict(coupling: Array, std: Array, k: Array) -> Assumption2:
    """From the couplings of the pairs (15,) with their standard deviations, and the mean stiffness (6,)."""
    matrix = np.zeros((6, 6))
    matrix[_I, _J] = matrix[_J, _I] = coupling
    eigenvalues = np.asarray(np.linalg.eigvalsh(np.eye(6) + matrix), dtype=float)
    strong = np.abs(coupling) > np.maximum(_COUPLED, _SIGNIFICANT * std)
    named = [f"{AXES[i]}-{AXES[j]} {a:+.2f}" for i, j, a in zip(_I[strong], _J[strong], coupling[strong], strict=True)]
    warnings = []
    if named:
        warnings.append(
            f"Assumption 2 is doubtful: axes are coupled ({', '.join(named)}); a diagonal stiffness leaves that out"
        )
    if eigenvalues.min() <= 0.0 or (k <= 0.0).any():
        warnings.append("Assumption 2 fails: the full stiffness is not positive")
    return Assumption2(matrix, eigenvalues, tuple(warnings))

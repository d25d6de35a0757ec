# SPDX-License-Identifier: Apache-2.0
"""What a series of estimates is worth against the truth, per axis."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.stats import chi2

from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array, rotation_error, rpy_from_rotation

AXES = ("x", "y", "z", "roll", "pitch", "yaw")
NAMED = ("x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg")
LOST_MM, LOST_DEG = 3.0, 6.0  # an error beyond either is no estimate of a pose any more
_TAIL = 0.025  # of chi-square, on either side


@dataclass
class Series:
    """Truth and estimate of one run, frame by frame."""

    X_true: list[Array] = field(default_factory=list)
    estimates: list[RelativePoseEstimate] = field(default_factory=list)
    cpu_ms: list[float] = field(default_factory=list)

    def add(self, X_true: Array, estimate: RelativePoseEstimate, cpu_ms: float) -> None:
        self.X_true.append(X_true)
        self.estimates.append(estimate)
        self.cpu_ms.append(cpu_ms)


def components(X: Array) -> Array:
    """x, y, z [mm], roll, pitch, yaw [deg] of a pose, (6,)."""
    return np.concatenate([1e3 * X[:3, 3], np.rad2deg(rpy_from_rotation(X[:3, :3]))])


def errors(estimate: RelativePoseEstimate, X_true: Array) -> Array:
    """(6,) [mm] and [deg]: difference of positions, rotation vector of R_est R_true^T in C."""
    turn = rotation_error(estimate.X_CT[:3, :3], X_true[:3, :3])
    return np.concatenate([1e3 * (estimate.X_CT[:3, 3] - X_true[:3, 3]), np.rad2deg(turn)])


def _normalised_square(estimate: RelativePoseEstimate, error: Array) -> float:
    e = np.concatenate([np.deg2rad(error[3:]), 1e-3 * error[:3]])
    try:
        return float(e @ np.linalg.solve(estimate.covariance, e))
    except np.linalg.LinAlgError:
        return float("inf")


def scores(series: Series, score_from: float = 0.0) -> dict[str, Any]:
    """Everything that `./seed validate estimator --json` prints about a series; NaN becomes None."""
    kept = [i for i, e in enumerate(series.estimates) if e.stamp >= score_from]
    valid = [i for i in kept if series.estimates[i].valid]
    out: dict[str, Any] = {"frames": len(kept), "valid_fraction": len(valid) / max(len(kept), 1)}
    if len(valid) < 3:
        nothing, bare = dict.fromkeys(NAMED), dict.fromkeys(AXES)
        out |= {"rmse": nothing, "bias": nothing, "gain": bare, "correlation": bare, "nees": None}
        return out | _time(series)
    e = np.array([errors(series.estimates[i], series.X_true[i]) for i in valid])
    truth = np.array([components(series.X_true[i]) for i in valid])
    found = np.array([components(series.estimates[i].X_CT) for i in valid])
    squares = np.array([_normalised_square(series.estimates[i], e[k]) for k, i in enumerate(valid)])
    out |= {"rmse": _named(np.sqrt((e**2).mean(axis=0))), "bias": _named(e.mean(axis=0))}
    out |= {"max_abs_error": _named(np.abs(e).max(axis=0)), **_lines(truth, found), **_consistency(squares)}
    lost = (np.linalg.norm(e[:, :3], axis=1) > LOST_MM) | (np.linalg.norm(e[:, 3:], axis=1) > LOST_DEG)
    out["lost_but_valid_fraction"] = float(lost.mean())
    return out | _time(series)


def _named(values: Array) -> dict[str, float]:
    return {name: float(v) for name, v in zip(NAMED, values, strict=True)}


def _lines(truth: Array, found: Array) -> dict[str, Any]:
    """Slope of estimate over truth, and their correlation."""
    a, b = truth - truth.mean(axis=0), found - found.mean(axis=0)
    saa, sbb, sab = (a * a).mean(axis=0), (b * b).mean(axis=0), (a * b).mean(axis=0)
    still = saa < 1e-6
    with np.errstate(invalid="ignore", divide="ignore"):
        gain, correlation = sab / saa, sab / np.sqrt(saa * sbb)
    defined = [not s for s in still]
    return {
        "gain": {n: float(g) if d else None for n, g, d in zip(AXES, gain, defined, strict=True)},
        "correlation": {
            n: float(c) if d and np.isfinite(c) else None for n, c, d in zip(AXES, correlation, defined, strict=True)
        },
    }


def _consistency(squares: Array) -> dict[str, Any]:
    """Mean normalised error squared, and the bounds within which chi-square with 6 degrees of freedom keeps it.

    Errors of neighbouring frames are alike, so the bounds are for as many independent frames as there are.
    """
    independent = _independent(squares)
    low, high = (float(chi2.ppf(q, 6 * independent)) / independent for q in (_TAIL, 1.0 - _TAIL))
    inside = float(np.mean((squares > chi2.ppf(_TAIL, 6)) & (squares < chi2.ppf(1.0 - _TAIL, 6))))
    mean = float(squares.mean())
    return {"nees": mean, "nees_bounds": [low, high], "nees_within_bounds": low <= mean <= high,
            "nees_frames_within_95_percent": inside, "independent_frames": independent}  # fmt: skip


def _independent(values: Array) -> int:
    """Frames worth of information in correlated values: N over the sum of the autocorrelation up to its first zero."""
    v = np.minimum(values, np.percentile(values, 99.0))
    v = v - v.mean()
    power = float(v @ v)
    if power <= 0.0:
        return 1
    total = 1.0
    for lag in range(1, len(v) // 2):
        c = float(v[lag:] @ v[:-lag]) / power
        if c <= 0.0:
            break
        total += 2.0 * c
    return max(1, int(len(v) / total))


def _time(series: Series) -> dict[str, Any]:
    if not series.cpu_ms:
        return {"ms_per_pair": {"median": None, "p99": None}}
    median, p99 = np.percentile(series.cpu_ms, (50, 99))
    return {"ms_per_pair": {"median": float(median), "p99": float(p99)}}

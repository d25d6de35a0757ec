# SPDX-License-Identifier: Apache-2.0
"""Scores of a series of estimates against the truth, per axis."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import chdtri

from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array, rotation_error, rpy_from_rotation
from seed_estimation import Estimator, TactileImages
from seed_testing.figures import figures

AXES = ("x", "y", "z", "roll", "pitch", "yaw")
NAMED = ("x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg")
LOST_MM, LOST_DEG = 3.0, 6.0  # an error beyond either is no estimate of a pose any more
_TAIL = 0.025  # of chi-square, on either side


@dataclass
class Series:
    """Truth and estimate of one run, frame by frame, and the CPU time that each estimate took [ms].

    sliding: share of the touching nodes that slide, frame by frame, on membranes with mechanics; else empty.
    """

    X_true: list[Array] = field(default_factory=list)
    estimates: list[RelativePoseEstimate] = field(default_factory=list)
    cpu_ms: list[float] = field(default_factory=list)
    sliding: list[float] = field(default_factory=list)

    def add(self, X_true: Array, estimate: RelativePoseEstimate, cpu_ms: float) -> None:
        """One more frame."""
        self.X_true.append(X_true)
        self.estimates.append(estimate)
        self.cpu_ms.append(cpu_ms)

    def estimate(self, estimator: Estimator, images: Mapping[str, TactileImages], stamp: float, X_true: Array) -> None:
        """Have a pair of images estimated and timed."""
        before = time.process_time()
        estimate = estimator.update(images, stamp)
        self.add(X_true, estimate, 1e3 * (time.process_time() - before))


def components(X: Array) -> Array:
    """x, y, z [mm], roll, pitch, yaw [deg] of a pose, (6,)."""
    return np.concatenate([1e3 * X[:3, 3], np.rad2deg(rpy_from_rotation(X[:3, :3]))])


def errors(estimate: RelativePoseEstimate, X_true: Array) -> Array:
    """(6,) [mm] and [deg]: difference of positions, rotation vector of R_est R_true^T in C."""
    turn = rotation_error(estimate.X_CT[:3, :3], X_true[:3, :3])
    return np.concatenate([1e3 * (estimate.X_CT[:3, 3] - X_true[:3, 3]), np.rad2deg(turn)])


def scores(series: Series, score_from: float = 0.0) -> dict[str, Any]:
    """Everything that `./seed validate estimator --json` prints about a series, from time score_from [s] on.

    What cannot be told, of axes that rest or of a series that is hardly ever valid, is None.
    """
    kept = [k for k in zip(series.estimates, series.X_true, strict=True) if k[0].stamp >= score_from]
    valid = [(estimate, X_true) for estimate, X_true in kept if estimate.valid]
    out: dict[str, Any] = {"frames": len(kept), "valid_fraction": len(valid) / max(len(kept), 1)}
    cost = figures("{}", series.cpu_ms, "median", "p99") if series.cpu_ms else dict.fromkeys(("median", "p99"))
    if len(valid) < 3:
        unknown = {"rmse": NAMED, "bias": NAMED, "gain": AXES, "correlation": AXES}
        return out | {k: dict.fromkeys(names) for k, names in unknown.items()} | {"nees": None, "ms_per_pair": cost}
    e = np.array([errors(estimate, X_true) for estimate, X_true in valid])
    truth = np.array([components(X_true) for _, X_true in valid])
    found = np.array([components(estimate.X_CT) for estimate, _ in valid])
    lost = (np.linalg.norm(e[:, :3], axis=1) > LOST_MM) | (np.linalg.norm(e[:, 3:], axis=1) > LOST_DEG)
    gain, correlation = _regression(truth, found)
    return out | {
        "rmse": _by_name(NAMED, np.sqrt((e**2).mean(axis=0))),
        "bias": _by_name(NAMED, e.mean(axis=0)),
        "max_abs_error": _by_name(NAMED, np.abs(e).max(axis=0)),
        "gain": _by_name(AXES, gain),
        "correlation": _by_name(AXES, correlation),
        **_consistency(np.array([_normalised_square(k[0], error) for k, error in zip(valid, e, strict=True)])),
        "lost_but_valid_fraction": float(lost.mean()),
        "ms_per_pair": cost,
    }


def _by_name(names: tuple[str, ...], values: Array) -> dict[str, float | None]:
    """None where a value is not finite."""
    return {name: float(v) if np.isfinite(v) else None for name, v in zip(names, values, strict=True)}


def _regression(truth: Array, found: Array) -> tuple[Array, Array]:
    """Slope of estimate over truth and their correlation, by axis (n,); NaN of an axis that rests."""
    a, b = truth - truth.mean(axis=0), found - found.mean(axis=0)
    saa, sbb, sab = (a * a).mean(axis=0), (b * b).mean(axis=0), (a * b).mean(axis=0)
    saa[saa < 1e-6] = np.nan
    with np.errstate(invalid="ignore", divide="ignore"):
        return sab / saa, sab / np.sqrt(saa * sbb)


def _normalised_square(estimate: RelativePoseEstimate, error: Array) -> float:
    """e^T C^-1 e of an error (6,) [mm, deg] and the estimate's covariance C; infinite where C is singular."""
    e = np.concatenate([np.deg2rad(error[3:]), 1e-3 * error[:3]])
    try:
        return float(e @ np.linalg.solve(estimate.covariance, e))
    except np.linalg.LinAlgError:
        return float("inf")


def _consistency(squares: Array) -> dict[str, Any]:
    """Mean normalised error squared, and the bounds within which chi-square with 6 degrees of freedom keeps it.

    Errors of neighbouring frames are alike, so the bounds are for as many independent frames as there are.
    """
    independent = _independent(squares)
    low, high = (float(chdtri(6 * independent, 1.0 - q)) / independent for q in (_TAIL, 1.0 - _TAIL))
    inside = float(np.mean((squares > chdtri(6, 1.0 - _TAIL)) & (squares < chdtri(6, _TAIL))))
    mean = float(squares.mean())
    return {
        "nees": mean,
        "nees_bounds": [low, high],
        "nees_within_bounds": low <= mean <= high,
        "nees_frames_within_95_percent": inside,
        "independent_frames": independent,
    }


def _independent(values: Array) -> int:
    """Frames worth of information in correlated values: N over the sum of the autocorrelation up to its first zero."""
    v = np.minimum(values, np.percentile(values, 99.0))
    v = v - v.mean()
    power = float(v @ v)
    if power <= 0.0:
        return 1
    c = np.correlate(v, v, "full")[len(v) : len(v) + len(v) // 2 - 1] / power  # from a lag of 1 on
    positive = np.logical_and.accumulate(c > 0.0)
    return max(1, int(len(v) / (1.0 + 2.0 * c[positive].sum())))

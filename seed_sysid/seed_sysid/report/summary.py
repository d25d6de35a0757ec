# SPDX-License-Identifier: Apache-2.0
"""What an analysis leaves: the JSON of ./seed identify, and stiffness.yaml as the controller loads it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from seed_core.spatial import Array, inverse_pose
from seed_core.stiffness_file import Grip, StiffnessFile, save_stiffness
from seed_sim.identification.cell import Truth
from seed_sysid.data.dataset import DatasetError
from seed_sysid.fit.analysis import Analysis
from seed_sysid.stiffness_map import AXES, CHANNELS, wrench_transform


def split(values: Array) -> dict[str, list[float]]:
    """A six-vector as rotation and translation."""
    return {"rotation": [float(v) for v in values[:3]], "translation": [float(v) for v in values[3:]]}


def summary(a: Analysis, truth: Truth | None = None) -> dict[str, Any]:
    """All figures as plain data; stiffness, std and truth at the middle grip, and every grip under `grips`."""
    s, g = a.solution, a.nominal
    out: dict[str, Any] = {
        "poses": a.source,
        "model": a.problem.parameters.model,
        "samples": len(a.data.samples),
        "stiffness": split(s.stiffness[g]),
        "std": split(s.stiffness_std[g]),
        "interval_half_width": split(s.stiffness_half_width[g]),
        "confidence": a.problem.parameters.confidence,
        "condition_number": s.condition,
        "r_squared": dict(zip(CHANNELS, s.r_squared.tolist(), strict=True)),
        "residual_std": dict(zip(CHANNELS, s.noise.tolist(), strict=True)),
        "left_out_rms": dict(zip(CHANNELS, a.left_out.tolist(), strict=True)),
        "left_out_share": dict(zip(CHANNELS, a.left_out_share.tolist(), strict=True)),
        "frame_offset": _offset(s.offset, s.offset_std),
        "bias": _bias(a),
        "drift": split_load(s.drift),
        "outliers": list(a.outliers),
        "hysteretic": list(a.hysteretic),
        "friction": split_load(s.friction),
        "undetermined": list(a.undetermined),
        "assumption_2": {
            "holds": a.assumption.holds,
            "largest_coupling": float(np.abs(a.assumption.coupling).max()),
            "smallest_eigenvalue": float(a.assumption.eigenvalues.min()),
        },
        "grips": [_grip(a, i) for i in range(len(a.grips))],
        "pressure_per_width": a.grip_model.pressure.slope if a.grip_model else None,
        "trend_with_pressure": dict(zip(AXES, a.grip_model.trend, strict=True)) if a.grip_model else None,
        "warnings": list(a.warnings),
    }
    return out | (_against(a, truth) if truth else {})


def split_load(values: Array) -> dict[str, list[float]]:
    """A wrench as torque and force."""
    return {"torque": [float(v) for v in values[:3]], "force": [float(v) for v in values[3:]]}


def _grip(a: Analysis, i: int) -> dict[str, Any]:
    s, pressure = a.solution, float(a.pressures[i])
    return {
        "grip": int(a.grips[i]),
        "width_m": float(a.widths[i]),
        "pressure_hpa": pressure if np.isfinite(pressure) else None,
        "stiffness": split(s.stiffness[i]),
        "std": split(s.stiffness_std[i]),
    }


def _offset(offset: Array, std: Array) -> dict[str, Any]:
    """T in T' as a rotation vector and a translation."""
    return {
        "rotation_deg": np.rad2deg(offset[:3]).tolist(),
        "translation_mm": (1e3 * offset[3:]).tolist(),
        "rotation_deg_std": np.rad2deg(std[:3]).tolist(),
        "translation_mm_std": (1e3 * std[3:]).tolist(),
    }


def _bias(a: Analysis) -> dict[str, list[float]]:
    """The sensor's bias about S, in S, at the middle grip."""
    return split_load(wrench_transform(inverse_pose(a.data.header.X_TS)) @ a.solution.bias[a.nominal])


def _against(a: Analysis, truth: Truth) -> dict[str, Any]:
    true = truth.stiffness[a.grips]
    relative = np.abs(a.solution.stiffness - true) / true
    covered = np.abs(a.solution.stiffness - true) <= a.solution.stiffness_half_width
    error = a.solution.offset - truth.offset
    g = a.nominal
    return {
        "truth": split(true[g]),
        "relative_error": split(relative[g]),
        "max_relative_error": float(relative[g].max()),
        "max_relative_error_all_grips": float(relative.max()),
        "truth_all_grips": [split(v) for v in true],
        "covered": [split_bool(v) for v in covered],
        "frame_offset_error": {
            "rotation_deg": float(np.rad2deg(np.linalg.norm(error[:3]))),
            "translation_mm": float(1e3 * np.linalg.norm(error[3:])),
        },
    }


def split_bool(values: np.ndarray) -> dict[str, list[bool]]:
    """Six truth values as rotation and translation."""
    return {"rotation": [bool(v) for v in values[:3]], "translation": [bool(v) for v in values[3:]]}


def stiffness_file(a: Analysis, date: str) -> StiffnessFile:
    """The result as the controller reads it, grips in rising order of pressure.

    Raises:
        DatasetError: an axis is undetermined: no file is better than a wrong one.
    """
    if a.undetermined:
        raise DatasetError(f"no stiffness.yaml is written: {', '.join(a.undetermined)} is not determined by these data")
    known = bool(np.isfinite(a.pressures).all())
    chosen = np.argsort(a.pressures, kind="stable") if known else [a.nominal]
    grips = tuple(_file_grip(a, int(i), float(a.pressures[i]) if known else 0.0) for i in chosen)
    head = a.data.header
    return StiffnessFile(head.hand or "hand", head.tool or "tool", date, grips, a.problem.parameters.model)


def _file_grip(a: Analysis, i: int, pressure: float) -> Grip:
    k, std = a.solution.stiffness[i], a.solution.stiffness_std[i]
    return Grip(pressure, float(a.widths[i]), _three(k[:3]), _three(k[3:]), _three(std[:3]), _three(std[3:]))


def _three(v: Array) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])


def write_stiffness(path: Path, file: StiffnessFile) -> None:
    """Write stiffness.yaml; one that is there already is kept as stiffness.previous.yaml."""
    if path.exists():
        path.replace(path.with_suffix(".previous" + path.suffix))
    save_stiffness(path, file)

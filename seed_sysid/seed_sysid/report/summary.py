# SPDX-License-Identifier: Apache-2.0
"""The result of an analysis: all figures as plain data, and stiffness.yaml as the controller loads it."""

from typing import Any

import numpy as np

from seed_core.config import checked
from seed_core.spatial import inverse_pose
from seed_core.stiffness_file import MOST_UNEXPLAINED, IdentifiedGrip, StiffnessFile
from seed_sysid.data.dataset import DatasetError
from seed_sysid.fit.analysis import Analysis
from seed_sysid.fit.membrane_map import MembraneResult
from seed_sysid.membrane.result import figures
from seed_sysid.stiffness_map import AXES, CHANNELS, wrench_transform


def split(values: np.ndarray, first: str = "rotation", second: str = "translation") -> dict[str, list[Any]]:
    """A six-vector as its two halves."""
    return {first: values[:3].tolist(), second: values[3:].tolist()}


def summary(a: Analysis) -> dict[str, Any]:
    """All figures as plain data; stiffness and std at the middle grip, and every grip under `grips`."""
    s, g = a.solution, a.nominal
    bias = wrench_transform(inverse_pose(a.data.header.X_TS)) @ s.value.bias[g]  # about S, in S

    def channels(values: np.ndarray) -> dict[str, float]:
        return dict(zip(CHANNELS, values.tolist(), strict=True))

    return {
        "poses": a.source,
        "model": a.problem.parameters.model,
        "samples": len(a.data.samples),
        "stiffness": split(s.value.stiffness[g]),
        "std": split(s.std.stiffness[g]),
        "interval_half_width": split(s.half_width[g]),
        "confidence": a.problem.parameters.confidence,
        "condition_number": s.condition,
        "r_squared": channels(s.r_squared),
        "residual_std": channels(s.noise),
        "left_out_rms": channels(a.left_out),
        "left_out_share": channels(a.left_out_share),
        "frame_offset": {
            "rotation_deg": np.rad2deg(s.value.offset[:3]).tolist(),  # a rotation vector
            "translation_mm": (1e3 * s.value.offset[3:]).tolist(),
            "rotation_deg_std": np.rad2deg(s.std.offset[:3]).tolist(),
            "translation_mm_std": (1e3 * s.std.offset[3:]).tolist(),
        },
        "bias": split(bias, "torque", "force"),
        "drift": split(s.value.drift, "torque", "force"),
        "outliers": list(a.outliers),
        "hysteretic": list(a.hysteretic),
        "friction": split(s.value.friction, "torque", "force"),
        "undetermined": list(a.undetermined),
        "assumption_2": {
            "holds": a.assumption.holds,
            "largest_coupling": float(np.abs(a.assumption.coupling).max()),
            "smallest_eigenvalue": float(a.assumption.eigenvalues.min()),
        },
        "grips": [
            {
                "grip": int(a.grips[i]),
                "width_m": float(a.widths[i]),
                "pressure_hpa": float(a.pressures[i]) if np.isfinite(a.pressures[i]) else None,
                "stiffness": split(s.value.stiffness[i]),
                "std": split(s.std.stiffness[i]),
            }
            for i in range(len(a.grips))
        ],
        "pressure_per_width": -a.schedule.gripper.slope if a.schedule and a.schedule.gripper else None,
        "trend_with_pressure": dict(zip(AXES, a.schedule.trend, strict=True)) if a.schedule else None,
        "membrane_map": membrane_figures(a.membrane) if a.membrane else None,
        "warnings": list(a.warnings),
    }


def membrane_figures(m: MembraneResult) -> dict[str, Any]:
    """The membrane map's figures as plain data."""
    return figures(m.fit, m.shares, m.remarks, m.file)


def stiffness_file(a: Analysis, date: str) -> StiffnessFile:
    """The result as the controller reads it: grips in rising order of pressure, or in falling order of width.

    Where neither tells the grips apart it has the middle one alone.

    Raises:
        DatasetError: an axis is undetermined: no file is better than a wrong one.
        ConfigError: a value is one with which the file could not be loaded.
    """
    if a.undetermined:
        raise DatasetError(f"no stiffness.yaml is written: {', '.join(a.undetermined)} is not determined by these data")
    firmer = np.lexsort((a.pressures, -a.widths))
    grips = []
    for i in firmer if a.grips_told_apart else [a.nominal]:
        pressure, width = float(np.nan_to_num(a.pressures[i])), float(a.widths[i])
        stiffness_and_std = np.array([a.solution.value.stiffness[i], a.solution.std.stiffness[i]]).reshape(4, 3)
        grips.append(IdentifiedGrip(pressure, width, *(tuple(v) for v in stiffness_and_std.tolist())))
    head = a.data.header
    model = a.problem.parameters.model
    roll, pitch, yaw, x, y, z = np.clip(a.unexplained, 0.0, MOST_UNEXPLAINED).tolist()
    file = StiffnessFile(
        head.hand or "hand",
        head.tool or "tool",
        date,
        tuple(grips),
        model,
        torque_unexplained=(roll, pitch, yaw),
        force_unexplained=(x, y, z),
    )
    return checked(file, "stiffness.yaml")

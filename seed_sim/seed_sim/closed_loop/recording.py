# SPDX-License-Identifier: Apache-2.0
"""What one simulated run leaves behind, and its score as docs/scenarios.md defines it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seed_control.tasks import Task
from seed_core.spatial import Array, so3_log

SETTLING = 2.0  # [s] after first contact that the score leaves out
CONTACT_FORCE = 0.05  # [N] that counts as contact in the plant


@dataclass
class Recording:
    """One row per control step; everything from the plant, not from estimates.

    Attributes:
        t: [s].  phase: index into `phases`.
        force: (n, 3) [N] of the tool on the environment, torque: (n, 3) [N m] about the tip, both in the task frame.
        torque_T: (n, 3) [N m] the same torque in T's axes.
        wanted_force: (n, 3) [N].  wanted_torque_T: (n, 3) [N m].
        tip: (n, 3), reference: (n, 3) [m] in the task frame.
        lean: (n, 3) [rad] rotation vector from the reference orientation to the tool, in T.
        X_CT: (n, 4, 4) true displacement.
    """

    phases: list[str]
    force_directions: Array = field(default_factory=lambda: np.diag([0.0, 0.0, 1.0]))
    torque_axes: tuple[bool, bool, bool] = (True, False, False)
    rows: dict[str, list[Any]] = field(default_factory=dict)
    estimates: list[Any] = field(default_factory=list)
    finished: bool = False
    message: str = ""
    wall_time: float = 0.0

    def add(self, **values: Any) -> None:
        """One more row."""
        for name, value in values.items():
            self.rows.setdefault(name, []).append(value)

    def __getitem__(self, name: str) -> Array:
        return np.asarray(self.rows[name])

    @property
    def contact_time(self) -> float | None:
        """When the plant's contact force along the task's z was first felt [s]; None without contact."""
        touching = np.flatnonzero(np.abs(self["force"][:, 2]) > CONTACT_FORCE)
        return float(self["t"][touching[0]]) if len(touching) else None

    def scored(self, phase: str) -> NDArray[np.bool_]:
        """Mask (n,) of the rows that count: in the named phase, from 2 s after first contact."""
        t, start = self["t"], self.contact_time
        named = np.isin(self["phase"], [i for i, name in enumerate(self.phases) if _matches(name, phase)])
        return named & (t >= (start if start is not None else np.inf) + SETTLING)


def torque_axes_of(task: Task) -> tuple[bool, bool, bool]:
    """Which of T's axes count as turned by the task, in its score: the last control's that has any; x if none has."""
    controls = [p.control for p in task.phases] + [task.draw.control if task.draw else None]
    turning = [c.flags(c.torque_axes) for c in controls if c is not None and c.torque_axes]
    return turning[-1] if turning else (True, False, False)


def _matches(name: str, phase: str) -> bool:
    return name == phase or (phase == "draw" and name.endswith(" draw"))


def _errors(signed: Array) -> dict[str, float]:
    return {
        "rmse": float(np.sqrt(np.mean(signed**2))),
        "mean": float(np.mean(signed)),
        "max_abs_error": float(np.abs(signed).max()),
    }


def score(recording: Recording, phase: str) -> dict[str, Any]:
    """Force along the task's z, torque about T's x, lean and path, over the named phase.

    `mean` is the mean signed force or torque, that is, the set-point and the mean error. A run without scored rows
    (no contact, or stopped early) is scored with the whole set-point as its error.
    """
    keep = recording.scored(phase)
    contact = recording.contact_time
    out: dict[str, Any] = {"contact": {"made": contact is not None, "time": contact}, "finished": recording.finished}
    if not keep.any():
        wanted = recording["wanted_force"]
        size = float(np.abs(wanted[:, 2]).max(initial=0.0))
        none = {"rmse": size, "mean": 0.0, "max_abs_error": size}
        return out | {
            "force_z": none,
            "torque_x": {"rmse": 0.0, "mean": 0.0, "max_abs_error": 0.0},
            "torque_z": None,
            "lean_deg": {"rms": 0.0, "max": 0.0},
            "path_rmse_mm": float("nan"),
            "samples": 0,
        }
    force = recording["force"][keep][:, 2]
    error = force - recording["wanted_force"][keep][:, 2]
    torque = recording["torque_T"][keep]
    torque_error = torque - recording["wanted_torque_T"][keep]
    turning = recording.torque_axes[2]
    held = [i for i in range(3) if not recording.torque_axes[i]]
    lean = np.rad2deg(np.linalg.norm(recording["lean"][keep][:, held], axis=1))
    off = recording["tip"][keep] - recording["reference"][keep]
    off = off @ (np.eye(3) - recording.force_directions)
    return out | {
        "force_z": _errors(error) | {"mean": float(force.mean())},
        "torque_x": _errors(torque_error[:, 0]) | {"mean": float(torque[:, 0].mean())},
        "torque_z": _errors(torque_error[:, 2]) | {"mean": float(torque[:, 2].mean())} if turning else None,
        "lean_deg": {"rms": float(np.sqrt(np.mean(lean**2))), "max": float(lean.max())},
        "path_rmse_mm": float(1e3 * np.sqrt(np.mean(np.sum(off**2, axis=1)))),
        "samples": int(keep.sum()),
    }


def lean_of(R_ref: Array, R_WT: Array) -> Array:
    """Rotation vector (3,) [rad] from the reference to the tool, in T."""
    return so3_log(R_ref.T @ R_WT)

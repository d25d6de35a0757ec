# SPDX-License-Identifier: Apache-2.0
"""The recording of one simulated run, and its score: force, torque, lean and path over the phase that counts."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seed_control.tasks import Task
from seed_control.tasks.contact_stop import FoundPlace
from seed_core.errors import SeedError
from seed_core.spatial import Array, so3_log

SETTLING = 2.0  # [s] after first contact that the score leaves out
CONTACT_FORCE = 0.05  # [N] that counts as contact in the plant
_ERRORS = ("rmse", "mean", "max_abs_error")
_VECTORS = ("force", "normal", "torque_T", "wanted_force", "wanted_torque_T", "tip", "reference", "lean")
_BELIEFS = ("believed_force", "stated_force", "found_normal")
# The shapes of a row's columns, for a run that has ended before its first row:
_SHAPES: dict[str, tuple[int, ...]] = {
    "t": (),
    "phase": (),
    "wrench_error": (6,),
    "wrench_covariance": (6, 6),
    **dict.fromkeys((*_VECTORS, *_BELIEFS), (3,)),
}


@dataclass
class Recording:
    """One row per control step; everything from the plant, not from estimates.

    Rows, each an array by `recording[name]`:
        t: [s].  phase: index into `phases`.
        force: (n, 3) [N] of the tool on the environment, in the task frame.
        torque_T: (n, 3) [N m] of the tool on the environment about the tip, in T's axes.
        wanted_force: (n, 3) [N].  wanted_torque_T: (n, 3) [N m].
        tip: (n, 3), reference: (n, 3) [m] in the task frame.
        lean: (n, 3) [rad] rotation vector from the reference orientation to the tool, in T.

    A run that ends before its first set-point has no rows: n is 0.
    """

    phases: list[str]
    torque_axes: tuple[bool, bool, bool] = (True, False, False)
    rows: dict[str, list[Any]] = field(default_factory=dict, repr=False)
    finished: bool = False
    found: tuple[FoundPlace, ...] = ()
    message: str = ""

    def add(self, **values: Any) -> None:
        """One more row."""
        for name, value in values.items():
            self.rows.setdefault(name, []).append(value)

    def __getitem__(self, name: str) -> Array:
        if not self.rows:
            return np.zeros((0, *_SHAPES[name]))
        return np.asarray(self.rows[name])

    @property
    def contact_time(self) -> float | None:
        """When the plant's contact force along the task's z first exceeded CONTACT_FORCE [s]; None without contact."""
        touching = np.flatnonzero(np.abs(self["force"][:, 2]) > CONTACT_FORCE)
        return float(self["t"][touching[0]]) if len(touching) else None

    def scored(self, phase: str) -> NDArray[np.bool_]:
        """Mask (n,) of the rows that count: in the named phase (`counts_as`), from 2 s after first contact."""
        t, start = self["t"], self.contact_time
        counts = [counts_as(name, phase) for name in self.phases]
        named = np.isin(self["phase"], np.flatnonzero(counts))
        return named & (t >= (start if start is not None else np.inf) + SETTLING)


def counts_as(name: str, phase: str) -> bool:
    """Whether a phase of this name is scored as `phase`: 'draw' is every stroke, 'wipe' its further pieces as well."""
    piece = phase == "wipe" and name.removeprefix("wipe ").isdigit()
    return name == phase or piece or (phase == "draw" and name.endswith(" draw"))


def torque_axes_of(task: Task) -> tuple[bool, bool, bool]:
    """Which of T's axes the task turns by torque: the last control's that has any. All others count as lean."""
    controls = [p.control for p in task.phases] + [task.draw.control if task.draw else None]
    turning = [c.flags(c.torque_axes) for c in controls if c is not None and c.torque_axes]
    return turning[-1] if turning else (False, False, False)


def lean_of(R_ref: Array, R_WT: Array) -> Array:
    """Rotation vector (3,) [rad] from the reference to the tool, in T."""
    return so3_log(R_ref.T @ R_WT)


def scored_phase(task: Task) -> str:
    """The phase that is scored: the named 'wipe', strokes, the one with the largest torque, or the last with force.

    Raises:
        SeedError: no phase controls force.
    """
    if task.draw is not None:
        return "draw"
    controls = {p.name: p.control for p in task.phases if p.control is not None}
    stops = [p.name for p in task.phases if p.contact_stop is not None]
    if not controls and stops:
        return stops[-1]
    if not controls:
        raise SeedError(f"task '{task.name}' controls no force in any phase: there is nothing to score")
    if "wipe" in controls:
        return "wipe"
    largest = max(controls, key=lambda name: sum(t * t for t in controls[name].torque))
    return largest if any(controls[largest].torque) else list(controls)[-1]


def score(recording: Recording, phase: str) -> dict[str, Any]:
    """Force along the task's z, torque about T's x, lean and path, over the named phase.

    `mean` is the mean signed force or torque, that is, the set-point and the mean error. A run without scored rows
    (no contact, or stopped early) has `samples` 0, and not a number for every figure.
    """
    keep = recording.scored(phase)
    contact = recording.contact_time
    out: dict[str, Any] = {"contact": {"made": contact is not None, "time": contact}, "finished": recording.finished}
    if not keep.any():
        none = float("nan")
        return out | {
            "force_z": dict.fromkeys(_ERRORS, none),
            "torque_x": dict.fromkeys(_ERRORS, none),
            "torque_z": None,
            "lean_deg": {"rms": none, "max": none},
            "path_rmse_mm": none,
            "samples": 0,
        }
    force, torque = recording["force"][keep], recording["torque_T"][keep]
    wanted_force, wanted_torque = recording["wanted_force"][keep], recording["wanted_torque_T"][keep]
    held = [i for i in range(3) if not recording.torque_axes[i]]
    lean = np.rad2deg(np.linalg.norm(recording["lean"][keep][:, held], axis=1))
    off = (recording["tip"][keep] - recording["reference"][keep])[:, :2]
    return out | {
        "force_z": _errors(force[:, 2], wanted_force[:, 2]),
        "torque_x": _errors(torque[:, 0], wanted_torque[:, 0]),
        "torque_z": _errors(torque[:, 2], wanted_torque[:, 2]) if recording.torque_axes[2] else None,
        "lean_deg": {"rms": rms(lean), "max": float(lean.max())},
        "path_rmse_mm": 1e3 * rms(np.linalg.norm(off, axis=1)),
        "samples": int(keep.sum()),
    }


def rms(values: Array) -> float:
    """Root mean square of all values."""
    return float(np.sqrt(np.mean(np.square(values))))


def _errors(actual: Array, wanted: Array) -> dict[str, float]:
    error = actual - wanted
    return dict(zip(_ERRORS, (rms(error), float(actual.mean()), float(np.abs(error).max())), strict=True))

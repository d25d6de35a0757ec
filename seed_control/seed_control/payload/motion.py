# SPDX-License-Identifier: Apache-2.0
"""The motion of payload identification: lift off, hold the tool still in a few orientations, sample how it hangs."""

from math import asin, atan2

import numpy as np
from numpy.typing import ArrayLike

from seed_control.payload.identify import Payload, PayloadError, PayloadFit
from seed_control.state import ControllerState
from seed_control.tasks import TaskPlayer, TaskStatus
from seed_control.tasks.task import Phase, Task, WorkFrame
from seed_control.wrench.estimate import WrenchEstimator
from seed_core.hand import GRAVITY, UPRIGHT, Tool
from seed_core.spatial import Array, inverse_pose, rpy_from_rotation

LIFT = 0.05  # [m] before the first turn: a blade's end goes down by a third of its distance from the tip
TURN = 20.0  # [deg] about x and y of the tip, each way
_STILL = 0.6  # [s] of swinging out before samples count
_SAMPLING = 0.6  # [s] per orientation
_MOST_FORCE = 0.5  # of the weight that is expected, by which the load may differ before the start


def payload_task(X_W_tip: Array, up_W: ArrayLike = UPRIGHT) -> Task:
    """The task for a tool whose tip is at X_W_tip (4, 4) in free space; up_W: (3,) against gravity."""
    x, y, z = X_W_tip[:3, 3].tolist()
    a, b, c = np.asarray(up_W).tolist()
    frame = WorkFrame((x, y, z), (float(np.rad2deg(-asin(b))), float(np.rad2deg(atan2(a, c))), 0.0))  # its z is up
    r, p, w = np.rad2deg(rpy_from_rotation(frame.pose[:3, :3].T @ X_W_tip[:3, :3])).tolist()
    up, dwell = (0.0, 0.0, LIFT), _STILL + _SAMPLING
    turns = {
        "level": (0.0, 0.0, 0.0),
        "roll": (TURN, 0.0, 0.0),
        "roll back": (-TURN, 0.0, 0.0),
        "pitch": (0.0, TURN, 0.0),
        "pitch back": (0.0, -TURN, 0.0),
    }
    return Task(
        name="weigh_tool",
        frame=frame,
        tip_rpy=(r, p, w),
        lift=0.005,
        phases=(
            Phase("lift", up),
            *(Phase(name, up, tilt=tilt, dwell=dwell) for name, tilt in turns.items()),
            Phase("upright", up, tilt=(0.0, 0.0, 0.0)),
        ),
    )


class PayloadRun:
    """One identification. Call `step` at the control rate, send its set-points, read `result` when it is done.

    Raises:
        PayloadError: at the start, while something carries or presses the tool.
    """

    def __init__(self, wrench_estimator: WrenchEstimator, tool: Tool, state: ControllerState) -> None:
        if state.X_W_tip is None or state.filtered is None:
            raise PayloadError("cannot weigh the tool: no estimate of the relative pose has come yet")
        # the estimate has the stated weight taken off: in free space little of it is left
        left = float(np.linalg.norm(state.filtered.force))
        bound = max(_MOST_FORCE * tool.mass * GRAVITY, 1.0)
        if state.in_contact or left > bound:
            raise PayloadError(
                f"cannot weigh the tool: {left:.2f} N act on it beside its weight, at most {bound:.2f} N may: "
                "lift it off, or state tool.mass"
            )
        self._tool, self._X_tipT = tool, inverse_pose(tool.X_Ttip)
        self._player = TaskPlayer(payload_task(state.X_W_tip, wrench_estimator.up), waits=False)
        self._fit = PayloadFit(wrench_estimator.bushing, wrench_estimator.up)
        self._still_since = self._seen = -np.inf
        self._place: Array | None = None

    def step(self, t: float, state: ControllerState) -> TaskStatus:
        """Status at time t [s], with the set-point to send."""
        status = self._player.step(t, state)
        if status.setpoint is not None:
            self._sample(t, state, status.setpoint.X_W_tip)
        return status

    def result(self) -> Payload:
        """Mass, centre of mass, and the check of the stiffness by the tool's stated mass. Raises PayloadError."""
        return self._fit.result(self._tool.mass if self._tool.mass > 0.0 else None)

    def _sample(self, t: float, state: ControllerState, X_W_tip: Array) -> None:
        """Take each new image once the reference has stood still for a while, but not before the lift."""
        if self._place is None or not np.array_equal(self._place, X_W_tip):
            self._place, self._still_since = X_W_tip, t
        image = t - state.image_age
        turned = self._player.phase not in ("lift", "upright")
        if not turned or image < self._still_since + _STILL or image <= self._seen + 1e-4:
            return
        assert state.X_W_tip is not None
        assert state.measured_X_CT is not None
        self._seen = image
        # Uncorrected: what the stated weight has mended would agree with it.
        self._fit.add(state.X_W_tip @ self._X_tipT, state.measured_X_CT, state.model_spring)


def report(payload: Payload, tool: Tool) -> str:
    """The result in one line, for people."""
    com = ", ".join(
        "not seen" if not np.isfinite(s) else f"{1e3 * c:.1f} +- {1e3 * s:.1f}"
        for c, s in zip(payload.center_of_mass, payload.center_of_mass_std, strict=True)
    )
    text = f"mass {payload.mass:.4f} +- {payload.mass_std:.4f} kg, centre of mass ({com}) mm in T"
    if payload.stiffness_ratio is None:
        return text
    return (
        f"{text}; if tool.mass = {tool.mass:g} kg is right, the vertical stiffness is "
        f"{payload.stiffness_ratio:.3f} times the one in use"
    )

# SPDX-License-Identifier: Apache-2.0
"""The identification as a state machine: readings in, commands out; the same for simulation and hardware.

At each grip it waits for the gripper, then for each pose: moves there along a straight line at a limited rate, waits
until the wrench has come to rest, averages, and hands over a sample. Limits are watched at every reading: when
the wrench meets one, the pose is drawn back and tried once more; when the tool slips, the run ends.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from seed_core.spatial import Array, interpolate_pose, so3_log
from seed_sysid.data.dataset import Sample, flat_pose
from seed_sysid.parameters import MotionParameters, Procedure
from seed_sysid.run.excitation import Target, design
from seed_sysid.run.rest_detector import RestDetector, limit_reached
from seed_sysid.stiffness_map import wrench_transform

_DRAW_BACK = 0.7  # factor on a pose whose wrench met a limit
_ATTEMPTS = 3


@dataclass(frozen=True)
class Reading:
    """All that is known at one instant.

    Attributes:
        X_TC: displacement from kinematics (4, 4); X_TC_estimated: from the estimator, None without a new image.
        wrench: load on the sensor about S, in S (6,) [N m, N].
    """

    stamp: float
    X_TC: Array
    wrench: Array
    width: float
    pressures: tuple[float, ...] = ()
    X_TC_estimated: Array | None = None
    slip: float = 0.0
    gross_slip: bool = False


@dataclass(frozen=True)
class Command:
    """Where C should be in T now, how wide the gripper, and what is being done."""

    X_TC: Array
    width: float
    grip: int
    state: str
    measuring: bool = False
    sample: Sample | None = None
    event: str = ""
    done: bool = False
    failure: str = ""


@dataclass
class _Dwell:
    """The pose being visited."""

    target: Target
    attempts: int = 1
    start: float | None = None
    readings: list[Reading] = field(default_factory=list)


class Run:
    """One identification over all grips; step() with each reading until the command says done."""

    def __init__(
        self,
        procedure: Procedure,
        finished: Collection[str] = (),
        X_TS: Array | None = None,
        start: Array | None = None,
    ) -> None:
        """Plan every pose that is not among the finished keys ('grip/name').

        X_TS (4, 4) is the sensor's nominal pose; start (4, 4) where C is in T now.
        """
        self._to_tool = wrench_transform(np.eye(4) if X_TS is None else X_TS)
        self.procedure = procedure
        targets = design(procedure.excitation, procedure.limits, procedure.fit.model)
        plan = [(g, t) for g in range(len(procedure.widths)) for t in targets]
        self.total = len(plan)
        self._queue = [(g, t) for g, t in plan if f"{g}/{t.name}" not in finished]
        self.done = self.total - len(self._queue)
        self._settle = RestDetector(procedure.settle)
        self._dwell: _Dwell | None = None
        self._grip: int | None = None
        self._grip_start: float | None = None
        self._tare: Array | None = None
        self._at = np.eye(4) if start is None else start
        self._stamp: float | None = None
        self._begin: float | None = None
        self._started_with = self.done
        self._retreat = False
        self._via: list[tuple[float, ...]] = [] if start is None else [flat_pose(start)]

    def remaining(self, stamp: float) -> float:
        """Seconds left, from the pace so far; nan before the first pose."""
        fresh = self.done - self._started_with
        return float("nan") if not fresh or self._begin is None else (stamp - self._begin) / fresh * len(self._queue)

    def step(self, reading: Reading) -> Command:
        """The command that answers a reading."""
        dt = 0.0 if self._stamp is None else reading.stamp - self._stamp
        self._stamp = reading.stamp
        self._begin = reading.stamp if self._begin is None else self._begin
        if self._retreat:  # straight to the centre, where every load falls
            self._retreat = not self._approach(np.eye(4), dt)
            return self._command("retreating")
        if self._dwell is None:
            if not self._queue:
                return self._command("home", done=self._approach(np.eye(4), dt))
            grip, target = self._queue[0]
            if grip != self._grip and not self._change_grip(grip, reading.stamp, dt):
                return self._command("gripping")
            self._dwell = _Dwell(target)
        trouble = self._trouble(reading)
        if trouble:
            return trouble
        return self._visit(self._dwell, reading, dt)

    def _command(self, state: str, **more: object) -> Command:
        grip = self._queue[0][0] if self._queue else len(self.procedure.widths) - 1
        return Command(self._at, self.procedure.widths[grip], grip, state, **more)  # type: ignore[arg-type]

    def _change_grip(self, grip: int, stamp: float, dt: float) -> bool:
        """Go to the centre and give the gripper time there; whether it has had it."""
        if not self._approach(np.eye(4), dt):
            return False
        if self._grip_start is None:
            self._grip_start = stamp
            self._via.append((0.0,) * 6)
        if stamp - self._grip_start < self.procedure.motion.grip_time:
            return False
        self._grip, self._grip_start, self._tare = grip, None, None
        return True

    def _approach(self, goal: Array, dt: float) -> bool:
        """Move the commanded pose towards goal; whether it is there."""
        self._at, there = towards(self._at, goal, dt, self.procedure.motion)
        return there

    def _trouble(self, reading: Reading) -> Command | None:
        """What to do about slip or a limit; None when all is well."""
        limits = self.procedure.limits
        if reading.gross_slip or reading.slip > limits.slip:
            reason = f"the tool slips in the grasp (slip {reading.slip:.2f}, limits.slip = {limits.slip:g})"
            return self._command("failed", failure=f"{reason}: grip again, more firmly or with smaller poses")
        if self._tare is None:
            self._tare = reading.wrench
        reason = limit_reached(reading.X_TC, self._to_tool @ (reading.wrench - self._tare), limits)
        dwell = self._dwell
        if not reason or dwell is None or dwell.target.kind == "home":
            return None
        return self._draw_back(dwell, reason)

    def _draw_back(self, dwell: _Dwell, reason: str) -> Command:
        self._settle.reset()
        self._retreat = True
        self._via += [flat_pose(self._at), (0.0,) * 6]
        if dwell.attempts == _ATTEMPTS:
            self._queue.pop(0)
            self._dwell = None
            return self._command("skipped", event=f"{dwell.target.name} skipped: {reason}")
        self._dwell = _Dwell(dwell.target.scaled(_DRAW_BACK), dwell.attempts + 1)
        return self._command("drawing back", event=f"{dwell.target.name} drawn back: {reason}")

    def _visit(self, dwell: _Dwell, reading: Reading, dt: float) -> Command:
        if dwell.start is None:
            if self._approach(dwell.target.X_TC, dt):
                dwell.start = reading.stamp
                self._settle.reset()
            return self._command("moving")
        if not dwell.readings:
            rest = self._settle.update(reading.stamp, reading.wrench)
            if not rest and reading.stamp - dwell.start < self.procedure.settle.timeout:
                return self._command("settling")
        dwell.readings.append(reading)
        if reading.stamp - dwell.readings[0].stamp < self.procedure.settle.average:
            return self._command("measuring", measuring=True)
        grip, _ = self._queue.pop(0)
        self._dwell, self.done = None, self.done + 1
        sample = average(dwell.target, grip, dwell.readings, self._settle.quality, dwell.attempts > 1, tuple(self._via))
        self._via = []
        if dwell.target.kind == "home":
            self._tare = np.array(sample.wrench)
        return self._command("measured", sample=sample)


def towards(X: Array, goal: Array, dt: float, motion: MotionParameters) -> tuple[Array, bool]:
    """The pose after dt [s] on the straight way from X to goal at the limited rates, and whether that is goal."""
    distance = float(np.linalg.norm(goal[:3, 3] - X[:3, 3])) / motion.speed
    angle = float(np.linalg.norm(so3_log(X[:3, :3].T @ goal[:3, :3]))) / np.deg2rad(motion.turn_rate_deg)
    needed = max(distance, angle)
    if needed <= dt:
        return goal, True
    return interpolate_pose(X, goal, dt / needed), False


def mean_pose(X: list[Array]) -> Array:
    """Mean (4, 4) of poses that lie close together."""
    out = np.eye(4)
    out[:3, 3] = np.mean([x[:3, 3] for x in X], axis=0)
    out[:3, :3] = Rotation.from_matrix(np.array([x[:3, :3] for x in X])).mean().as_matrix()
    return out


def average(
    target: Target,
    grip: int,
    readings: list[Reading],
    settle: float,
    clipped: bool,
    via: tuple[tuple[float, ...], ...] = (),
) -> Sample:
    """One sample from the readings of one pose at rest."""
    wrenches = np.array([r.wrench for r in readings])
    estimated = [r.X_TC_estimated for r in readings if r.X_TC_estimated is not None]
    pressures = np.array([r.pressures for r in readings]).reshape(len(readings), -1)
    return Sample(
        name=target.name,
        kind=target.kind,
        grip=grip,
        stamp=float(np.mean([r.stamp for r in readings])),
        kinematic=flat_pose(mean_pose([r.X_TC for r in readings])),
        estimator=flat_pose(mean_pose(estimated)) if estimated else None,
        wrench=tuple(float(v) for v in wrenches.mean(axis=0)),
        wrench_std=tuple(float(v) for v in wrenches.std(axis=0)),
        pressures=tuple(float(v) for v in pressures.mean(axis=0)),
        width=float(np.mean([r.width for r in readings])),
        settle=round(settle, 3),
        readings=len(readings),
        slip=max(r.slip for r in readings),
        clipped=clipped,
        via=via,
    )

# SPDX-License-Identifier: Apache-2.0
"""The identification as a state machine: readings in, commands out; the same for simulation and hardware.

At each grip it waits for the gripper, then for each pose: moves there along a straight line at a limited rate, waits
until the wrench has come to rest, averages, and hands over a sample. Limits are watched on the way and there: when
the wrench meets one, or the estimator loses the tool, the pose is drawn back and tried once more, later ones go less
far (`reach`); when the tool slips, or the load goes on growing on the way back, the run ends.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from seed_core.estimate import MembraneMotion
from seed_core.spatial import Array, interpolate_pose, length, so3_log
from seed_sysid.data.dataset import Pose, Sample, flat_pose
from seed_sysid.data.membrane_sample import mean_membrane, mean_pose
from seed_sysid.parameters import MotionParameters, Procedure
from seed_sysid.run.excitation import Target, designs
from seed_sysid.run.reach import Reach, limit_reached, load_share
from seed_sysid.run.rest_detector import RestDetector
from seed_sysid.stiffness_map import wrench_transform

_DRAW_BACK = 0.7  # factor on a pose whose wrench met a limit
_ATTEMPTS = 3
_OVERLOAD = 1.5  # times the limits of force and torque, and what was met, at which the way to the centre ends
_LONGEST = 0.5  # [s] of motion in one step, however far the clock goes on
_NEVER = 0.001  # least quality of rest that is written; 0 says that nobody knows
_CENTRE: Pose = (0.0,) * 6


@dataclass(frozen=True)
class Reading:
    """All that is known at one instant.

    Attributes:
        X_TC: displacement from kinematics (4, 4); X_TC_estimated: from the estimator, None without a new image.
        wrench: load on the sensor about S, in S (6,) [N m, N].
        width: of the gripper [m]. pressures: of the bubbles that tell theirs [hPa]. slip: of the estimate [1].
        membrane: what the membranes do, () without a new image.
        followed: whether the estimator follows the tool; None without a new image, or without an estimator.
    """

    stamp: float
    X_TC: Array
    wrench: Array
    width: float
    pressures: tuple[float, ...] = ()
    X_TC_estimated: Array | None = None
    slip: float = 0.0
    gross_slip: bool = False
    membrane: tuple[MembraneMotion, ...] = ()
    followed: bool | None = None


@dataclass(frozen=True)
class Command:
    """Where C should be in T now (4, 4), how wide the gripper [m], and what is being done.

    width: None leaves it as it is, on the way to the centre, where the tool bears a change.
    """

    X_TC: Array
    width: float | None
    grip: int
    state: str
    measuring: bool = False
    sample: Sample | None = None
    event: str = ""
    done: bool = False
    failure: str = ""
    lost: str = ""  # key of the pose at which the tool was lost, with a failure
    regrasp: bool = False  # after which a new grasp mends the failure
    slid: bool = False  # the tool did, with a failure: to go on it is gripped again


@dataclass
class _Visit:
    """The pose being visited: since when the arm is there, and what was measured."""

    target: Target
    attempts: int = 1
    arrival: float | None = None
    readings: list[Reading] = field(default_factory=list)


class Run:
    """One identification over all grips; step() with each reading until the command says done."""

    def __init__(
        self,
        procedure: Procedure,
        finished: Collection[str] = (),
        X_TS: Array | None = None,
        start: Array | None = None,
        lost: Sequence[str] = (),
        grasp: int = 0,
    ) -> None:
        """Plan every pose that is not among the finished keys ('grip/name'), nor twice among the lost.

        X_TS (4, 4) is the sensor's nominal pose; start (4, 4) where C is in T now; lost: keys of the poses at which the
        tool was lost and an earlier run ended, one for each time; grasp: number of the grasp.
        """
        self.procedure = procedure
        plan = [(grip, target) for grip, targets in enumerate(designs(procedure)) for target in targets]
        self.total = len(plan)
        to_go = [(grip, target) for grip, target in plan if _key(grip, target) not in finished]
        self.done = self.total - len(to_go)
        self._queue = [pose for pose in to_go if lost.count(_key(*pose)) < 2]
        self._to_tool = wrench_transform(np.eye(4) if X_TS is None else X_TS)
        self._rest = RestDetector(procedure.settle)
        self._reach = Reach(procedure.excitation, procedure.limits)
        self._followed: float | None = None  # when the estimator last followed the tool [s], at this grip
        self._seen = True  # that it did at its last image
        self._centred: float | None = None  # since when the tool is looked for at the centre [s]
        self._lost_on: set[tuple[int, Target]] = set()  # grips and poses on whose way it was lost
        self._lost_at = set(lost)  # keys of the poses that asked for a new grasp
        self._visit: _Visit | None = None
        self._grasp = grasp
        self._grip: int | None = None  # that the gripper holds
        self._grip_start: float | None = None
        self._tare: Array | None = None
        self._at = np.eye(4) if start is None else start
        self._via: list[Pose] = [] if start is None else [flat_pose(start)]
        self._retreat = False
        self._met = 1.0  # share of the limits of force and torque at which the way back began
        self._begin: tuple[float, int] | None = None  # stamp, and poses that were done then
        self._stamp: float | None = None

    def remaining(self, stamp: float) -> float:
        """Seconds left, from the pace so far; nan before the first pose."""
        if self._begin is None or self.done == self._begin[1]:
            return float("nan")
        return (stamp - self._begin[0]) / (self.done - self._begin[1]) * len(self._queue)

    def regrasped(self) -> None:
        """The failure was mended by a new grasp at the centre: go on with the pose at which it happened."""
        self._grip, self._visit, self._retreat, self._at = None, None, False, np.eye(4)
        self._via = []
        self._grasp += 1

    def step(self, reading: Reading) -> Command:
        """The command that answers a reading."""
        since = 0.0 if self._stamp is None else reading.stamp - self._stamp
        dt = min(max(since, 0.0), _LONGEST)  # a clock may be set
        self._stamp = reading.stamp
        self._begin = self._begin or (reading.stamp, self.done)
        lost = self._lost(reading)
        load = 0.0 if self._tare is None else load_share(self._load(reading), self.procedure.limits)
        if load > _OVERLOAD * self._met and (self._visit is None or self._retreat or self._visit.target.kind == "home"):
            return self._overloaded(reading)
        if self._retreat:  # straight to the centre, where every load falls
            self._retreat = not self._approach(np.eye(4), dt) or bool(lost)
            return self._search(reading.stamp, lost) if lost else self._command("retreating")
        self._centred = None
        if self._visit is None:
            if not self._queue:
                return self._command("home", done=self._approach(np.eye(4), dt))
            grip, target = self._queue[0]
            if grip != self._grip and not self._change_grip(grip, reading.stamp, dt):
                return self._command("gripping")
            self._visit = _Visit(self._reach.within(target))
        limits = self.procedure.limits
        if reading.gross_slip or reading.slip > limits.slip:
            reason = f"the tool slips in the grasp (slip {reading.slip:.2f}, limits.slip = {limits.slip:g})"
            failure = f"{reason}: grip again where it was gripped first, or with another output and smaller poses"
            return self._command("failed", failure=failure, event=f"{self._visit.target.name}: {reason}", slid=True)
        if self._tare is None:
            self._tare = reading.wrench
        reason = limit_reached(reading.X_TC, self._load(reading), limits)
        reason = reason or lost
        if reason and self._visit.target.kind != "home":
            if lost:
                self._lost_on.add(self._queue[0])
            self._met = max(1.0, load)
            return self._draw_back(self._visit, reason)
        self._met = 1.0
        return self._measure(self._visit, reading, dt)

    def _load(self, reading: Reading) -> Array:
        """(6,) on the tool, without the sensor's bias."""
        tare = np.zeros(6) if self._tare is None else self._tare
        return np.asarray(self._to_tool @ (reading.wrench - tare))

    def _overloaded(self, reading: Reading) -> Command:
        """The arm stays where it is: something presses on the way to the centre, where every load should fall."""
        load = self._load(reading)
        force, torque = length(load[3:]), length(load[:3])
        reason = f"{force:.1f} N and {torque:.2f} N m on the way to the centre, where the load should fall"
        failure = f"{reason}: see what the tool or the gripper touches, and move the arm free of it by hand"
        return self._command("failed", failure=failure, event=reason)

    def _command(self, state: str, **more: object) -> Command:
        grip = self._queue[0][0] if self._queue else len(self.procedure.widths) - 1
        width = self.procedure.widths[grip] if grip == self._grip or self._grip_start is not None else None
        return Command(self._at, width, grip, state, **more)  # type: ignore[arg-type]

    def _change_grip(self, grip: int, stamp: float, dt: float) -> bool:
        """Go to the centre and give the gripper time there; whether it has had it."""
        if not self._approach(np.eye(4), dt):
            return False
        if self._grip_start is None:
            self._grip_start = stamp
            self._via.append(_CENTRE)
        if stamp - self._grip_start < self.procedure.motion.grip_time:
            return False
        self._grip, self._grip_start, self._tare, self._followed = grip, None, None, None
        self._seen = True
        return True

    def _lost(self, reading: Reading) -> str:
        """That an estimator which followed the tool does so no longer; '' while it does, or where there is none."""
        self._seen = self._seen if reading.followed is None else reading.followed
        if reading.followed:
            self._followed = reading.stamp
        if self._seen or self._followed is None:
            return ""
        age, most = reading.stamp - self._followed, self.procedure.limits.lost
        return f"the estimator has not followed the tool for {age:.1f} s (at most {most:g} s)" if age > most else ""

    def _search(self, stamp: float, lost: str) -> Command:
        """Wait at the centre for the estimator to find the tool."""
        if not np.allclose(self._at, np.eye(4)):
            return self._command("retreating")
        self._centred = stamp if self._centred is None else self._centred
        if stamp - self._centred <= self.procedure.limits.search:
            return self._command("searching")
        reason = f"{lost}, {self.procedure.limits.search:g} s of them at the centre (limits.search)"
        failure = f"{reason}: grip the tool anew and initialise the grasp"
        if not self._queue:
            return self._command("failed", failure=failure, regrasp=True)
        key, event = _key(*self._queue[0]), f"{self._queue[0][1].name}: the tool was lost there"
        if key in self._lost_at:
            event = f"{self._queue.pop(0)[1].name} skipped: the tool was lost there twice"
        self._lost_at.add(key)
        return self._command("failed", failure=failure, event=event, lost=key, regrasp=True)

    def _approach(self, goal: Array, dt: float) -> bool:
        """Move the commanded pose towards goal; whether it is there."""
        self._at, there = towards(self._at, goal, dt, self.procedure.motion)
        return there

    def _draw_back(self, visit: _Visit, reason: str) -> Command:
        self._rest.reset()
        self._retreat = True
        self._via += [flat_pose(self._at), _CENTRE]
        if visit.attempts == _ATTEMPTS:
            self._queue.pop(0)
            self._visit = None
            return self._command("skipped", event=f"{visit.target.name} skipped: {reason}")
        self._reach.failed(visit.target, _DRAW_BACK)
        self._visit = _Visit(visit.target.scaled(_DRAW_BACK), visit.attempts + 1)
        return self._command("drawing back", event=f"{visit.target.name} drawn back: {reason}")

    def _measure(self, visit: _Visit, reading: Reading, dt: float) -> Command:
        """Go to the pose, wait for rest, average."""
        settle = self.procedure.settle
        if visit.arrival is None:
            if self._approach(visit.target.X_TC, dt):
                visit.arrival = reading.stamp
                self._rest.reset()
            return self._command("moving")
        if not visit.readings:
            rest = self._rest.update(reading.stamp, reading.wrench)
            if not rest and reading.stamp - visit.arrival < settle.timeout:
                return self._command("settling")
        visit.readings.append(reading)
        if reading.stamp - visit.readings[0].stamp < settle.average:
            return self._command("measuring", measuring=True)
        planned = self._queue.pop(0)
        grip, lost = planned[0], planned in self._lost_on
        self._visit, self.done = None, self.done + 1
        clipped = visit.attempts > 1
        sample = average(visit.target, grip, visit.readings, self._rest.quality, clipped, self._via, lost, self._grasp)
        self._via = []
        if visit.target.kind == "home":
            self._tare = np.array(sample.wrench)
        elif self._tare is not None:
            self._reach.measured(visit.target, self._to_tool @ (np.array(sample.wrench) - self._tare))
        return self._command("measured", sample=sample)


def _key(grip: int, target: Target) -> str:
    """As Sample.key."""
    return f"{grip}/{target.name}"


def towards(X: Array, goal: Array, dt: float, motion: MotionParameters) -> tuple[Array, bool]:
    """The pose after dt [s] on the straight way from X to goal at the limited rates, and whether that is goal."""
    distance = float(np.linalg.norm(goal[:3, 3] - X[:3, 3])) / motion.speed
    angle = float(np.linalg.norm(so3_log(X[:3, :3].T @ goal[:3, :3]))) / np.deg2rad(motion.turn_rate_deg)
    needed = max(distance, angle)
    if needed <= dt:
        return goal, True
    return interpolate_pose(X, goal, dt / needed), False


def average(
    target: Target,
    grip: int,
    readings: list[Reading],
    settle: float,
    clipped: bool,
    via: Sequence[Pose] = (),
    lost: bool = False,
    grasp: int = 0,
) -> Sample:
    """One sample from the readings of one pose at rest."""
    wrenches = np.array([r.wrench for r in readings])
    estimated = [r.X_TC_estimated for r in readings if r.X_TC_estimated is not None]
    known = len(readings[-1].pressures)  # a bubble may begin to report its own meanwhile
    pressures = [r.pressures for r in readings if len(r.pressures) == known]
    return Sample(
        name=target.name,
        kind=target.kind,
        grip=grip,
        stamp=float(np.mean([r.stamp for r in readings])),
        kinematic=flat_pose(mean_pose([r.X_TC for r in readings])),
        estimator=flat_pose(mean_pose(estimated)) if estimated else None,
        wrench=tuple(wrenches.mean(axis=0).tolist()),
        wrench_std=tuple(wrenches.std(axis=0).tolist()),
        pressures=tuple(np.mean(pressures, axis=0).tolist()),
        width=float(np.mean([r.width for r in readings])),
        settle=max(round(settle, 3), _NEVER),
        readings=len(readings),
        slip=max(r.slip for r in readings),
        clipped=clipped,
        lost=lost,
        via=tuple(via),
        membrane=mean_membrane([r.membrane for r in readings]),
        grasp=grasp,
    )

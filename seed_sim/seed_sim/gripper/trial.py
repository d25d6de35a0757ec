# SPDX-License-Identifier: Apache-2.0
"""One pull at one grasp, with the grip that answers slip or without; and the least grip that would have held."""

from collections import deque
from dataclasses import dataclass, replace
from math import inf, isfinite, nan
from typing import NamedTuple

import numpy as np

from seed_control.grip import GripControl, GripSettings, KeptLoad, SlipMargin, SlipSigns
from seed_core.bushing import Bushing, Stiffness
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, so3_exp, so3_log
from seed_sim.gripper.gripper import GripperSection, SimulatedGripper
from seed_sim.gripper.held import DT, WIDTH, HeldTool, TornError
from seed_sim.gripper.pulls import RADIUS, Pull
from seed_sim.membrane import MembraneError

MOST_SQUEEZE = 0.0145  # [m]: what the membranes are let bear
MORE = 1.05  # times the first grip: more grip
BEGUN = 2e-4  # [m] of slide on the membranes: slip has begun
_TAIL = 0.3  # [s] after the pull
_HALVINGS = 3
_IDENTIFIED = 4  # grips


@dataclass(frozen=True)
class Measured:
    """What the controller is told: as an estimator on images tells it, late."""

    rate: float = 45.0  # [Hz]
    delay: float = 0.03  # [s] from image to estimate
    position: float = 1e-4  # [m] deviation of the pose
    rotation: float = float(np.deg2rad(0.2))  # [rad]
    slip: float = 0.02  # [1] deviation of slip and incipient slip
    alarm: float = 0.0015  # [m] of slide from which gross slip is told
    friction: float = 0.1  # relative deviation of the friction that was identified
    stiffness: float = 0.08  # relative deviation of each identified stiffness
    force: float = 0.05  # relative deviation of the gripper's own reading
    force_noise: float = 0.1  # [N]


class PullMoment(NamedTuple):
    """For pictures: time [s], load over first friction [1], grip, told margin, true margin, slid [m]."""

    t: float
    load: float
    grip: float
    told: float
    margin: float
    slid: float


class PullOutcome(NamedTuple):
    """Of one trial.

    Attributes:
        broken: the tool slid by 5 mm or was torn off. slid: [m] on the membranes at the end.
        onset, more: [s] when it had slid by 0.2 mm, and when there was more grip (a twentieth); inf: never.
        grip: [N] mean of each finger while it was pulled. peak: [N] the most. reason: of the first hold.
    """

    broken: bool
    slid: float
    onset: float
    more: float
    grip: float
    peak: float
    reason: str
    moments: tuple[PullMoment, ...]


class _Eyes:
    """Measurements of one trial, with their errors."""

    def __init__(self, held: HeldTool, m: Measured, rng: np.random.Generator) -> None:
        self._m, self._rng = m, rng
        squeezes = np.linspace(held.first, MOST_SQUEEZE, _IDENTIFIED).tolist()
        found = held.stiffness_at(squeezes)
        off = 1.0 + m.stiffness * rng.normal(size=6)
        self._widths = [WIDTH - 2.0 * (s - held.first) for s in squeezes][::-1]
        self._stiffness = np.array([k * off for k, _ in found])[::-1]
        grips = [grip for _, grip in found]
        self.rise = (grips[-1] - grips[0]) / max(self._widths[-1] - self._widths[0], 1e-6)  # [N/m]
        self.friction = held.pull.membrane.friction * float(np.clip(1.0 + m.friction * rng.normal(), 0.6, 1.5))
        self._gain = 1.0 + m.force * float(rng.normal())
        self._kept = KeptLoad()

    def force(self, grip: float) -> float:
        return max(self._gain * grip + self._m.force_noise * float(self._rng.normal()), 0.0)

    def image(self, held: HeldTool, width: float) -> tuple[Wrench, Array, SlipSigns]:
        """Spring in C, covariance and signs, by the stiffness that belongs to the width."""
        m, rng = self._m, self._rng
        true = held.slip()
        slip, incipient = (max(share + m.slip * float(rng.normal()), 0.0) for share in (true.share, true.incipient))
        noise = make_pose(so3_exp(m.rotation * rng.normal(size=3)), m.position * rng.normal(size=3))
        X_CT = _material(held.X_CT @ noise, held.lag(), slip - true.share)
        stiffness = Stiffness.from_vector(
            np.array([np.interp(width, self._widths, self._stiffness[:, i]) for i in range(6)])
        )
        X_TC = inverse_pose(X_CT)
        spring = self._kept.update(Bushing(stiffness).wrench(X_TC), stiffness, X_TC).rotated(X_CT[:3, :3])
        own = (0.1 * spring.vector()) ** 2
        covariance = np.diag(own + (stiffness.vector() * np.repeat((m.rotation, m.position), 3)) ** 2)
        return spring, covariance, SlipSigns(slip, incipient, true.slid > m.alarm)


def _material(X_CT: Array, lag: Array, share: float) -> Array:
    """How the membranes' material has moved (4, 4), of which the load comes, as MembraneMotion tells it.

    Args:
        X_CT: of the tool. lag: HeldTool's, which the material does not follow: a patch turns further than it shifts.
        share: of the motion by which that is told wrong.
    """
    turn, shift = so3_log(X_CT[:3, :3]), X_CT[:3, 3]
    about_y, along_x, along_z = lag
    return make_pose(
        so3_exp((1.0 - share) * turn - np.array((0.0, about_y, 0.0))),
        (1.0 - share) * shift - np.array((along_x, 0.0, along_z)),
    )


def holds(pull: Pull, squeeze: float) -> bool:
    """Whether a grip that stays at an imprint [m] holds against a pull."""
    try:
        held = HeldTool(pull, squeeze, start=pull.begins - 0.02)
        while held.t < pull.ends:
            held.advance()
    except (MembraneError, TornError):
        return False
    return True


class _Tally:
    """What is counted over one trial: see `PullOutcome`."""

    def __init__(self, held: HeldTool) -> None:
        self.onset = self.more = inf
        self.peak = self._first = held.grip
        self._grips: list[float] = []

    def add(self, held: HeldTool) -> None:
        """One more step."""
        t, pull, grip = held.t, held.pull, held.grip
        if t <= pull.begins:
            self._first = grip
        elif self.onset == inf and held.slid >= BEGUN:
            self.onset = t
        if self.more == inf and t > pull.begins and grip >= MORE * self._first:
            self.more = t
        self.peak = max(self.peak, grip)
        if pull.begins <= t <= pull.ends:
            self._grips.append(grip)

    @property
    def grip(self) -> float:
        """Mean while it was pulled [N]."""
        return sum(self._grips) / max(len(self._grips), 1)


def run_pull(pull: Pull, gripper: GripperSection | None = None, keep: bool = False) -> PullOutcome:
    """Pull at one grasp whose grip answers slip.

    Args:
        pull: what, and how.
        gripper: its limits.
        keep: the moments, for a picture.

    Raises:
        MembraneError: membranes that cannot be closed.
    """
    held = HeldTool(pull)
    m = Measured()
    rng = np.random.default_rng((pull.seed, 0xE1E5))
    eyes = _Eyes(held, m, rng)
    section = replace(gripper or GripperSection(), min_width=max(WIDTH - 2.0 * (MOST_SQUEEZE - held.first), 0.0))
    fingers = SimulatedGripper(section, WIDTH)
    settings = replace(
        GripSettings(), friction=eyes.friction, least_force=held.grip,
        max_force=section.max_force, min_width=section.min_width, force_per_width=eyes.rise,
    )  # fmt: skip
    margin, control = SlipMargin(settings), GripControl(settings)
    waiting: deque[tuple[float, Wrench, Array, SlipSigns, float]] = deque()
    next_image = float(rng.uniform(0.0, 1.0 / m.rate))
    tally, reason, told, broken = _Tally(held), "", nan, False
    moments: list[PullMoment] = []
    while held.t < pull.ends + _TAIL:
        try:
            held.advance(fingers.advance(held.t + DT, DT, held.grip, eyes.rise))
        except TornError:
            broken = True
            break
        t = held.t
        tally.add(held)
        if t >= next_image:
            next_image += 1.0 / m.rate
            waiting.append((t, *eyes.image(held, fingers.width), eyes.force(held.grip)))
        control.heard(t, fingers.width, eyes.force(held.grip))
        while waiting and t >= waiting[0][0] + m.delay:
            stamp, spring, covariance, signs, force = waiting.popleft()
            now = margin.update(stamp, spring, covariance, force, signs)
            told = now.value
            control.image(now, t)
            if signs.gross:
                control.slipped(t, stamp)
        command = control.command(t)
        reason = reason or command.hold
        if isfinite(command.force):
            fingers.command_force(t, command.force)
        if keep:
            moments.append(_moment(held, told))
    return PullOutcome(broken, held.slid, tally.onset, tally.more, tally.grip, tally.peak, reason, tuple(moments))


def _moment(held: HeldTool, told: float) -> PullMoment:
    spring, friction = held.spring, held.pull.friction_at(held.t)
    load = float(np.linalg.norm((spring.force[0], spring.force[2], spring.torque[1] / RADIUS)))
    used = load / (2.0 * friction * max(held.grip, 1e-3))
    return PullMoment(held.t, load, held.grip, told, 1.0 - used, held.slid)


def necessary(pull: Pull) -> float:
    """The least constant grip [N] that holds against the pull, within 3 %; inf: the membranes' most does not."""
    held = HeldTool(pull)
    squeezes = np.linspace(0.6 * held.first, MOST_SQUEEZE, _IDENTIFIED + 2)
    grips = np.array([grip for _, grip in held.stiffness_at(squeezes.tolist())])
    force = pull.load(pull.begins + pull.rise, held.first_grip)
    friction = pull.membrane.friction * min(pull.friction, 1.0)
    middle = float(np.hypot(np.linalg.norm(force.force), force.torque[1] / RADIUS)) / (2.0 * friction)
    low, high = 0.7 * middle, 1.15 * middle
    if grips[-1] < high:
        high = float(grips[-1])
    if not holds(pull, float(np.interp(high, grips, squeezes))):
        return inf
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(pull, float(np.interp(middle, grips, squeezes))) else (middle, high)
    return 0.5 * (low + high)

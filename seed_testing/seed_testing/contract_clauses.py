# SPDX-License-Identifier: Apache-2.0
"""The clauses of the contract of an arm (docs/arm_contract.md): each moves the arm, and measures if it is kept."""

import math
import time
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from seed_core.arm.quaternion import turn_between, turned
from seed_core.spatial import Array
from seed_core.vector3 import minus, norm, plus, plus_scaled, scaled
from seed_ros.conversions import seconds
from seed_testing.peer import Path, Peer, Pose

STEP = 0.01  # [m] the largest motion asked for is twice this
RATE, MOVING = 3.0, 0.6  # [rad/s] of the sine of an arm that is to stop, and [s] into it: its fastest is then near
WATCHED = 1.5  # [s] after that
JUMPS = 0.5  # [s] for which targets are a jump
NO_NUMBERS = 0.05  # [s] for which they are NaN: an arm hears one of them, and no silence
SETTLE = 1.5  # [s]
LOOK_BACK = 0.05  # [s] before what is done to a motion: an arm may obey before its next pose
STILL = 0.3  # [mm] an arm that rests moves by less
TURN = 0.01  # [rad] from a target that stays, at most
EARLY = 0.005  # [s] that a stamp may be in the future, for clocks are read one after the other
AHEAD = 0.01  # [s] that the lag of a fit may be below zero


class Limits(NamedTuple):
    """What the arm is held to; the defaults are those of the suite."""

    pose_rate: float = 100.0  # [Hz] at least
    pose_age: float = 0.05  # [s] at most, median
    accuracy: float = 0.001  # [m]
    lag: float = 0.2  # [s] at most
    speed: float = 0.25  # [m/s] never exceeded
    acceleration: float = 1.0  # [m/s^2] that it brakes with
    timeout: float = 0.1  # [s] of silence before it brakes
    stop_within: float = 0.6  # [s] after the last target: time-out, braking, lag
    enable: str = "resend_robot_program"  # service that makes it follow again; empty: none needed

    @property
    def top_speed(self) -> float:
        """[m/s] that may be measured, from poses whose arrival jitters."""
        return 1.1 * self.speed

    def coast(self, waits: float) -> float:
        """[m] that it may go on by: `waits` [s] and its lag long as before, and the way that it brakes along."""
        speed = RATE * STEP
        return speed * (LOOK_BACK + waits + self.lag) + 0.5 * speed**2 / self.acceleration + self.accuracy


class Found(NamedTuple):
    """What a clause has come to."""

    kept: bool
    measured: str
    bound: str  # that the measured values are held to


Clause = Callable[[Peer, Limits], Found]


def poses_come_often_and_fresh(peer: Peer, limits: Limits) -> Found:
    """current_pose at a rate, with stamps that increase and are not old."""
    peer.poses.clear()
    peer.spin(2.0)
    now = peer.node.get_clock().now().nanoseconds * 1e-9 - time.monotonic()
    stamps = [seconds(m.header.stamp) for _, m in peer.poses]
    ages = [t + now - s for (t, _), s in zip(peer.poses, stamps, strict=True)]
    ordered = all(b > a for a, b in pairwise(stamps))
    rate, age = len(stamps) / 2.0, float(np.median(ages)) if ages else math.inf
    good = rate >= limits.pose_rate and ordered and -EARLY <= age <= limits.pose_age
    text = f"{rate:.0f} Hz, stamps {'' if ordered else 'do not '}increase, median age {1e3 * age:.1f} ms"
    bound = f"at least {limits.pose_rate:.0f} Hz, stamps increase, {-1e3 * EARLY:.0f} to {1e3 * limits.pose_age:.0f} ms"
    return Found(good, text, bound)


def poses_are_in_the_base_frame(peer: Peer, limits: Limits) -> Found:  # noqa: ARG001
    """frame_id and a unit quaternion."""
    frame = peer.poses[-1][1].header.frame_id
    length = math.hypot(*peer.pose()[1])
    good = frame == peer.base and abs(length - 1.0) < 1e-6
    return Found(good, f"frame '{frame}', quaternion of length {length:.6f}", f"frame '{peer.base}', length 1")


def targets_are_reached(peer: Peer, limits: Limits) -> Found:
    """A small motion in all six axes and back."""
    p, q = here = peer.pose()
    there = plus(p, (STEP, -STEP, STEP)), turned(q, (0.05, -0.05, 0.05))
    errors = []
    for start, goal in ((here, there), (there, here)):
        peer.stream(partial(_between, start, goal), 1.0 + SETTLE)
        p, q = peer.pose()
        errors.append((math.dist(p, goal[0]), norm(turn_between(q, goal[1]))))
    far, turn = np.max(errors, axis=0)
    text = f"missed by {1e3 * far:.2f} mm and {math.degrees(turn):.3f} degrees at most"
    bound = f"at most {1e3 * limits.accuracy:.2f} mm and {math.degrees(TURN):.3f} degrees"
    return Found(bool(far <= limits.accuracy and turn <= TURN), text, bound)


def _between(start: Pose, goal: Pose, t: float) -> Pose:
    """At time t [s] on the straight way from start to goal, which takes a second."""
    share, ((p, q), (p_goal, q_goal)) = min(1.0, t), (start, goal)
    return plus_scaled(p, share, minus(p_goal, p)), turned(q, scaled(turn_between(q_goal, q), share))


def lag_is_small_and_known(peer: Peer, limits: Limits) -> Found:
    """Delay between a slow sine of targets and the poses, and the largest speed on the way."""
    rate, start, y = 2.0, time.monotonic(), peer.pose()[0][1]
    peer.stream(_sine(peer, rate), 5.0)
    track = _track(peer, start + 1.0)
    phase = rate * (track[:, 0] - start)
    basis = np.column_stack((np.ones(len(track)), np.cos(phase), np.sin(phase)))
    _, c, s = np.linalg.lstsq(basis, track[:, 2] - y, rcond=None)[0]
    lag = math.atan2(-s, -c) / rate
    speed = _top_speed(track)
    good = -AHEAD <= lag <= limits.lag and speed <= limits.top_speed
    text = f"lag {1e3 * lag:.0f} ms, amplitude {1e3 * math.hypot(c, s):.2f} mm, never above {speed:.3f} m/s"
    return Found(good, text, f"{-1e3 * AHEAD:.0f} to {1e3 * limits.lag:.0f} ms, at most {limits.top_speed:.3f} m/s")


def silence_stops_the_arm(peer: Peer, limits: Limits) -> Found:
    """No target any more."""
    _move(peer)
    start = time.monotonic()
    peer.spin(WATCHED)
    return _stopped(peer, limits, start, limits.coast(limits.timeout))


def after_silence_nothing_moves_unasked(peer: Peer, limits: Limits) -> Found:  # noqa: ARG001
    """Targets that come back find a latched hold."""
    _move(peer)
    peer.spin(1.0)
    start, ((x, y, z), q) = time.monotonic(), peer.pose()
    peer.stream(lambda t: ((x, y + 0.5 * STEP * min(1.0, t), z), q), 1.5)
    return _stayed(_track(peer, start))


def jumps_are_refused(peer: Peer, limits: Limits) -> Found:
    """Targets a metre away, then the path again."""
    (x, y, z), q = peer.pose()
    return _refuses(peer, limits, ((x, y + 1.0, z), q), JUMPS)


def not_a_number_is_refused(peer: Peer, limits: Limits) -> Found:
    """A few targets of NaN, then the path again."""
    (x, y, _), q = peer.pose()
    return _refuses(peer, limits, ((x, y, math.nan), q), NO_NUMBERS)


def old_targets_are_refused(peer: Peer, limits: Limits) -> Found:  # noqa: ARG001
    """Stamps of a second ago."""
    return _ignores(peer, age=1.0)


def foreign_frames_are_refused(peer: Peer, limits: Limits) -> Found:  # noqa: ARG001
    """A frame that is not the base."""
    return _ignores(peer, frame="some_other_frame")


def _sine(peer: Peer, rate: float) -> Path:
    """A sine along y from where the arm is, at `rate` [rad/s], starting at rest."""
    (x, y, z), q = peer.pose()
    return lambda t: ((x, y + STEP * (1 - math.cos(rate * t)), z), q)


def _move(peer: Peer) -> Path:
    """Have the arm move; the path that it is on."""
    path = _sine(peer, RATE)
    peer.stream(path, MOVING)
    return path


def _refuses(peer: Peer, limits: Limits, bad: Pose, lasts: float) -> Found:
    """A moving arm that hears bad targets, for so long [s], comes to rest and follows its path no more."""
    path, start, coast = _move(peer), time.monotonic(), limits.coast(0.0)
    here, _ = peer.pose()
    peer.stream(
        lambda t: bad if t < lasts else path(MOVING + t),
        WATCHED,
        lambda: math.dist(peer.pose()[0], here) < coast,  # an arm that obeys is not led on
    )
    peer.spin(max(0.0, start + WATCHED - time.monotonic()))
    return _stopped(peer, limits, start, coast)


def _stopped(peer: Peer, limits: Limits, start: float, coast: float) -> Found:
    """Whether the arm has come to rest since a monotonic time [s], and gone no further than coast [m] before."""
    track = _track(peer, start - LOOK_BACK)
    late = track[track[:, 0] > start + limits.stop_within]
    moved = float(np.ptp(late[:, 1:], axis=0).max()) if len(late) else math.inf
    way, speed = _way(track), _top_speed(track)
    good = way <= coast and 1e3 * moved < STILL and speed <= limits.top_speed
    text = f"coasted {1e3 * way:.2f} mm, then moved {1e3 * moved:.3f} mm, never above {speed:.3f} m/s"
    bound = f"at most {1e3 * coast:.2f} mm, below {STILL:.3f} mm from {limits.stop_within:g} s on, "
    return Found(good, text, f"{bound}at most {limits.top_speed:.3f} m/s")


def _ignores(peer: Peer, **how: Any) -> Found:
    """Targets 10 mm away that must not be followed; how: arguments of Peer.send."""
    start, ((x, y, z), q) = time.monotonic(), peer.pose()
    while time.monotonic() - start < 1.0:
        peer.send((x, y + STEP, z), q, **how)
        peer.spin(0.01)
    return _stayed(_track(peer, start - LOOK_BACK))


def _stayed(track: Array) -> Found:
    moved = 1e3 * float(np.ptp(track[:, 1:], axis=0).max())
    return Found(moved < STILL, f"moved {moved:.3f} mm", f"below {STILL:.3f} mm")


def _track(peer: Peer, since: float) -> Array:
    """(n, 4): arrival time [s] and position [m] of the poses since a monotonic time [s]."""
    rows = [(t, m.pose.position.x, m.pose.position.y, m.pose.position.z) for t, m in peer.poses if t > since]
    return np.array(rows, dtype=float).reshape(-1, 4)


def _way(track: Array) -> float:
    """How far a track went from where it began [m]; infinite for none."""
    return float(np.linalg.norm(track[:, 1:] - track[0, 1:], axis=1).max()) if len(track) else math.inf


def _top_speed(track: Array) -> float:
    """Largest speed [m/s] over windows of 20 to 40 ms, so that jitter of arrival does not count."""
    start = np.searchsorted(track[:, 0], track[:, 0] - 0.04)
    windows = track - track[start]
    windows = windows[windows[:, 0] > 0.02]
    return float(np.max(np.linalg.norm(windows[:, 1:], axis=1) / windows[:, 0], initial=0.0))


CLAUSES: tuple[Clause, ...] = (
    poses_come_often_and_fresh,
    poses_are_in_the_base_frame,
    targets_are_reached,
    lag_is_small_and_known,
    silence_stops_the_arm,
    after_silence_nothing_moves_unasked,
    jumps_are_refused,
    not_a_number_is_refused,
    old_targets_are_refused,
    foreign_frames_are_refused,
)

# SPDX-License-Identifier: Apache-2.0
"""Checks that an arm, whichever it is, does what the suite needs of one (docs/arm_contract.md).

    ./seed shell -c 'python -m seed_testing.arm_contract --arm driver'

Start the arm first (our driver, the simulated cell, a ros2_control robot with cartesian_controllers and an adapter)
and stand clear: it moves by up to 20 mm. Prints a line per clause and exits with 1 when one is not kept.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from seed_core.command_line import command
from seed_core.errors import SeedError
from seed_core.quaternion import turn_between, turned
from seed_core.vector3 import Vector3
from seed_testing.peer import Peer

STEP = 0.01  # [m] the largest motion asked for is twice this
SETTLE = 1.5  # [s]
STARTING = 5.0  # [s] that an arm may take to be ready
LOOK_BACK = 0.05  # [s] before what is done to a motion: an arm may obey before its next pose
OWN_PAUSE = 0.05  # [s] a pause of this program longer than this makes a broken clause doubtful
ATTEMPTS = 4  # at a doubtful clause


class Verdict(NamedTuple):
    """One clause of the contract."""

    clause: str
    kept: bool
    found: str  # what was measured


class Limits(NamedTuple):
    """What the arm is held to; the defaults are those of the suite."""

    pose_rate: float = 100.0  # [Hz] at least
    pose_age: float = 0.05  # [s] at most, median
    accuracy: float = 0.001  # [m]
    lag: float = 0.2  # [s] at most
    speed: float = 0.25  # [m/s] never exceeded
    stop_within: float = 0.6  # [s] after the last target: time-out 0.1 s, braking, lag
    enable: str = "resend_robot_program"  # service that makes it follow again; empty: none needed


Clause = Callable[[Peer, Limits], Verdict]


def check(peer: Peer, limits: Limits, clauses: Sequence[Clause] = ()) -> list[Verdict]:
    """The clauses in turn, all when none is named; the arm ends where it began, within millimetres."""
    out = []
    for clause in clauses or CLAUSES:
        name = clause.__name__.replace("_", " ")
        for _ in range(ATTEMPTS):
            peer.pause = 0.0
            verdict = _try(clause, name, peer, limits)
            if verdict.kept or peer.pause < OWN_PAUSE:
                break  # else this computer paused, and the arm is not to blame
        out.append(verdict)
    return out


def _try(clause: Clause, name: str, peer: Peer, limits: Limits) -> Verdict:
    try:
        enable(peer, limits)
        return clause(peer, limits)
    except SeedError as error:
        return Verdict(name, False, str(error))


def enable(peer: Peer, limits: Limits) -> None:
    """Let the arm rest, then ask it to follow again, as a user would."""
    peer.spin(0.5)
    peer.pose()
    if limits.enable:
        answer = peer.call(limits.enable)
        if not answer.success:
            raise SeedError(f"{limits.enable} refuses: {answer.message}")


def _verdict(clause: Callable[..., Verdict], kept: bool, found: str) -> Verdict:
    return Verdict(clause.__name__.replace("_", " "), bool(kept), found)


def _stamps(peer: Peer) -> list[float]:
    return [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for _, m in peer.poses]


def _track(peer: Peer, since: float) -> np.ndarray:
    """(n, 4): arrival time and position of the poses since a monotonic time."""
    rows = [(t, m.pose.position.x, m.pose.position.y, m.pose.position.z) for t, m in peer.poses if t > since]
    return np.array(rows, dtype=float).reshape(-1, 4)


def _top_speed(track: np.ndarray) -> float:
    """Largest speed [m/s] over windows of 40 ms, so that jitter of arrival does not count."""
    best, start = 0.0, 0
    for i in range(len(track)):
        while track[i, 0] - track[start, 0] > 0.04:
            start += 1
        if track[i, 0] - track[start, 0] > 0.02:
            best = max(best, float(np.linalg.norm(track[i, 1:] - track[start, 1:]) / (track[i, 0] - track[start, 0])))
    return best


def poses_come_often_and_fresh(peer: Peer, limits: Limits) -> Verdict:
    """current_pose at a rate, with stamps that increase and are not old."""
    peer.poses.clear()
    peer.spin(2.0)
    now = peer.node.get_clock().now().nanoseconds * 1e-9 - time.monotonic()
    stamps = _stamps(peer)
    ages = [t + now - s for (t, _), s in zip(peer.poses, stamps, strict=True)]
    ordered = all(b > a for a, b in pairwise(stamps))
    rate, age = len(stamps) / 2.0, float(np.median(ages)) if ages else math.inf
    good = rate >= limits.pose_rate and ordered and -0.005 <= age <= limits.pose_age
    text = f"{rate:.0f} Hz, stamps {'increase' if ordered else 'do not increase'}, median age {1e3 * age:.1f} ms"
    return _verdict(poses_come_often_and_fresh, good, text)


def poses_are_in_the_base_frame(peer: Peer, limits: Limits) -> Verdict:  # noqa: ARG001
    """frame_id and a unit quaternion."""
    frame = peer.poses[-1][1].header.frame_id
    length = math.hypot(*peer.pose()[1])
    good = frame == peer.base and abs(length - 1.0) < 1e-6
    return _verdict(poses_are_in_the_base_frame, good, f"frame '{frame}', quaternion of length {length:.6f}")


def targets_are_reached(peer: Peer, limits: Limits) -> Verdict:
    """A small motion in all six axes and back."""
    (x, y, z), q = peer.pose()
    there = (x + STEP, y - STEP, z + STEP), turned(q, (0.05, -0.05, 0.05))
    errors = []
    for goal in (there, ((x, y, z), q)):
        start = peer.pose()
        peer.stream(lambda t, a=start, b=goal: _between(a, b, min(1.0, t)), 1.0 + SETTLE)
        p, turn = peer.pose()
        errors.append((math.dist(p, goal[0]), math.hypot(*turn_between(turn, goal[1]))))
    far, lean = max(e[0] for e in errors), max(e[1] for e in errors)
    text = f"missed by {1e3 * far:.2f} mm and {math.degrees(lean):.3f} degrees at most"
    return _verdict(targets_are_reached, far <= limits.accuracy and lean <= 0.01, text)


def _between(a: tuple, b: tuple, share: float) -> tuple:
    p: Vector3 = tuple(u + share * (v - u) for u, v in zip(a[0], b[0], strict=True))  # type: ignore[assignment]
    turn = turn_between(b[1], a[1])
    return p, turned(a[1], (share * turn[0], share * turn[1], share * turn[2]))


def lag_is_small_and_known(peer: Peer, limits: Limits) -> Verdict:
    """Delay between a slow sine of targets and the poses, and the largest speed on the way."""
    (x, y, z), q = peer.pose()
    rate, start = 2.0, time.monotonic()
    peer.stream(lambda t: ((x, y + STEP * (1 - math.cos(rate * t)), z), q), 5.0)
    track = _track(peer, start + 1.0)
    phase = rate * (track[:, 0] - start)
    basis = np.column_stack((np.ones(len(track)), np.cos(phase), np.sin(phase)))
    _, c, s = np.linalg.lstsq(basis, track[:, 2] - y, rcond=None)[0]
    lag = math.atan2(-s, -c) / rate
    speed = _top_speed(track)
    good = -0.01 <= lag <= limits.lag and speed <= limits.speed * 1.1
    return _verdict(lag_is_small_and_known, good, f"lag {1e3 * lag:.0f} ms, amplitude {1e3 * math.hypot(c, s):.2f} mm")


def _move_then(peer: Peer, after: Callable[[], None]) -> tuple[np.ndarray, float]:
    """Start a sine, do something to it; track since then and the time."""
    (x, y, z), q = peer.pose()
    peer.stream(lambda t: ((x, y + STEP * (1 - math.cos(3 * t)), z), q), 0.6)
    start = time.monotonic()
    after()
    return _track(peer, start - LOOK_BACK), start


def _rests(track: np.ndarray, start: float, limits: Limits) -> tuple[bool, str]:
    late = track[track[:, 0] > start + limits.stop_within]
    moved = 1e3 * float(np.ptp(late[:, 1:], axis=0).max()) if len(late) else math.inf
    coast = 1e3 * float(np.linalg.norm(track[-1, 1:] - track[0, 1:])) if len(track) else math.inf
    speed = _top_speed(track)
    text = f"coasted {coast:.2f} mm, then moved {moved:.3f} mm, never above {speed:.3f} m/s"
    return moved < 0.3 and speed <= limits.speed * 1.1, text


def silence_stops_the_arm(peer: Peer, limits: Limits) -> Verdict:
    """No target any more."""
    track, start = _move_then(peer, lambda: peer.spin(1.5))
    return _verdict(silence_stops_the_arm, *_rests(track, start, limits))


def after_silence_nothing_moves_unasked(peer: Peer, limits: Limits) -> Verdict:  # noqa: ARG001
    """Targets that come back find a latched hold."""
    (x, y, z), q = peer.pose()
    _move_then(peer, lambda: peer.spin(1.0))
    start = time.monotonic()
    (x, y, z), q = peer.pose()
    peer.stream(lambda t: ((x, y + 0.5 * STEP * min(1.0, t), z), q), 1.5)
    moved = 1e3 * float(np.ptp(_track(peer, start)[:, 1:], axis=0).max())
    return _verdict(after_silence_nothing_moves_unasked, moved < 0.3, f"moved {moved:.3f} mm")


def _refused(peer: Peer, limits: Limits, clause: Callable[..., Verdict], send: Callable[[], None]) -> Verdict:
    track, start = _move_then(peer, lambda: (send(), peer.spin(1.5))[0])
    return _verdict(clause, *_rests(track, start, limits))


def jumps_are_refused(peer: Peer, limits: Limits) -> Verdict:
    """One target a metre away."""
    (x, y, z), q = peer.pose()
    return _refused(peer, limits, jumps_are_refused, lambda: peer.send((x, y + 1.0, z), q))


def not_a_number_is_refused(peer: Peer, limits: Limits) -> Verdict:
    """One target of NaN."""
    (x, y, _), q = peer.pose()
    return _refused(peer, limits, not_a_number_is_refused, lambda: peer.send((x, y, math.nan), q))


def _stays(peer: Peer, clause: Callable[..., Verdict], **how: object) -> Verdict:
    """Targets 10 mm away that must not be followed."""
    (x, y, z), q = peer.pose()
    start = time.monotonic()
    while time.monotonic() - start < 1.0:
        peer.send((x, y + STEP, z), q, **how)  # type: ignore[arg-type]
        peer.spin(0.01)
    moved = 1e3 * float(np.ptp(_track(peer, start - LOOK_BACK)[:, 1:], axis=0).max())
    return _verdict(clause, moved < 0.3, f"moved {moved:.3f} mm")


def old_targets_are_refused(peer: Peer, limits: Limits) -> Verdict:  # noqa: ARG001
    """Stamps of a second ago."""
    return _stays(peer, old_targets_are_refused, age=1.0)


def foreign_frames_are_refused(peer: Peer, limits: Limits) -> Verdict:  # noqa: ARG001
    """A frame that is not the base."""
    return _stays(peer, foreign_frames_are_refused, frame="some_other_frame")


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


def run(arm: str, limits: Limits, clauses: Sequence[Clause] = (), base: str = "base") -> list[Verdict]:
    """Join the graph and check the arm whose node is called `arm`, in all clauses when none is named."""
    with Peer(driver=arm, base=base) as peer:
        peer.wait(lambda: bool(peer.poses), 20.0, "a first current_pose")
        _wait_until_ready(peer, limits)
        return check(peer, limits, clauses)


def _wait_until_ready(peer: Peer, limits: Limits) -> None:
    """An arm that has just been started may not have found its inputs yet; whether it ever does, the clauses say."""
    deadline = time.monotonic() + STARTING
    while time.monotonic() < deadline:
        with suppress(SeedError):
            enable(peer, limits)
            return


@command("seed_testing.arm_contract")
def main(argv: list[str]) -> int:
    """Command line; 0 when every clause is kept."""
    default = Limits()
    parser = argparse.ArgumentParser(prog="seed_testing.arm_contract", description=__doc__.split("\n")[0])
    parser.add_argument("--arm", default="driver", help="name of the arm's node (default %(default)s)")
    parser.add_argument("--base", default="base", help="name of the base frame (default %(default)s)")
    parser.add_argument("--enable", default=default.enable, help="its service that resumes motion; '' when it has none")
    parser.add_argument("--pose-rate", type=float, default=default.pose_rate, help="[Hz] (default %(default)s)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    given = parser.parse_args(argv)
    verdicts = run(given.arm, default._replace(enable=given.enable, pose_rate=given.pose_rate), base=given.base)
    if given.json:
        print(json.dumps({"arm": given.arm, "clauses": [v._asdict() for v in verdicts]}))
    else:
        for v in verdicts:
            print(f"{'kept  ' if v.kept else 'BROKEN'}  {v.clause:45s} {v.found}")
    return 0 if all(v.kept for v in verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())

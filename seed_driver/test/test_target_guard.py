# SPDX-License-Identifier: Apache-2.0
"""The guard of an arm that obeys everything: it checks, limits, decelerates, and follows again only when asked."""

import math

import numpy as np
import pytest

from seed_core.arm.quaternion import from_rotation_vector, turned
from seed_core.arm.target_checks import Target
from seed_core.vector3 import plus
from seed_driver.target_guard import GuardConfig, TargetGuard

HERE = (-0.40610, -0.1333, 0.33155)
DOWN = from_rotation_vector((2.2210432, 2.2210432, 0.0008843))
DT = 0.004  # [s]


class Run:
    """A guard before an arm that is where it was sent, fed with targets by a steady clock."""

    def __init__(self, **limits: float) -> None:
        self.guard, self.now, self.sent = TargetGuard(GuardConfig(**limits)), 1.0, []
        self.arm = (HERE, DOWN)
        self.steps(60)
        assert self.guard.resume(self.now) == ""

    def steps(self, count: int, y: float | None = None) -> str:
        """Steps with a target at HERE but for y [m], or none; the last refusal."""
        why = ""
        for _ in range(count):
            self.now += DT
            if y is not None:
                why = self.guard.target(Target("base", 0.0, (HERE[0], y, HERE[2]), DOWN), self.now)
            pose = self.guard.step(self.now)
            if pose is not None:
                self.arm = pose
                self.sent.append(pose[0])
            self.guard.measured(self.arm, self.now)
        return why

    @property
    def speed(self) -> float:
        return math.dist(self.sent[-1], self.sent[-2]) / DT


def test_targets_are_followed_within_the_limits() -> None:
    run = Run(max_speed=0.25, max_acceleration=1.0, max_jerk=250.0)
    for i in range(1, 200):
        run.steps(1, HERE[1] + 0.04 * min(1.0, i * DT / 0.1))
    assert run.sent[-1][1] == pytest.approx(HERE[1] + 0.04, abs=1e-5)
    v = np.diff(np.array(run.sent), axis=0) / DT
    assert np.linalg.norm(v, axis=1).max() <= 0.25 * (1 + 1e-6)
    assert np.linalg.norm(np.diff(v, axis=0) / DT, axis=1).max() <= 1.0 * (1 + 1e-6)


@pytest.mark.parametrize("way", [0.002, 0.01, 0.02, 0.04])
def test_a_constant_target_is_never_passed(way: float) -> None:
    run = Run()
    run.steps(250, HERE[1] + way)
    assert max(p[1] for p in run.sent) == pytest.approx(HERE[1] + way, abs=1e-6)


@pytest.mark.parametrize("end", ["silence", "a jump", "a stop"])
def test_whatever_ends_the_motion_holds_until_it_is_resumed(end: str) -> None:
    run = Run()
    run.steps(25, HERE[1] + 0.04)
    assert run.speed > 0.05
    match end:
        case "silence":
            run.steps(30)
            assert run.guard.reason == "no target_frame for 0.1 s"
        case "a jump":
            assert "jumps" in run.steps(1, HERE[1] + 1.0)
        case "a stop":
            run.guard.hold("stopped on request")
    reason = run.guard.reason
    assert run.steps(75, HERE[1] + 0.04) == reason  # targets that come later do not move it
    count, rest = len(run.sent), run.sent[-1]
    assert run.speed < 1.0 * DT
    run.steps(50, HERE[1] + 0.04)
    assert len(run.sent) == count  # nor is it sent anything once it stands
    assert run.guard.resume(run.now) == ""
    run.steps(100, rest[1] + 0.02)
    assert run.sent[-1][1] == pytest.approx(rest[1] + 0.02, abs=1e-5)


def test_a_clock_that_is_set_back_is_a_hold() -> None:
    """Of a simulation: what was heard then is of no known age."""
    run = Run()
    run.steps(25, HERE[1] + 0.04)
    run.guard.step(run.now - 10.0)
    assert run.guard.reason == "no current_pose from the arm"


def test_an_arm_that_is_not_heard_is_not_moved() -> None:
    run = Run()
    run.steps(10, HERE[1] + 0.01)
    late = run.now + 0.2
    run.guard.target(Target("base", 0.0, HERE, DOWN), late)
    run.guard.step(late)
    assert run.guard.reason == "no current_pose from the arm"
    assert run.guard.resume(late) == "no current_pose from the arm: is it running?"


@pytest.mark.parametrize("how", ["silence", "a stop"])
def test_an_arm_that_returns_elsewhere_is_sent_nothing_unasked(how: str) -> None:
    """It was switched off while the guard held, and is 0.2 m away when it is heard again."""
    run = Run()
    run.steps(25, HERE[1] + 0.04)
    if how == "a stop":
        run.guard.hold("stopped on request")
    run.steps(100)
    run.sent.clear()
    away = (HERE[0], HERE[1] + 0.2, HERE[2])
    run.now, run.arm = run.now + 3.0, (away, DOWN)
    run.steps(60, away[1])
    assert run.sent == []
    assert run.guard.resume(run.now) == ""
    run.steps(50)
    assert run.sent == []  # asked for, but nobody wants it anywhere yet
    run.steps(1, away[1] + 0.01)
    assert math.dist(run.sent[0], away) < 1e-4
    run.steps(100, away[1] + 0.01)
    assert run.sent[-1][1] == pytest.approx(away[1] + 0.01, abs=1e-5)


def test_an_arm_that_was_moved_after_the_request_is_taken_from_where_it_stands() -> None:
    run = Run()
    by_hand = (HERE[0] + 0.3, HERE[1], HERE[2])
    run.arm = (by_hand, DOWN)
    run.steps(60)
    assert "jumps 0.3 m" in run.steps(1, HERE[1])
    assert run.sent == []


@pytest.mark.parametrize(
    ("move", "turn", "away", "still"),
    [
        (0.0, 0.0, 0.0, True),
        (0.0009, 0.0, 0.0, True),
        (0.0011, 0.0, 0.0, False),
        (0.0, 0.009, 0.0, True),
        (0.0, 0.011, 0.0, False),
        (0.0, 0.0, 0.3, False),  # [s] not heard: what it did meanwhile is not known
    ],
)
def test_an_arm_stands_that_is_seen_at_one_place_for_long_enough(move, turn, away, still: bool) -> None:
    """Within 1 mm and 0.01 rad."""
    run = Run()
    run.guard.hold("stopped on request")
    run.now += away
    run.arm = plus(HERE, (0.0, move, 0.0)), turned(DOWN, (turn, 0.0, 0.0))
    run.steps(20)
    assert (run.guard.resume(run.now) == "") is still


def test_it_follows_again_before_it_has_come_to_rest() -> None:
    run = Run()
    for i in range(1, 50):
        run.steps(1, HERE[1] + 0.3 * i * DT)
    run.guard.hold("stopped on request")
    run.steps(3)
    speed = run.speed
    assert run.guard.resume(run.now) == ""
    run.steps(1, HERE[1] + 0.06)
    assert run.speed > 0.8 * speed


@pytest.mark.parametrize("then", ["asked while it moves", "asked before"])
def test_an_arm_that_moves_is_not_sent_to_where_it_was(then: str) -> None:
    """Something else moves it at 0.25 m/s: where its newest pose is, 90 ms old, it is not any more."""
    run = Run()
    if then == "asked while it moves":
        run.guard.hold("stopped on request")
    for _ in range(100):
        run.arm = (plus(run.arm[0], (0.0, 0.25 * DT, 0.0)), DOWN)
        run.steps(1)
    run.now += 0.09
    if then == "asked while it moves":
        assert "the arm has not been seen to stand still for 0.2 s" in run.guard.resume(run.now)
        run.steps(60)
        assert run.guard.resume(run.now) == ""
    else:
        assert "not been seen to stand still" in run.steps(1, run.arm[0][1])
        assert run.sent == []
        run.steps(60, run.arm[0][1])
    run.steps(100, run.arm[0][1] + 0.01)
    assert run.guard.reason == ""
    assert run.sent[-1][1] == pytest.approx(run.arm[0][1], abs=1e-9)


def test_an_arm_that_is_not_heard_while_it_comes_to_rest_is_taken_from_where_it_came_to_rest() -> None:
    """Its poses fail as it brakes: by the last of them it is 3 mm behind."""
    run = Run()
    for i in range(1, 50):
        run.steps(1, HERE[1] + 0.3 * i * DT)
    run.guard.hold("stopped on request")
    run.steps(8)
    heard = run.arm
    while (pose := run.guard.step(run.now)) is not None:
        run.now, run.arm = run.now + DT, pose
    assert math.dist(heard[0], run.arm[0]) > 0.003
    assert "not been seen to stand still" in run.guard.resume(run.now)
    run.steps(60)
    assert run.guard.resume(run.now) == ""


@pytest.mark.parametrize(
    ("there", "turn", "words"), [((0.0, 0.0, 0.15), 0.0, "the arm is 0.15"), ((0.0, 0.0, 0.0), 0.35, " m and 0.35 rad")]
)
def test_an_arm_that_something_else_moves_is_not_pulled_back(there, turn: float, words: str) -> None:
    """Nor is it when it comes near the command of that time again."""
    run = Run()
    run.steps(25, HERE[1] + 0.04)
    sent, way = len(run.sent), run.arm
    run.arm = plus(way[0], there), turned(way[1], (turn, 0.0, 0.0))
    run.guard.measured(run.arm, run.now)
    run.steps(50, HERE[1] + 0.04)
    assert words in run.guard.reason
    run.arm = way
    run.steps(50)
    assert len(run.sent) == sent


def test_an_arm_that_lags_as_the_contract_allows_is_no_stranger() -> None:
    run = Run()
    delay = [(HERE, DOWN)] * 50  # 0.2 s
    for i in range(400):
        run.now += DT
        p, q = plus(HERE, (0.0, 0.25 * i * DT, 0.0)), turned(DOWN, (0.0, 0.0, 0.5 * i * DT))
        assert run.guard.target(Target("base", 0.0, p, q), run.now) == ""
        pose = run.guard.step(run.now)
        assert pose is not None
        delay.append(pose)
        run.guard.measured(delay.pop(0), run.now)


@pytest.mark.parametrize(
    "pose", [((math.nan, 0.0, 0.0), DOWN), (HERE, (0.0, 0.0, 0.0, 0.0)), (HERE, (math.nan, 0.0, 0.0, 1.0))]
)
def test_the_guard_does_not_start_from_what_is_no_pose(pose) -> None:
    guard = TargetGuard(GuardConfig())
    for now in (1.0, 1.1, 1.2):
        guard.measured(pose, now)
    assert "no current_pose" in guard.resume(1.2)
    for i in range(7):
        guard.measured((HERE, DOWN), 1.3 + 0.05 * i)
    assert guard.resume(1.6) == ""

# SPDX-License-Identifier: Apache-2.0
"""Whatever the targets do, the command keeps its bounds, arrives, and stops within the braking distance."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from seed_core.arm.limits import MotionLimits
from seed_core.arm.quaternion import from_rotation_vector, turn_between
from seed_driver.motion.limiter import CommandLimiter

DT = 0.002
HERE = (0.4, -0.1, 0.3)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
LIMITS = MotionLimits(workspace_low=(-1.0, -1.0, 0.0), workspace_high=(1.0, 1.0, 1.0))


class Run:
    """A limiter fed with targets at their own times, and what it commanded."""

    def __init__(self, limits: MotionLimits = LIMITS, dt: float = DT) -> None:
        self.limits, self.dt, self.time = limits, dt, 0.0
        self.limiter = CommandLimiter(HERE, UPRIGHT, dt, limits)
        self.p, self.q = [HERE], [UPRIGHT]

    def target(self, p, q=UPRIGHT) -> None:
        self.limiter.follow(tuple(p), q, self.time, 0.1)

    def steps(self, count: int, hold: bool = False) -> None:
        if hold:
            self.limiter.hold()
        for _ in range(count):
            self.time += self.dt
            self.limiter.propose()
            self.limiter.advance()
            self.p.append(self.limiter.p)
            self.q.append(self.limiter.q)

    def check(self) -> None:
        """Speed, acceleration and jerk of the command, by finite differences."""
        p, limits, dt = np.array(self.p), self.limits, self.dt
        w = np.array([turn_between(after, before) for before, after in zip(self.q, self.q[1:], strict=False)]) / dt
        v = np.diff(p, axis=0) / dt
        a, alpha = np.diff(v, axis=0) / dt, np.diff(w, axis=0) / dt
        margin = 1.0 + 1e-6
        assert np.linalg.norm(v, axis=1).max() <= limits.max_speed * margin
        assert np.linalg.norm(a, axis=1).max() <= limits.max_acceleration * margin
        assert np.linalg.norm(np.diff(a, axis=0) / dt, axis=1).max() <= limits.max_jerk * margin
        assert np.linalg.norm(w, axis=1).max() <= limits.max_angular_speed * 1.001  # second order of a few mrad
        assert np.linalg.norm(alpha, axis=1).max() <= limits.max_angular_acceleration * 1.01


def test_a_step_of_the_target_is_reached_within_bounds_without_overshoot() -> None:
    run = Run()
    run.target((0.44, -0.1, 0.3), from_rotation_vector((0.0, 0.0, 0.15)))
    run.steps(1500)
    run.check()
    assert_allclose(run.p[-1], (0.44, -0.1, 0.3), atol=1e-6)
    assert_allclose(turn_between(run.q[-1], UPRIGHT), (0, 0, 0.15), atol=1e-6)
    assert np.array(run.p)[:, 0].max() < 0.44 + 1e-5


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    st.lists(
        st.tuples(st.integers(1, 60), st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6)), min_size=1, max_size=12
    )
)
def test_bounds_hold_for_any_targets_at_any_rate(targets) -> None:
    run = Run()
    for wait, numbers in targets:
        p = np.array(HERE) + 0.3 * np.array(numbers[:3])
        run.target(p.tolist(), from_rotation_vector(tuple(numbers[3:])))
        run.steps(wait)
    run.steps(150, hold=True)
    run.check()


@pytest.mark.parametrize("before", [0, 60])
@pytest.mark.parametrize("every", [1, 4, 8, 12, 20])
@pytest.mark.parametrize("way", [0.002, 0.01, 0.02, 0.04])
def test_a_target_that_stands_is_never_passed(way: float, every: int, before: int) -> None:
    """From the first one on, and where targets have stood elsewhere before; 500 to 25 Hz."""
    run = Run()
    for i in range(before + 700 // every):
        share = 1.0 if i >= before else 0.0
        run.target((HERE[0] + share * way, *HERE[1:]), from_rotation_vector((0.0, 0.0, 4.0 * share * way)))
        run.steps(every)
    run.check()
    turned = max(turn_between(q, UPRIGHT)[2] for q in run.q)
    assert max(p[0] for p in run.p) == pytest.approx(HERE[0] + way, abs=1e-6)
    assert turned == pytest.approx(4.0 * way, abs=1e-6)


@pytest.mark.parametrize("rate", [20, 30, 50, 125, 250])
@pytest.mark.parametrize("acceleration", [1.0, 4.0])
@pytest.mark.parametrize("way", [0.002, 0.04])
def test_a_slow_servo_passes_no_target_and_comes_to_rest(rate: int, acceleration: float, way: float) -> None:
    """At 20 Hz the command went to and fro over 6 mm for ever, at the acceleration limit."""
    run = Run(replace(LIMITS, max_acceleration=acceleration, max_jerk=2000.0, max_angular_acceleration=8.0), 1.0 / rate)
    for _ in range(3 * rate):
        run.target((HERE[0] + way, *HERE[1:]), from_rotation_vector((0.0, 0.0, 4.0 * way)))
        run.steps(1)
    run.check()
    turned = max(turn_between(q, UPRIGHT)[2] for q in run.q)
    assert max(p[0] for p in run.p) == pytest.approx(HERE[0] + way, abs=1e-6)
    assert turned == pytest.approx(4.0 * way, abs=1e-6)
    assert run.p[-1] == pytest.approx(run.p[-rate // 2], abs=1e-6)


@pytest.mark.parametrize("every", [1, 2, 5, 25])
def test_a_stream_at_constant_speed_is_followed_closely_at_any_rate(every: int) -> None:
    """20, 100, 250 and 500 Hz; the lag is about one interval and the smoothing, not the braking distance."""
    run, speed = Run(), 0.05
    for i in range(1000 // every):
        target = HERE[0] + speed * DT * every * i
        run.target((target, HERE[1], HERE[2]))
        run.steps(every)
    run.check()
    lag = (target - run.p[-1][0]) / speed
    assert -0.01 < lag < 0.01 + 1.5 * every * DT
    v = np.diff(np.array(run.p)[-400:, 0]) / DT
    assert_allclose(v, speed, rtol=0.1)


def test_holding_stops_within_the_braking_distance_and_stays() -> None:
    run = Run()
    for i in range(500):
        run.target((HERE[0] + 0.2 * DT * i, HERE[1], HERE[2]))
        run.steps(1)
    start = np.array(run.p[-1])
    run.steps(500, hold=True)
    run.check()
    assert run.limiter.still
    distance = np.linalg.norm(np.array(run.p[-1]) - start)
    assert distance < 0.2**2 / 2 + 0.2 * 0.01  # v^2 / 2a, and the smoothing
    assert run.p[-1] == run.p[-2]


def test_the_command_never_leaves_the_workspace() -> None:
    run = Run()
    run.target((HERE[0], HERE[1], -0.5))
    run.steps(2500)
    assert min(p[2] for p in run.p) >= LIMITS.workspace_low[2]


@pytest.mark.parametrize("stop", [0.95, 0.98, 0.995, 1.0, 1.2])
@pytest.mark.parametrize("speed", [0.1, 0.25])
def test_at_the_workspaces_side_it_brakes_within_its_bounds(stop: float, speed: float) -> None:
    """A stream that goes on to the side, ends near it, or holds there; it was stopped by the side at 27 m/s^2."""
    run, x = Run(), HERE[0]
    while x < stop:
        x += speed * DT
        run.target((x, *HERE[1:]))
        run.steps(1)
    run.steps(1000, hold=True)
    run.check()
    assert np.array(run.p)[:, 0].max() <= 1.0 + 1e-9


@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize("jerk", [20.0, 2000.0])
def test_into_an_edge_or_a_corner_of_the_workspace_it_brakes_within_its_bounds(axes, jerk) -> None:
    """Also while the target goes elsewhere; each side braked on its own, which was 1.4 to 1.8 times the limit."""
    rng = np.random.default_rng(7)
    for _ in range(8):
        run = Run(replace(LIMITS, max_jerk=jerk))
        ways = rng.choice([-1.0, 1.0], (2, 3)) * rng.uniform(0.3, 1.5, (2, 3)) * (np.arange(3) < axes)
        turn = int(rng.uniform(300, 1200))
        for i in range(150):
            run.target(HERE + ways[int(10 * i > turn)])
            run.steps(10)
        run.check()
        assert (np.abs(np.array(run.p)[:, :2]) <= 1.0 + 1e-9).all()


def test_starting_outside_the_workspace_only_leads_inwards() -> None:
    run = Run(replace(LIMITS, workspace_low=(-1.0, -1.0, 0.35)))
    run.target((HERE[0], HERE[1], 0.2))
    run.steps(200)
    assert min(p[2] for p in run.p) == HERE[2]
    run.target((HERE[0], HERE[1], 0.4))
    run.steps(1500)
    assert run.p[-1][2] == pytest.approx(0.4, abs=1e-6)


def test_slower_limits_take_proportionally_longer() -> None:
    times = []
    for speed in (0.02, 0.04):
        run = Run(replace(LIMITS, max_speed=speed))
        run.target((HERE[0] + 0.04, HERE[1], HERE[2]))
        run.steps(2000)
        times.append(DT * next(i for i, p in enumerate(run.p) if p[0] > HERE[0] + 0.039))
    assert times[0] / times[1] == pytest.approx(2.0, rel=0.1)
    assert math.isfinite(times[0])


@pytest.mark.parametrize(
    "change", [{"max_jerk": 20.0}, {"max_jerk": 1e4}, {"max_acceleration": 10.0}, {"max_acceleration": 0.1}]
)
def test_limits_that_change_in_motion_let_the_command_neither_jump_nor_stop_elsewhere(change) -> None:
    """They count from the next rest on: until then the bounds, and the way in which it stops, are the old ones."""
    ways = []
    for limits in (LIMITS, replace(LIMITS, **change)):
        run = Run()
        for i in range(250):
            run.target((HERE[0] + 0.2 * DT * i, HERE[1], HERE[2]))
            run.steps(1)
        run.limiter.set_limits(limits)
        run.steps(400, hold=True)
        run.check()
        ways.append(run.p[-1])
    assert ways[0] == ways[1]
    assert run.limiter.limits == replace(LIMITS, **change)


def test_a_lower_speed_counts_in_motion() -> None:
    run = Run()
    run.target((HERE[0] + 0.5, HERE[1], HERE[2]))
    run.steps(500)
    run.limiter.set_limits(replace(LIMITS, max_speed=0.05, max_jerk=500.0))
    run.steps(500)
    run.check()
    assert np.linalg.norm(np.subtract(run.p[-1], run.p[-2])) / DT == pytest.approx(0.05)


@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize("ahead", [0.001, -0.05])
def test_a_workspace_that_is_narrowed_in_motion_lets_the_command_brake_within_its_bounds(axes, ahead) -> None:
    """Its sides are met along one axis, or along several at once; then it goes no further out, and comes back in."""
    run, way = Run(), np.array([1.0] * axes + [0.0] * (3 - axes)) / math.sqrt(axes)
    for i in range(500):
        run.target(HERE + 0.2 * DT * i * way)
        run.steps(1)
    high = np.where(way > 0.0, np.array(run.p[-1]) + ahead, 1.0)
    run.limiter.set_limits(replace(LIMITS, workspace_high=tuple(high)))
    for i in range(500, 1000):
        run.target(HERE + 0.2 * DT * i * way)
        run.steps(1)
    run.check()
    assert run.p[-1] == pytest.approx(run.p[-100], abs=1e-6)
    run.target(np.where(way > 0.0, high - 0.02, HERE))
    run.steps(1500)
    run.target(HERE + 0.2 * way)
    run.steps(1500)
    assert (np.array(run.p[-1]) <= high + 1e-9).all()


def test_changed_limits_count_once_a_target_is_reached() -> None:
    run = Run()
    run.target((HERE[0] + 0.02, HERE[1], HERE[2]))
    run.steps(100)
    run.limiter.set_limits(replace(LIMITS, max_acceleration=0.5))
    assert run.limiter.limits.max_acceleration == LIMITS.max_acceleration
    run.steps(600)
    assert run.limiter.limits.max_acceleration == 0.5


def test_limits_that_are_changed_in_motion_make_no_jump_of_a_command_that_is_not_smoothed() -> None:
    """2 a / dt is 1000 m/s^3: with 2000 the smoothing is one pose long, and has no past."""
    run = Run(replace(LIMITS, max_acceleration=1.0, max_jerk=2000.0))
    run.target((0.6, -0.1, 0.3))
    run.steps(100)
    assert run.limiter.moving
    run.limiter.set_limits(replace(LIMITS, max_acceleration=1.0, max_jerk=100.0))
    run.steps(300, hold=True)
    run.check()
    assert run.limiter.limits.max_jerk == 100.0

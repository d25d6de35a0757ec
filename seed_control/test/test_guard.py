# SPDX-License-Identifier: Apache-2.0
"""What stops the motion: too long a way without the wanted force, and an arm that does not follow."""

import itertools
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from quasi_static import DOWN, DT, PRESS_Z, Bench

from seed_control.command.arm_follows import ArmFollows, Behind, RecentSpeed
from seed_control.command.free_travel import FreeTravel
from seed_control.command.guard import Guard
from seed_control.command.limiter import VectorLimiter
from seed_control.law.contact import ForceShare
from seed_control.monitor.pose_checks import FrozenPoseCheck, PoseJumpCheck
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint, RelativePoseSetpoint
from seed_control.state import EventLog
from seed_control.wrench.estimate import WrenchEstimator
from seed_control.wrench.history import PoseHistory
from seed_core.bushing import Bushing
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Tool
from seed_core.spatial import Wrench, make_pose, rotation_from_rpy, so3_exp
from seed_core.vector3 import ZERO

UP = np.array(((0.0, 0.0, 1.0),))
BOUND = 0.06


def still(bound: float) -> FreeTravel:
    """Of a command that is at rest whenever it is asked."""
    return FreeTravel(bound, lambda _: 0.0)


def went(travel: FreeTravel, *places: tuple[float, float, float]) -> str:
    """Slowly, each a second after the other."""
    return next(filter(None, (travel.step(p, UP, 1.0) for p in places)), "")


@pytest.mark.parametrize("z", [0.061, -0.061, np.nan, np.inf])
def test_an_approach_that_goes_too_far_or_nowhere_known_is_held(z: float) -> None:
    travel = still(BOUND)
    assert went(travel, (0.0, 0.0, 0.0), (9.0, 9.0, 0.059)) == ""
    assert "no contact within max_free_travel = 60 mm along (0.00, 0.00, 1.00)" in went(travel, (0.0, 0.0, z))


def test_another_direction_is_counted_from_where_it_begins() -> None:
    travel, across = still(BOUND), np.array(((1.0, 0.0, 0.0),))
    assert went(travel, (0.0, 0.0, 0.0), (0.1, 0.0, 0.03)) == ""
    assert travel.step((0.1, 0.0, 0.03), across, 1.0) == ""
    assert travel.step((0.159, 0.0, 0.03), across, 1.0) == ""
    assert "along (1.00, 0.00, 0.00)" in travel.step((0.161, 0.0, 0.03), across, 1.0)
    turning, n = still(BOUND), np.zeros((1, 3))
    for angle in np.linspace(0.0, 0.5 * np.pi, 100):  # one that turns with a surface is the same
        n[0] = np.sin(angle), 0.0, np.cos(angle)
        assert turning.step((0.0, 0.0, 0.0), n, 0.004) == ""
    assert "along (1.00, 0.00, 0.00)" in turning.step((0.061, 0.0, 0.0), n, 1.0)


def test_a_tool_that_slides_in_the_grasp_is_no_way_without_contact() -> None:
    travel = still(BOUND)
    reason = went(travel, (0.0, 0.0, 0.01))
    for k in range(1, 90):
        travel.image([ForceShare(0.85, False, 0.01, 0.0)], ZERO, ZERO)
        reason = reason or went(travel, (0.0, 0.0, 0.01 + 9e-4 * k))
    assert "the force stays at 85% of the wanted one over max_free_travel = 60 mm" in reason
    assert "the tool slides in the grasp" in reason


def test_a_gripper_that_gives_way_to_a_force_that_does_not_fall_is_told_of_wrong_poses() -> None:
    travel = still(BOUND)
    reason = went(travel, (0.0, 0.0, 0.08))
    for k in range(1, 90):
        travel.image([ForceShare(1.44, False, 0.01, 0.0)], ZERO, ZERO)
        reason = reason or went(travel, (0.0, 0.0, 0.08 - 9e-4 * k))
    assert "the force stays at 144% of the wanted one though the gripper gave way over max_free_travel" in reason


def test_friction_that_reaches_the_force_for_a_moment_is_not_the_force() -> None:
    """A tip that rubs and slips: 0.2 s of each second with nine tenths of the wanted force. It is told all along."""
    travel, told = still(BOUND), []
    for k in range(2000):
        if k % 5 == 0:
            rubs = k % 250 < 50
            travel.image([ForceShare(0.9 if rubs else 0.2, rubs, 0.01, 0.9)], ZERO, ZERO)
        assert travel.step(ZERO, UP, 0.004) == ""
        told.append("has not been reached" in travel.warning)
    assert told == sorted(told)
    assert told[-1]
    for _ in range(200):
        travel.image([ForceShare(0.95, True, 0.01, 0.9)], ZERO, ZERO)
        travel.step(ZERO, UP, 0.004)
    assert travel.warning == ""


def test_a_tool_that_lags_as_it_is_enabled_may_come_after() -> None:
    """It rubs on something, and hangs 4 mm behind; what is left to go is less by that much, let go or not."""
    free, lagging = (0.0, 0.0, 0.12), (0.0, 0.0, 0.116)
    for now in (lagging, free):
        travel = still(BOUND)
        went(travel, (0.0, 0.0, 0.0))
        for _ in range(20):
            travel.image([ForceShare(0.4, False, 0.01, 0.4)], lagging, free)
        for _ in range(20):
            travel.image([ForceShare(0.0, False, 0.01, 0.0)], now, free)
        assert went(travel, (0.0, 0.0, 0.0555)) == ""
        assert went(travel, (0.0, 0.0, 0.0565)) != ""


def test_a_tip_that_goes_further_than_it_would_by_itself_is_kept_within_the_bound() -> None:
    free = (0.0, 0.0, 0.12)
    for further, held in ((0.0, False), (0.004, True)):
        travel = still(BOUND)
        went(travel, (0.0, 0.0, 0.0))
        for k in range(20):
            travel.image([ForceShare(0.0, False, 0.01, 0.0)], (0.0, 0.0, 0.12 + further * (k > 0)), free)
        assert (went(travel, (0.0, 0.0, 0.0575)) != "") == held


@pytest.mark.parametrize(("sign", "reaches"), [(1.0, 0.060), (-1.0, -0.056)])
def test_the_way_is_counted_from_wherever_the_command_was_as_the_image_was_taken(sign: float, reaches: float) -> None:
    """The force was last there somewhere on 4 mm of way; whichever end is further off counts."""
    travel = still(BOUND)
    for k in range(5):
        travel.step((0.0, 0.0, 1e-3 * k), UP, 0.05)
    travel.image([ForceShare(1.0, True, 0.0, 0.0)], ZERO, ZERO)
    assert went(travel, (0.0, 0.0, 0.5 * reaches), (0.0, 0.0, reaches - sign * 5e-4)) == ""
    assert went(travel, (0.0, 0.0, reaches + sign * 5e-4)) != ""


def test_the_way_is_counted_anew_where_the_force_is_reached_or_rises() -> None:
    for share, settled, anew in ((1.0, True, True), (0.8, False, True), (0.6, False, False)):
        travel = still(BOUND)
        went(travel, (0.0, 0.0, 0.0), (0.0, 0.0, 0.05))
        travel.image([ForceShare(share, settled, 0.0, 0.0)], ZERO, ZERO)
        assert (went(travel, (0.0, 0.0, 0.1)) == "") == anew
        travel.image([ForceShare(share, False, 0.0, 0.0)], ZERO, ZERO)  # it does not rise any more: friction, say
        assert went(travel, (0.0, 0.0, 0.12)) != ""


@pytest.mark.parametrize("speed", [0.01, 0.045, 0.1, 0.25])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("from_rest_at", [0.0, 0.04, 0.057])
def test_it_stops_within_the_bound_at_every_speed(speed: float, sign: float, from_rest_at: float) -> None:
    """Also where the way is over while the command is gaining speed."""
    limiter = VectorLimiter(0.25, 2.0, 200.0, 80.0)
    travel, z = FreeTravel(BOUND, limiter.stopping), 0.0
    assert travel.step((0.0, 0.0, z), UP, DT) == ""
    z = sign * from_rest_at
    while not travel.step((0.0, 0.0, z), UP, DT):
        z += limiter.advance((0.0, 0.0, sign), DT, speed)[2]
    for _ in range(100):
        z += limiter.stop(DT)[2]
    assert 0.95 * BOUND - 0.05 * speed < sign * z <= BOUND


def test_the_gripper_goes_further_than_a_tool_that_something_stops() -> None:
    """Half of the wanted force needs 8 mm, and friction by a force across could be no more than a tenth of it."""
    for across, share, further in ((0.0, 0.4, True), (0.1, 0.4, True), (1.2, 0.4, False), (0.0, 0.0, False)):
        travel = still(BOUND)
        went(travel, (0.0, 0.0, 0.0))
        travel.image([ForceShare(0.0, False, 0.016, 0.0)], (0.0, 0.0, 0.12), (0.0, 0.0, 0.12))
        for _ in range(20):
            travel.image([ForceShare(share, False, 0.016, across)], (0.0, 0.0, 0.12 - 0.016 * share), (0.0, 0.0, 0.12))
        assert (went(travel, (0.0, 0.0, 0.064)) == "") == further


def test_no_force_is_not_near_a_small_one() -> None:
    """Within 0.3 N counts as settled, which no force at all is where less than that is wanted."""
    travel = still(BOUND)
    for i in range(5):
        if why := travel.step((0.0, 0.0, 0.03 * i), UP, 1.0):
            break
        travel.image([ForceShare(0.0, True, 0.0, 0.0)], ZERO, ZERO)
    assert "no contact within" in why


def test_contact_in_one_direction_does_not_count_for_another() -> None:
    """Force along y and z, and nothing to press against along y."""
    bench = Bench().enabled()
    force = Wrench(np.zeros(3), np.array((0.0, -5.0, -5.0)))
    bench.controller.set_setpoint(HybridSetpoint(DOWN, force, np.diag([0.0, 1.0, 1.0])), bench.t)
    state = bench.run(10.0)
    assert state.mode == "holding"
    assert "no contact within max_free_travel = 60 mm along (0.00, 1.00, 0.00)" in state.reason
    assert_allclose(bench.force, 5.0, atol=0.5)
    C = np.array([X[:3, 3] for X in bench.commands])
    assert np.abs(C[:, 1] - C[0, 1]).max() <= BOUND


def test_contact_is_lost_at_small_forces_under_noise() -> None:
    """At 1 N a twentieth of the force lies far below the noise of 0.24 N."""
    bench = Bench(noise=3e-4).enabled()
    bench.press(1.0)
    bench.run(4.0)
    assert bench.state.in_contact
    before = bench.state.counters.contacts_lost
    height, bench.table = bench.commands[-1][2, 3], -1.0
    state = bench.run(14.0)
    assert state.counters.contacts_lost > before
    assert state.mode == "holding"
    assert "the surface has ended or fallen away" in state.reason
    assert height - bench.commands[-1][2, 3] < BOUND


def test_contact_at_small_forces_outlasts_the_noise() -> None:
    bench = Bench(noise=3e-4).enabled()
    bench.press(1.0)
    bench.run(20.0)
    assert bench.state.in_contact
    assert bench.state.counters.contacts_lost == 0


@pytest.mark.parametrize("kind", ["approach", "position"])
def test_an_arm_that_holds_is_noticed_before_its_command_is_far_away(kind: str) -> None:
    bench = Bench(table=-1.0).enabled()
    if kind == "approach":
        bench.press(5.0)
    else:
        bench.controller.set_setpoint(HybridSetpoint(DOWN @ make_pose(None, (0.3, 0.0, 0.0))), bench.t)
    bench.run(0.2)
    held = bench.X_WE.copy()
    for _ in range(750):
        bench.X_WE = held
        bench.step()
    bench.X_WE = held
    assert bench.state.mode == "holding"
    assert "the arm does not follow" in bench.state.reason
    bench.controller.enable(bench.t)  # from where the arm is
    bench.step()
    assert_allclose(bench.commands[-1][:3, 3], held[:3, 3], atol=1e-6)


@pytest.mark.parametrize("lag", [0.0, 0.06, 0.15])
def test_an_arm_that_trails_at_full_speed_is_not_held(lag: float) -> None:
    follows, recent, x, at = ArmFollows(0.01, 0.05), RecentSpeed(), 0.0, 0.0
    for i in range(500):
        v = 0.25 if i < 250 else 0.0
        recent.update((v, 0.0, 0.0), (0.0, 0.0, 2.0 * v), 0.04, DT)
        x += v * DT
        at += (1.0 - np.exp(-DT / lag) if lag else 1.0) * (x - at)
        assert follows.update(Behind((at, 0.0, 0.0), x - at, 2.0 * (x - at), *recent.way(0.04)), DT) == ""


@pytest.mark.parametrize("lag", [0.015, 0.1, 0.19])
def test_a_move_of_an_arm_with_any_lag_of_the_contract_is_not_held(lag: float) -> None:
    bench = Bench(start=make_pose(p=(0.0, 0.0, 0.4)) @ DOWN, lag=lag).enabled()
    bench.controller.set_setpoint(HybridSetpoint(DOWN), bench.t)
    assert bench.run(3.0).mode == "position"


def test_an_arm_that_does_not_turn_is_held_and_named() -> None:
    bench = Bench(start=make_pose(p=(0.0, 0.0, 0.1)) @ DOWN).enabled()
    bench.turns = False
    bench.controller.set_setpoint(HybridSetpoint(bench.start @ make_pose(rotation_from_rpy((0.0, 0.0, 0.5)))), bench.t)
    bench.run(1.5)
    assert bench.state.mode == "holding"
    assert "max_angular_tracking_error" in bench.state.reason


@pytest.mark.parametrize("lag", [0.015, 0.08, 0.15])
@pytest.mark.parametrize("wait", [0.0, 0.02, 0.1, 0.4])
@pytest.mark.parametrize("off", [True, False])
def test_to_enable_a_moving_arm_makes_no_jump(lag: float, wait: float, off: bool) -> None:
    """Neither of one that is enabled, nor of one that still comes to rest."""
    bench = Bench(start=make_pose(p=(0.0, 0.0, 0.4)) @ DOWN, lag=lag).enabled()
    bench.controller.set_setpoint(HybridSetpoint(DOWN), bench.t)
    bench.run(0.6)
    if off:
        bench.controller.disable(bench.t, "off")
    bench.run(wait)
    bench.controller.enable(bench.t)
    bench.run(0.4)
    heights = np.array([X[2, 3] for X in bench.commands])
    jerks = np.abs(np.diff(heights, 3)) / DT**3
    assert jerks.max() <= 1.01 * bench.controller.parameters.max_jerk
    assert bench.state.mode == ("idle" if off else "position")


def test_a_move_into_something_is_held_and_named() -> None:
    bench = Bench(table=0.03, start=DOWN @ make_pose(None, (0.0, 0.0, -0.08))).enabled()
    x, y, z = bench.start[:3, 3]
    for i in range(round(3.0 / DT)):
        height = max(z - 0.05 * i * DT, 0.0)
        target = make_pose(DOWN[:3, :3], (x, y, height))
        if bench.state.mode != "holding":
            bench.controller.set_setpoint(HybridSetpoint(target, velocity=np.array((0.0, 0.0, -0.05))), bench.t)
        bench.step()
    assert bench.state.mode == "holding"
    assert "where no force is wanted" in bench.state.reason
    assert bench.force < 15.0
    bench.controller.enable(bench.t)  # and away from it
    bench.controller.set_setpoint(HybridSetpoint(bench.start), bench.t)
    bench.run(3.0)
    assert bench.force == 0.0
    assert bench.state.mode == "position"


def test_a_path_with_a_force_of_zero_into_something_is_held_as_any_other() -> None:
    bench = Bench(table=0.018).enabled()
    below = DOWN @ make_pose(None, (0.0, 0.0, 0.03))
    bench.controller.set_setpoint(HybridSetpoint(below, force_projector=PRESS_Z), bench.t)
    bench.run(12.0)
    assert bench.state.mode == "holding"
    assert "where no force is wanted" in bench.state.reason
    assert max(bench.forces) < 8.0


@pytest.mark.parametrize(("pressed_at", "back"), [(0.95, 0.0), (1.05, None)])
def test_the_way_back_is_known_for_a_second_and_an_enabled_arm_may_leave_what_presses(pressed_at, back) -> None:
    guard = Guard(ControllerParameters(max_unexpected_force=10.0), EventLog(""), float, float)
    plan = SimpleNamespace(normals=np.zeros((0, 3)), wanted=np.zeros(0))

    def image(stamp: float, force: float) -> None:
        m = SimpleNamespace(stamp=stamp, X_WC=make_pose(p=(stamp, 0.0, 0.0)))
        m.on_environment = Wrench(np.zeros(3), np.array((force, 0.0, 0.0)))
        guard.check_unexpected(m, plan, 0.0)

    guard.enable(True)
    image(-0.1, 4.9)
    image(0.0, 4.9)
    for force in (10.0, 15.1, 15.1):
        image(pressed_at, force)
    assert guard.held == ""  # 10.2 N more than before, in two images
    image(pressed_at, 15.1)
    assert "10.2 N where no force is wanted" in guard.held
    assert guard.back_to == (None if back is None else (back, 0.0, 0.0))
    guard.enable(True)
    for _ in range(5):
        image(pressed_at, 15.1)
    assert guard.held == ""
    for _ in range(3):
        image(pressed_at, 25.2)
    assert "10.1 N where no force is wanted" in guard.held


def test_poses_that_are_frozen_are_noticed() -> None:
    bench = Bench().enabled()
    bench.press(10.0)
    while not bench.state.in_contact:
        bench.step()
    frozen = bench.controller._inputs.estimate
    assert frozen is not None
    bench.told = lambda estimate: type(estimate)(estimate.stamp, frozen.X_CT)
    state = bench.run(2.0)
    assert state.mode == "holding"
    assert "frozen" in state.reason
    assert max(bench.forces) < 15.0


def test_frozen_poses_are_noticed_though_the_arms_history_began_after_the_first() -> None:
    frozen, history = FrozenPoseCheck(), PoseHistory()
    told = [RelativePoseEstimate(0.05 * i, np.eye(4)) for i in range(5)]
    for i in range(2, 5):
        history.add(0.05 * i, make_pose(np.eye(3), (0.0, 0.0, 1e-4 * i)))
    assert [frozen.check(b, a, history) for a, b in itertools.pairwise(told)] == [""] * 4
    history.add(0.25, make_pose(np.eye(3), (0.0, 0.0, 5e-3)))
    assert "estimate is frozen" in frozen.check(RelativePoseEstimate(0.25, np.eye(4)), told[-1], history)


@pytest.mark.parametrize(
    ("way", "turn", "words"),
    [
        (4e-4, 2e-3, ""),
        (6e-4, 0.0, "the arm has moved by 0.6 mm and 0.0 degrees"),
        (0.0, 5e-3, "the arm has moved by 0.0 mm and 0.3 degrees"),
    ],
)
def test_a_pose_is_frozen_that_stays_to_the_last_bit_though_the_arm_moves_or_turns(way, turn, words: str) -> None:
    """From the first pose that is so, however small each step is. It is told after half a second."""
    check, history = FrozenPoseCheck(), PoseHistory()
    told = [RelativePoseEstimate(0.05 * i, np.eye(4)) for i in range(21)]
    for i, estimate in enumerate(told):
        history.add(estimate.stamp, make_pose(so3_exp((turn * i / 20, 0.0, 0.0)), (0.0, 0.0, way * i / 20)))
    found = [check.check(b, a, history) for a, b in itertools.pairwise(told)]
    assert words in found[-1]
    assert bool(found[-1]) is bool(words)
    assert found[:10] == [""] * 10
    assert "the same to the last bit for 1.0 s" in check.warning
    check.check(RelativePoseEstimate(1.05, make_pose(p=(1e-9, 0.0, 0.0))), told[-1], history)
    assert check.warning == ""
    for a, b in itertools.pairwise(told[:11]):
        check.check(b, a, history)
        assert check.warning == ""


class Poses:
    """Of a tool in the grasp, from one at rest on; bounds are 3.5 mm and 0.07 rad, and for 20 ms of motion."""

    def __init__(self, deviation: float = 1e-4, flange_moves: float = 0.0) -> None:
        """deviation: [m], [rad] of an image. flange_moves: [m] in 20 ms."""
        p = ControllerParameters(max_jump=3.5)
        self.check, self.history, self._C = PoseJumpCheck(p), PoseHistory(), deviation**2 * np.eye(6)
        self.most = 3.5e-3 + 0.02 * p.press_speed, 0.07 + 0.02 * p.max_angular_speed
        for i in range(200):
            self.history.add(0.02 * i, make_pose(p=(0.0, 0.0, flange_moves * i)))
        measure = WrenchEstimator(Tool(), Bushing(DEFAULT_STIFFNESS), True, 3e-4).measure
        self._m = measure(RelativePoseEstimate(0.1, np.eye(4), self._C), np.eye(4))

    def jumped(self, shift: float, turn: float = 0.0, after: float = 0.02) -> bool:
        """Whether a pose that is so far off has, that much later [s]."""
        X_CT = make_pose(so3_exp((0.0, turn, 0.0)), (shift, 0.0, 0.0))
        estimate = RelativePoseEstimate(0.1 + after, X_CT, self._C)
        return "has jumped by" in self.check.check(estimate, self._m, self.history, 1000.0, 50.0)


@pytest.mark.parametrize(("shift", "turn", "jumps"), [(0.98, 0.98, False), (1.02, 0.0, True), (0.0, 1.02, True)])
def test_a_pose_jumps_by_its_place_or_its_turn(shift: float, turn: float, jumps: bool) -> None:
    poses = Poses()
    assert poses.jumped(shift * poses.most[0], turn * poses.most[1]) is jumps
    if jumps:  # time does not mend it; another pose is judged by the time since the last good one
        assert poses.jumped(shift * poses.most[0], turn * poses.most[1], after=0.5)
        assert not poses.jumped(-shift * poses.most[0], -turn * poses.most[1], after=0.5)
        assert not poses.jumped(shift * poses.most[0], turn * poses.most[1], after=0.5)


def test_noise_and_the_flanges_way_are_no_jump() -> None:
    assert Poses().jumped(8e-3)
    assert not Poses(deviation=1e-3).jumped(8e-3)
    assert Poses().jumped(0.0, 0.15)
    assert not Poses(deviation=0.02).jumped(0.0, 0.15)
    assert not Poses(flange_moves=5e-3).jumped(8e-3)
    assert Poses(flange_moves=5e-3).jumped(8e-3, after=0.0)


def test_the_largest_jump_that_does_not_hold_is_told() -> None:
    poses = Poses()
    for shift, told in ((6e-4, ""), (2e-3, "2.0"), (3e-3, "3.0"), (2e-3, "3.0")):
        assert not poses.jumped(shift + 0.02 * poses.check.parameters.press_speed)
        assert bool(poses.check.newest) is bool(told)
        assert told in poses.check.warning
    assert "jumped by 2.0 mm" in poses.check.newest
    assert "off by 2.0 N" in poses.check.newest


def here(bench: Bench) -> np.ndarray:
    """Where the tip is measured."""
    assert bench.state.X_W_tip is not None
    return make_pose(DOWN[:3, :3], bench.state.X_W_tip[:3, 3])


def press_from(bench: Bench, force: tuple[float, float, float], directions: np.ndarray) -> None:
    bench.controller.set_setpoint(
        HybridSetpoint(here(bench), Wrench(np.zeros(3), np.array(force)), directions), bench.t
    )


def down(bench: Bench) -> None:
    press_from(bench, (0.0, 0.0, -5.0), np.diag([0.0, 0.0, 1.0]))


def aside(bench: Bench) -> None:
    press_from(bench, (5.0, 0.0, 0.0), np.diag([1.0, 0.0, 0.0]))


def no_force(bench: Bench) -> None:
    press_from(bench, (0.0, 0.0, 0.0), np.diag([0.0, 0.0, 1.0]))


def stay(bench: Bench) -> None:
    bench.controller.set_setpoint(HybridSetpoint(here(bench)), bench.t)


def displace(bench: Bench) -> None:
    bench.controller.set_setpoint(RelativePoseSetpoint(make_pose(p=(0.0, 0.0, 0.01))), bench.t)


def turn(bench: Bench) -> None:
    bench.controller.set_setpoint(RelativePoseSetpoint(make_pose(rotation_from_rpy((0.0, 0.0, 0.1)))), bench.t)


@pytest.mark.parametrize(
    ("search", "other", "bound"),
    [
        (down, stay, BOUND),
        (down, no_force, BOUND),
        (down, aside, 2.0**0.5 * BOUND),
        (down, displace, 2.0 * BOUND),
        (displace, stay, BOUND),
        (turn, stay, BOUND),
    ],
)
@pytest.mark.parametrize(("searching", "otherwise"), [(0.4, 0.06), (0.024, 0.008)])
def test_a_client_that_alternates_goes_no_further_through_free_air(
    search: Callable[[Bench], None],
    other: Callable[[Bench], None],
    bound: float,
    searching: float,
    otherwise: float,
) -> None:
    bench = Bench(table=-1.0, start=make_pose(p=(0.0, 0.0, 0.3)) @ DOWN).enabled()
    start, R = bench.commands[-1][:3, 3], bench.commands[-1][:3, :3]
    while bench.t < 60.0 and bench.state.mode != "holding":
        search(bench)
        if bench.run(searching).mode != "holding":
            other(bench)
            bench.run(otherwise)
    bench.run(0.5)
    assert bench.state.mode == "holding"
    assert "max_free_travel" in bench.state.reason
    assert np.linalg.norm(bench.commands[-1][:3, 3] - start) < bound + 0.004
    assert np.rad2deg(np.arccos(0.5 * (np.trace(R.T @ bench.commands[-1][:3, :3]) - 1.0))) < 23.0


def test_a_place_that_was_asked_for_may_be_pressed_from_again() -> None:
    """Back up to where it began, or as far aside as the bound: the way is counted anew."""
    for aside_by, up in ((0.0, 0.045), (0.08, 0.0)):
        bench = Bench(table=-1.0, start=make_pose(p=(0.0, 0.0, 0.3)) @ DOWN).enabled()
        for _ in range(4):
            down(bench)
            while bench.commands[-1][2, 3] > bench.state.X_W_tip[2, 3] and bench.run(0.1).mode != "holding":
                if bench.controller.supervisor.guard.free_travel._ways[0].gone() < -0.045:
                    break
            assert bench.state.mode == "approach"
            bench.controller.set_setpoint(HybridSetpoint(make_pose(p=(aside_by, 0.0, up)) @ here(bench)), bench.t)
            assert bench.run(2.0).mode == "position"


def test_contact_begins_the_way_anew_though_something_else_was_followed_before() -> None:
    bench = Bench(table=-0.03).enabled()
    for _ in range(4):
        down(bench)
        assert bench.run(4.0).mode == "contact"
        bench.controller.set_setpoint(HybridSetpoint(make_pose(p=(0.0, 0.0, 0.02)) @ here(bench)), bench.t)
        assert bench.run(2.0).mode == "position"


def test_noise_is_no_force_however_little_is_wanted() -> None:
    bench = Bench(noise=3e-4, table=-1.0).enabled()
    bench.press(0.05)
    start = bench.commands[-1][2, 3]
    bench.run(8.0)
    way = bench.controller.supervisor.guard.free_travel._ways[0]
    assert_allclose(way.gone(), bench.commands[-1][2, 3] - start, atol=1e-4)
    assert "has not been reached for 8 s" in bench.state.reason

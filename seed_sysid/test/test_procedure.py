# SPDX-License-Identifier: Apache-2.0
"""The run keeps its limits, waits for rest, ends on slip."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated_data import at_rest

from seed_bringup import identify
from seed_core.config import ConfigError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS
from seed_core.spatial import make_pose, pose_from_rpy, so3_exp, so3_log
from seed_sim.identification.cell import SimulatedCell
from seed_sim.identification.scenario import load
from seed_sim.identification.session import simulate
from seed_sysid.data.dataset import DatasetError, Header
from seed_sysid.data.sample_file import read
from seed_sysid.fit.analysis import analyse
from seed_sysid.parameters import ExcitationParameters, LimitParameters, Procedure, SettleParameters
from seed_sysid.run.excitation import Target, design, designs
from seed_sysid.run.live import MOST, Live, LiveError, Streams
from seed_sysid.run.procedure import Command, Reading, Run, average
from seed_sysid.run.reach import Reach, limit_reached, load_share
from seed_sysid.run.rest_detector import RestDetector
from seed_sysid.stiffness_map import AXES

K = DEFAULT_STIFFNESS.vector()


def test_a_whole_run_is_short_settled_and_within_its_limits() -> None:
    """A grasp a third stiffer than guessed meets the wrench limit: poses are drawn back, none is lost."""
    scenario = load("default")
    limits = replace(scenario.procedure.limits, force=6.5, planned_share=1.0)
    scenario = replace(scenario, procedure=replace(scenario.procedure, widths=[0.02], limits=limits))
    data, cell = simulate(scenario, 2200, None)
    assert cell.stamp / 60.0 < 20.0 / 3.0
    assert any(s.clipped for s in data.samples)
    assert min(s.settle for s in data.samples) >= 1.0
    forces = np.linalg.norm([s.wrench[3:] for s in data.samples], axis=1)
    assert forces.max() < limits.force + 0.5  # [N] one reading's travel beyond the limit, and noise


def test_a_bubble_that_reports_its_pressure_late_does_not_end_the_run() -> None:
    home = Target("000-home", "home", (0.0,) * 6)
    told = [(), (1030.0,), (1030.0, 1028.0), (1032.0, 1028.0)]
    readings = [Reading(0.1 * i, np.eye(4), np.zeros(6), 0.02, pressures) for i, pressures in enumerate(told)]
    assert average(home, 0, readings, 1.0, False).pressures == (1031.0, 1028.0)
    assert average(home, 0, readings[:1], 1.0, False).pressures == ()


def test_a_pose_that_never_came_to_rest_is_marked_and_told() -> None:
    readings = [Reading(0.1 * i, np.eye(4), np.full(6, float(i)), 0.02) for i in range(3)]
    assert average(Target("a", "x", (0.0,) * 6), 0, readings, 0.0, False).settle == 0.001
    data, _ = at_rest(load("default"), 6)
    drifting = replace(data, samples=[replace(data.samples[0], settle=0.001), *data.samples[1:]])
    told = [w for w in analyse(drifting, "kinematic").warnings if "had not come to rest" in w]
    assert told == [f"1 poses had not come to rest (first: {data.samples[0].key}): raise settle.timeout"]


def test_a_timeout_before_any_pose_can_be_at_rest_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"settle\.timeout = 0\.5 s must be at least .* = 1\.6 s"):
        SettleParameters(timeout=0.5)
    assert SettleParameters(window=0.1, hold=0.2, timeout=0.3).timeout == 0.3


def test_a_procedure_without_a_width_is_refused() -> None:
    with pytest.raises(ConfigError, match="widths is empty: at least one width"):
        Procedure(widths=[])


def test_slip_ends_the_run() -> None:
    scenario = load("default")
    cell, run = SimulatedCell(scenario, 1), Run(scenario.procedure)
    command = Command(np.eye(4), 0.02, 0, "start")
    for i in range(400):
        reading = cell.step(command)
        command = run.step(replace(reading, slip=0.5 if i > 300 else 0.0))
        if command.failure:
            break
    assert "slips" in command.failure
    assert command.slid  # what goes on is a new grasp
    assert i == 301


@pytest.mark.parametrize(
    ("axis", "creep", "step_at", "reset_at", "at_rest"),
    [
        (5, 0.0, np.inf, np.inf, 1.52),  # nine tenths of the window, and the time to hold
        (5, 0.05, np.inf, np.inf, 1.52),  # 0.02 N from half to half
        (5, 0.15, np.inf, np.inf, np.inf),
        (0, 1e-3, np.inf, np.inf, 1.52),
        (0, 4e-3, np.inf, np.inf, np.inf),
        (5, 0.0, 1.2, np.inf, 2.7),  # the step has left the window, and has not come back since
        (5, 0.0, np.inf, 1.4, 2.92),
    ],
)
def test_a_wrench_is_at_rest_whose_means_have_stayed_for_the_time_to_hold(axis, creep, step_at, reset_at, at_rest):
    detector, rng, found = RestDetector(SettleParameters()), np.random.default_rng(4), np.inf
    for i in range(201):
        t = 0.02 * i
        wrench = np.array((3e-4,) * 3 + (0.01,) * 3) * rng.standard_normal(6)
        wrench[axis] += creep * t + 1.0 * (t > step_at)
        if abs(t - reset_at) < 1e-9:
            detector.reset()
        if detector.update(100.0 + t, wrench):
            found = min(found, t)
    assert found == pytest.approx(at_rest, abs=0.11)


def test_a_creeping_grasp_is_waited_for() -> None:
    """The wrench is still moving 1 s after the arm stopped: no pose is measured before the change is small."""
    scenario = load("default")
    slow = replace(
        scenario, grasp=replace(scenario.grasp, settle_time=0.8), procedure=replace(scenario.procedure, widths=[0.02])
    )
    quick, slow_cell = simulate(slow, 2201, None)
    error = np.abs(_stiffness(quick) / slow_cell.truth.stiffness - 1.0)
    assert error.max() < 0.02


def _stiffness(data):
    return analyse(data, "kinematic").solution.value.stiffness


def test_finished_poses_are_not_planned_again() -> None:
    run = Run(Procedure())
    done = [f"0/{t.name}" for _, t in run._queue[:10]]
    assert Run(Procedure(), done).done == 10


def test_an_interrupted_run_goes_on_from_where_the_arm_is() -> None:
    """No jump: the first command is at the start, and every further one within what the speeds allow."""
    scenario, start = load("default"), pose_from_rpy(np.deg2rad([8.0, 0.0, -5.0]), [0.003, -0.002, 0.004])
    motion, at, stamp = scenario.procedure.motion, start, 0.0
    run = Run(scenario.procedure, ["0/000-home"], start=start)
    for _ in range(100):
        command = run.step(Reading(stamp, at, np.zeros(6), 0.026))
        step = np.linalg.norm(command.X_TC[:3, 3] - at[:3, 3])
        turn = np.linalg.norm(so3_log(at[:3, :3].T @ command.X_TC[:3, :3]))
        assert step <= 0.1 * motion.speed + 1e-12
        assert turn <= np.deg2rad(0.1 * motion.turn_rate_deg) + 1e-9
        at, stamp = command.X_TC, stamp + 0.1
    assert command.state in ("moving", "settling", "measuring")


@pytest.mark.parametrize(("growth", "ends"), [(-1.0, False), (1.0, True)])
def test_the_arm_stays_where_it_is_if_the_load_grows_on_the_way_back(growth: float, ends: bool) -> None:
    """Something presses that should let go: the tool has caught on the fixture, say. growth: [N] each 0.02 s."""
    procedure = Procedure()
    run, at, stamp, load = Run(procedure), np.eye(4), 0.0, np.zeros(6)
    states = []
    while stamp < 60.0:
        command = run.step(Reading(stamp, at, load, 0.026))
        states.append(command.state)
        at, stamp = command.X_TC, stamp + 0.02
        if command.state == "failed":
            break
        if command.state == "moving" and np.linalg.norm(at[:3, 3]) > 0.002:
            load = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 1.02 * procedure.limits.force))
        if command.state in ("drawing back", "retreating"):
            load = load + growth * np.eye(6)[5]
        if "retreating" in states and command.state != "retreating":
            load = np.zeros(6)
    assert "drawing back" in states
    assert (command.state == "failed") == ends
    if ends:
        assert "on the way to the centre" in command.failure
        assert load[5] < 1.8 * procedure.limits.force
        np.testing.assert_array_equal(command.X_TC, at)


def test_a_pose_that_loads_too_much_is_drawn_back_twice_and_then_left_out() -> None:
    """A load that comes at once, beyond what ends the way back, is no reason to stay: it falls there, if late."""
    procedure = Procedure()
    run, at, load, events, began = Run(procedure), np.eye(4), np.zeros(6), list[str](), None
    visited = list[str]()
    first = next(t for t in designs(procedure)[0] if t.kind != "home")
    for i in range(6000):
        stamp = 0.02 * i
        command = run.step(Reading(stamp, at, load, 0.026))
        at = command.X_TC
        events += [command.event] if command.event else []
        visited += [command.sample.name] if command.sample else []
        assert not command.failure
        if began is None and command.state != "gripping":
            began = stamp
        out = np.linalg.norm(so3_log(at[:3, :3])) > 0.3 * np.linalg.norm(first.xi[:3])
        heavy = out and command.state == "moving" and len(events) < 3
        share = 1.6 if heavy else 1.55 if command.state == "drawing back" else 0.0
        load = np.array((0.0, 0.0, 0.0, 0.0, 0.0, share * procedure.limits.force))
        if len(events) == 3 and run.done == 2:
            break
    assert began == pytest.approx(procedure.motion.grip_time, abs=0.03)
    assert [e.split(":")[0] for e in events] == [*[f"{first.name} drawn back"] * 2, f"{first.name} skipped"]
    assert visited == [t.name for t in designs(procedure)[0] if t.name != first.name][:2]
    assert run.total - run.done == len(run._queue) + 1
    assert run.remaining(stamp) == pytest.approx(0.5 * stamp * len(run._queue))


def test_a_load_at_the_centre_ends_the_run_where_the_arm_is() -> None:
    procedure = Procedure()
    run, at, load = Run(procedure), np.eye(4), np.zeros(6)
    for i in range(2000):
        command = run.step(Reading(0.02 * i, at, load, 0.026))
        at = command.X_TC
        if command.failure:
            break
        assert not load.any()
        if command.state == "settling":
            load = np.array((0.0, 0.0, 1.6 * procedure.limits.torque, 0.0, 0.0, 0.0))
    assert "N m on the way to the centre" in command.failure


def test_a_run_knows_nothing_of_what_its_streams_said_before(tmp_path: Path) -> None:
    streams = Streams(X_WE=np.eye(4), pose_stamp=0.0, wrench_stamp=0.0)
    for i in range(5 * MOST):  # a sensor that is not zeroed yet, while nobody identifies anything
        streams.wrenches.append(np.full(6, 7.0 if i < 5 * MOST - 1 else 0.0))
    assert len(streams.wrenches) <= MOST
    streams.estimate = RelativePoseEstimate(-60.0, np.eye(4), gross_slip=True)
    streams.slip.append(1.0)
    live = Live(Procedure(), Header("hand", "tool"), np.eye(4), streams, tmp_path / "samples.jsonl", 0.0, "")
    reading = live._reading(0.0)
    live.recorder.close()
    np.testing.assert_array_equal(reading.wrench, np.zeros(6))
    assert (reading.slip, reading.gross_slip) == (0.0, False)


def _streams(now: float) -> Streams:
    """Of a cell with arm and sensor, and nothing else."""
    return Streams(X_WE=np.eye(4), pose_stamp=now, wrench_stamp=now, wrench=np.zeros(6))


def _live(streams: Streams, folder: Path, now: float = 0.0, source: str = "kinematic") -> Live:
    head = Header("hand", "tool")
    return Live(Procedure(), head, np.eye(4), streams, folder / "samples.jsonl", now, "", source)


@pytest.mark.parametrize(
    ("width", "pressure", "words"), [(26.0, 1030.0, "26 m .* mm"), (0.02, 1e5, "1000.. hPa .* Pa")]
)
def test_a_run_with_inputs_in_another_unit_does_not_start(
    tmp_path: Path, width: float, pressure: float, words: str
) -> None:
    streams = _streams(0.0)
    streams.take_width(width, 0.0)
    streams.take_pressure("left", pressure, 0.0)
    with pytest.raises(LiveError, match=f"cannot start: .*{words}"):
        _live(streams, tmp_path)
    assert not (tmp_path / "samples.jsonl").exists()


TAKE: dict[str, Callable[[Streams, float], None]] = {
    "relative_pose": lambda s, now: s.take_estimate(RelativePoseEstimate(now, np.eye(4)), now),
    "gripper/width": lambda s, now: s.take_width(0.02, now),
    "bubble_left/pressure": lambda s, now: s.take_pressure("left", 1030.0, now),
}


@pytest.mark.parametrize("name", TAKE)
def test_an_input_that_came_in_this_run_and_is_silent_ends_it(tmp_path: Path, name: str) -> None:
    streams = _streams(0.0)
    live = _live(streams, tmp_path)
    stale = 0.5 if "pressure" in name else 0.3  # [s]
    for now in np.arange(0.0, 2.01, 0.2):  # it has not come yet, and nobody misses it
        streams.pose_stamp = streams.wrench_stamp = now
        live.tick(now)
    TAKE[name](streams, 2.0)
    streams.pose_stamp = streams.wrench_stamp = 2.0 + stale
    live.tick(2.2)
    live.tick(2.0 + stale - 0.01)
    with pytest.raises(LiveError, match=rf"{name} is {stale + 0.01:.2f} s old \(at most {stale} s\); 0 of"):
        live.tick(2.0 + stale + 0.01)
    live.recorder.close()


@pytest.mark.parametrize("by", [3600.0, -3600.0])
def test_a_clock_that_is_set_ends_the_run_and_moves_nothing(tmp_path: Path, by: float) -> None:
    streams = _streams(0.0)
    live = _live(streams, tmp_path)
    now, at = 0.0, np.eye(4)
    while np.allclose(at, np.eye(4)):  # until it is on the way to the first pose
        now += 0.1
        streams.pose_stamp = streams.wrench_stamp = now
        at = live.tick(now)[1].X_TC
    streams.pose_stamp = streams.wrench_stamp = now + by
    with pytest.raises(LiveError, match=rf"{by:.2f} s between two steps .*: the clock was set, .*; 1 of "):
        live.tick(now + by)
    live.recorder.close()
    after = live.run.step(Reading(now + by, np.eye(4), np.zeros(6), 0.0)).X_TC
    motion = live.run.procedure.motion
    assert np.linalg.norm(after[:3, 3] - at[:3, 3]) <= 0.5 * motion.speed + 1e-12
    assert np.linalg.norm(so3_log(at[:3, :3].T @ after[:3, :3])) <= np.deg2rad(0.5 * motion.turn_rate_deg) + 1e-9


@pytest.mark.parametrize("name", TAKE)
def test_an_input_that_was_silent_before_the_run_is_none_of_it(tmp_path: Path, name: str) -> None:
    streams = _streams(60.0)
    TAKE[name](streams, 0.0)
    live = _live(streams, tmp_path, 60.0)
    reading = live._reading(60.0)
    live.tick(60.0)
    live.recorder.close()
    assert (reading.width, reading.pressures, reading.X_TC_estimated) == (0.0, (), None)


def test_poses_of_the_estimator_need_one(tmp_path: Path) -> None:
    streams = _streams(60.0)
    with pytest.raises(LiveError, match="cannot start: relative_pose never came; start arm, sensor and estimator"):
        _live(streams, tmp_path, 60.0, "estimator")
    TAKE["relative_pose"](streams, 0.0)
    with pytest.raises(LiveError, match=r"cannot start: relative_pose is 60\.00 s old"):
        _live(streams, tmp_path, 60.0, "estimator")
    TAKE["relative_pose"](streams, 60.0)
    _live(streams, tmp_path, 60.0, "estimator").recorder.close()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--scenario", "nowhere"], "neither a YAML file nor one of: default, weird"),
        (["--scenario", "nowhere.yaml"], "cannot be read"),
        (["--from", "nowhere.jsonl"], "cannot be read"),
        (["--live", "--from", "x.jsonl"], "--live and --from exclude each other"),
        (["--from", "x.jsonl", "--procedure", "weight"], "--procedure weight --from wants --hand"),
        (["--live", "--world", "hidden"], "--live and --world hidden exclude each other"),
    ],
)
def test_wrong_arguments_are_named(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert identify.main(arguments) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "ignored"),
    [
        ("--live --scenario weird", "--scenario"),
        ("--live --seed 0 --draws 3 --model plain", "--draws and --model and --seed"),
        ("--live --membrane 0", "--membrane"),
        ("--live --in-the-loop", "--in-the-loop"),
        ("--from x.jsonl --scenario weird --seed 5", "--scenario and --seed"),
        ("--from x.jsonl --world known", "--world"),
        ("--world hidden --scenario weird --model plain", "--model and --scenario"),
        ("--world hidden --poses kinematic", "--poses"),
        ("--world hidden --membrane 1", "--membrane"),
        ("--procedure weight --poses estimator", "--poses"),
        ("--procedure weight --out x", "--out"),
        ("--procedure weight --membrane 1 --model plain", "--model"),
        ("--membrane 1 --in-the-loop", "--in-the-loop"),
        ("--draws 3", "--draws"),
        ("--zero-sensor --domain 3", "--domain and --zero-sensor"),
    ],
)
def test_what_would_be_ignored_is_refused(line: str, ignored: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert identify.main(line.split()) == 2
    assert f" and --json: leave {ignored} out" in capsys.readouterr().err


def test_where_the_estimator_loses_the_tool_poses_are_drawn_back_and_later_ones_go_less_far() -> None:
    """It follows up to 9 degrees of pitch, of 12; lost, it finds the tool near the centre alone."""
    scenario = load("default")
    procedure = replace(scenario.procedure, widths=[0.02])
    cell, run = SimulatedCell(scenario, 1), Run(procedure)
    command, lost, samples, events = Command(np.eye(4), 0.02, 0, "start"), False, [], []
    while not command.done:
        reading = cell.step(command)
        pitch = abs(np.rad2deg(so3_log(reading.X_TC[:3, :3])[1]))
        lost = pitch > 9.0 or (lost and pitch > 2.0)
        command = run.step(replace(reading, followed=not lost))
        assert not command.failure
        events += [command.event] if command.event else []
        if command.sample:
            samples.append((command.sample, lost))
    assert len(samples) == run.total
    assert not any(lost for _, lost in samples)
    assert all("has not followed the tool" in e for e in events)
    assert len(events) <= 3  # once or twice on the axis itself; what was learnt spares the rest
    assert max(abs(s.kinematic[4]) for s, _ in samples) > np.deg2rad(7.0)
    assert {s.kind for s, _ in samples if s.lost} == {"pitch"}


def test_without_an_estimator_or_one_that_never_followed_nothing_is_drawn_back() -> None:
    scenario = load("default")
    for followed in (None, False):
        cell, run = SimulatedCell(scenario, 1), Run(replace(scenario.procedure, widths=[0.02]))
        command = Command(np.eye(4), 0.02, 0, "start")
        for _ in range(600):
            command = run.step(replace(cell.step(command), followed=followed))
            assert "followed" not in command.event


def test_combinations_keep_below_the_wrench_limit_by_the_stiffness_that_was_seen() -> None:
    excitation, limits = ExcitationParameters(), LimitParameters()
    reach, twice = Reach(excitation, limits), 2.0 * K  # [N m/rad, N/m]
    for j, axis in enumerate(AXES):
        xi = np.zeros(6)
        xi[j] = 0.5 * excitation.amplitudes[j]
        reach.measured(Target("a", axis, tuple(xi)), twice * xi)
    far = Target("b", "combination", tuple(0.8 * excitation.amplitudes))
    near = np.array(reach.within(far).xi)
    uses = np.linalg.norm(twice[3:] * near[3:]) / limits.force, np.linalg.norm(twice[:3] * near[:3]) / limits.torque
    assert max(uses) == pytest.approx(0.9)
    np.testing.assert_allclose(near / near[0], np.array(far.xi) / far.xi[0])  # the same direction


def test_poses_of_the_work_load_the_grasp_as_it_will_be_whatever_its_stiffness() -> None:
    """A press of 10 N dragged at the tip 0.12 m away, on a grasp of twice and half the guessed stiffness, by axis."""
    excitation = ExcitationParameters(work_force=(6.0, 3.0, 10.0), work_tip=(0.0, 0.0, 0.12))
    targets = [t for t in design(excitation, LimitParameters()) if t.kind == "work"]
    assert len(targets) == 12
    assert len(design(excitation, LimitParameters())) == excitation.poses
    np.testing.assert_allclose(targets[1].load, (0.0, 0.72, 0.0, 6.0, 0.0, 10.0), atol=1e-12)
    true, reach = np.array((2.0, 0.5, 1.0, 2.0, 0.5, 2.0)) * K, Reach(excitation, LimitParameters())
    for j, axis in enumerate(AXES):
        xi = np.zeros(6)
        xi[j] = excitation.amplitudes[j]
        reach.measured(Target("a", axis, tuple(xi)), true * xi)
    for target in targets:
        xi = np.array(reach.within(target).xi)
        np.testing.assert_allclose(true * (xi - target.turn), target.load, rtol=1e-9, atol=1e-12)
        reach.measured(target, true * xi)
    assert {round(float(np.rad2deg(t.turn[2])), 6) for t in targets} == {-4.8, 0.0, 4.8}
    first = targets[0]  # without a turn
    reach.measured(first, 1.2 * true * reach.within(first).xi)  # stiffer than on the single axes: the next go less far
    np.testing.assert_allclose(1.2 * true * reach.within(first).xi, first.load, rtol=1e-9)


def test_too_few_poses_for_those_of_the_work_are_named() -> None:
    with pytest.raises(ConfigError, match=r"excitation\.work_force needs"):
        design(ExcitationParameters(poses=42, work_force=(6.0, 3.0, 10.0)), LimitParameters())


LIMITS = LimitParameters()


@pytest.mark.parametrize(
    ("deg", "shift", "wrench", "words"),
    [
        (LIMITS.rotation_deg, LIMITS.translation, (0.0,) * 6, ""),  # the command itself may lie there
        (1.03 * LIMITS.rotation_deg, 0.0, (0.0,) * 6, "limits.rotation_deg"),
        (0.0, 1.03 * LIMITS.translation, (0.0,) * 6, "limits.translation"),
        (0.0, 0.0, (0.0, 0.0, 0.0, 0.0, 0.99 * LIMITS.force, 0.0), ""),
        (0.0, 0.0, (0.0, 0.0, 0.0, 0.0, 0.8 * LIMITS.force, 0.7 * LIMITS.force), "limits.force"),
        (0.0, 0.0, (0.0, 0.0, 0.99 * LIMITS.torque, 0.0, 0.0, 0.0), ""),
        (0.0, 0.0, (0.8 * LIMITS.torque, 0.0, 0.7 * LIMITS.torque, 0.0, 0.0, 0.0), "limits.torque"),
    ],
)
def test_every_limit_of_an_identification_counts_by_its_whole_size(deg, shift, wrench, words: str) -> None:
    size = np.sqrt(0.5) * np.array((1.0, 0.0, -1.0))
    found = limit_reached(make_pose(so3_exp(np.deg2rad(deg) * size), shift * size), np.array(wrench), LIMITS)
    assert bool(found) is bool(words)
    assert words in found
    assert (load_share(np.array(wrench), LIMITS) > 1.0) is (words in ("limits.force", "limits.torque"))


def test_combinations_and_work_that_fail_go_less_far_but_not_to_nothing() -> None:
    excitation = ExcitationParameters(work_force=(6.0, 3.0, 10.0))
    reach, far = Reach(excitation, LIMITS), Target("a", "combination", tuple(0.1 * excitation.amplitudes))
    for share in (0.85, 0.85**2):
        reach.failed(far, 0.7)
        assert_scaled(reach.within(far), far, share)
    for _ in range(20):
        reach.failed(far, 0.7)
    assert_scaled(reach.within(far), far, 0.3)
    work = next(t for t in design(excitation, LIMITS) if t.kind == "work")
    before = np.array(reach.within(work).xi)
    reach.failed(work, 0.7)
    np.testing.assert_allclose(np.array(reach.within(work).xi), 0.85 * before)  # this one has no turn


def assert_scaled(target: Target, of: Target, share: float) -> None:
    np.testing.assert_allclose(target.xi, share * np.array(of.xi))


def test_an_axis_is_not_driven_again_to_where_it_failed() -> None:
    excitation = ExcitationParameters()
    reach = Reach(excitation, LimitParameters())
    out = Target("a", "pitch", (0.0, float(excitation.amplitudes[1]), 0.0, 0.0, 0.0, 0.0))
    reach.failed(out, 0.7)
    assert reach.within(out.scaled(-1.0)).xi[1] == pytest.approx(-0.7 * excitation.amplitudes[1])
    assert reach.within(out.scaled(0.5)) == out.scaled(0.5)


def test_a_tool_that_is_not_found_again_at_the_centre_asks_for_a_new_grasp() -> None:
    scenario = load("default")
    cell, run = SimulatedCell(scenario, 1), Run(replace(scenario.procedure, widths=[0.02]))
    command, lost, since = Command(np.eye(4), 0.02, 0, "start"), False, None
    while not command.failure and cell.stamp < 120.0:
        reading = cell.step(command)
        lost = lost or abs(so3_log(reading.X_TC[:3, :3])[1]) > np.deg2rad(9.0)
        command = run.step(replace(reading, followed=not lost))
        if command.state == "searching" and since is None:
            since = cell.stamp
            np.testing.assert_allclose(command.X_TC, np.eye(4))
    assert command.regrasp
    assert "initialise the grasp" in command.failure
    assert cell.stamp - since == pytest.approx(LimitParameters().search, abs=0.3)


def test_a_simulated_run_grips_anew_and_goes_on() -> None:
    """Its estimator loses the tool at the first pitch beyond 9 degrees, until a new grasp."""
    scenario = load("default")
    scenario = replace(scenario, procedure=replace(scenario.procedure, widths=[0.02]))

    class Losing(SimulatedCell):
        lost, grasps = False, 1

        def step(self, command: Command) -> Reading:
            reading = super().step(command)
            self.lost = self.lost or abs(so3_log(reading.X_TC[:3, :3])[1]) > np.deg2rad(9.0)
            return replace(reading, followed=not self.lost)

        def grip_anew(self) -> None:
            self.lost, self.grasps = False, self.grasps + 1

    cell = Losing(scenario, 1)
    data, _ = simulate(scenario, 1, None, cell=cell)
    assert cell.grasps > 1
    assert len(data.samples) == data.header.planned
    assert sorted({s.grasp for s in data.samples}) == list(range(cell.grasps))  # friction begins anew in each


def test_a_pose_that_loses_the_tool_at_every_grasp_is_left_out() -> None:
    scenario = load("default")
    cell, run = SimulatedCell(scenario, 1), Run(replace(scenario.procedure, widths=[0.02]))
    command, lost, lost_at, skipped = Command(np.eye(4), 0.02, 0, "start"), False, [], ""
    while not (command.done or skipped) and cell.stamp < 300.0:
        reading = cell.step(command)
        lost = lost or reading.X_TC[0, 3] > 0.001  # of the first that goes along x, however little
        command = run.step(replace(reading, followed=not lost))
        if command.regrasp:
            lost_at.append(run.done)
            skipped = command.event if "skipped" in command.event else ""
            run.regrasped()
            lost = False
    assert len(lost_at) == 2
    assert lost_at[0] == lost_at[1]
    assert skipped.endswith("skipped: the tool was lost there twice")


def test_a_pose_that_loses_the_tool_again_when_the_run_goes_on_is_left_out(tmp_path: Path) -> None:
    """Each goal is a run of its own: what the earlier ones lost stands in the file."""
    told = []
    for _ in range(3):
        streams = _streams(0.0)
        live = _live(streams, tmp_path)
        with pytest.raises(LiveError, match=r"initialise the grasp; 1 of \d+ poses are kept"):
            _lose(live, streams)
        live.recorder.close()
        told.append(json.loads((tmp_path / "samples.jsonl").read_text().splitlines()[-1])["event"])
    first, second = (f"0/{t.name}" for t in design(ExcitationParameters(), LimitParameters())[1:3])
    assert [event["lost"] for event in told] == [first, first, second]
    assert "skipped: the tool was lost there twice" in told[1]["text"]


def _lose(live: Live, streams: Streams) -> None:
    """Run for a minute with an estimator that loses the tool as soon as it is turned by more than 3 degrees."""
    away = False
    for now in np.arange(0.0, 60.0, 0.1):
        streams.pose_stamp = streams.wrench_stamp = now
        streams.take_estimate(RelativePoseEstimate(now, np.eye(4), valid=not away), now)
        away |= not np.allclose(live.tick(now)[1].X_TC, np.eye(4), atol=0.05)


@pytest.mark.parametrize("slip", [0.0, 0.5])
def test_a_run_that_goes_on_is_in_a_new_grasp_if_the_tool_was_lost_or_slid(tmp_path: Path, slip: float) -> None:
    """Friction has forgotten the grasp before. Interrupted otherwise, it is the same grasp."""
    streams = _streams(0.0)
    live = _live(streams, tmp_path)
    if slip:
        _go_on(live, 1)
        streams.slip.append(slip)
        with pytest.raises(LiveError, match="slips in the grasp"):
            _go_on(live, 2)
    else:
        with pytest.raises(LiveError, match="initialise the grasp"):
            _lose(live, streams)
    live.recorder.close()
    for count in (2, 3):
        live = _live(_streams(0.0), tmp_path)
        _go_on(live, count)
        live.recorder.close()
    assert [s.grasp for s in read(tmp_path / "samples.jsonl").samples] == [0, 1, 1]


@pytest.mark.parametrize(("shift", "taken"), [(0.0003, True), (0.003, False)])
def test_a_new_grasp_elsewhere_than_the_first_does_not_go_on(tmp_path: Path, shift: float, taken: bool) -> None:
    """The arm holds where the tool slid. Gripped anew there, the spring is at rest away from the pose of the file."""
    streams = _streams(0.0)
    live = _live(streams, tmp_path)
    _go_on(live, 1)
    streams.slip.append(0.5)
    with pytest.raises(LiveError, match="slips in the grasp"):
        _go_on(live, 2)
    live.recorder.close()
    streams = _streams(0.0)
    streams.X_WE = make_pose(None, (0.0, shift, 0.0))
    if taken:
        _live(streams, tmp_path).recorder.close()
        return
    with pytest.raises(
        LiveError, match=r"the arm is 3\.0 mm and 0\.0 deg from .* open the gripper, bring the arm back"
    ):
        _live(streams, tmp_path)
    _live(_streams(0.0), tmp_path).recorder.close()  # it is as good as before


def test_a_run_does_not_go_on_with_another_place_of_C_in_the_flange(tmp_path: Path) -> None:
    """Its poses are those of the old C: the arm would go 5 mm off the grasp, and count the other poses from there."""
    head = Header("hand", "tool")
    for z, taken in ((0.15, True), (0.155, False), (0.15, True)):
        start = (Procedure(), head, make_pose(None, (0.0, 0.0, z)), _streams(0.0), tmp_path / "samples.jsonl", 0.0, "")
        if taken:
            Live(*start).recorder.close()
            continue
        with pytest.raises(DatasetError, match=r"its hand file \(hand\.E_C\) or its procedure was another: choose"):
            Live(*start)


def test_the_gripper_changes_its_width_at_the_centre_only() -> None:
    """A pose of the first grip was skipped, and the run was interrupted at the third one, away from the centre."""
    p = Procedure()
    keys = [f"{grip}/{t.name}" for grip, targets in enumerate(designs(p)) for t in targets]
    X_TC, width, changes = make_pose(None, (0.006, 0.0, 0.003)), p.widths[2], []
    run = Run(p, set(keys[:150]) - {keys[30]}, start=X_TC)
    for now in np.arange(0.0, 9.0, 0.02):
        command = run.step(Reading(now, X_TC, np.zeros(6), width))
        if command.width not in (None, width):
            width = command.width
            changes.append((width, float(np.abs(X_TC - np.eye(4)).max())))
        X_TC = command.X_TC
    assert [w for w, _ in changes] == [p.widths[0], p.widths[2]]
    assert max(away for _, away in changes) < 3e-4  # [m] one step


def _go_on(live: Live, count: int) -> None:
    """Until so many samples are in the file; the arm follows."""
    streams = live.streams
    while len(live.recorder.samples) < count:
        streams.pose_stamp = streams.wrench_stamp = now = streams.pose_stamp + 0.1
        streams.X_WE = live.tick(now)[0]

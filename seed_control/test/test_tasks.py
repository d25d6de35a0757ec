# SPDX-License-Identifier: Apache-2.0
"""Tasks as data: what a file may say, and what the player does with it on the bench."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from quasi_static import DT, Bench

from seed_control.parameters import ControllerParameters
from seed_control.state import ControllerState
from seed_control.tasks import (
    Task,
    TaskError,
    TaskPlayer,
    TaskStatus,
    check_fits,
    load_task,
    read_task,
    shipped_tasks,
    task_to_send,
)
from seed_control.tasks.font import FontError, strokes_of_text
from seed_control.tasks.path import Path as Route
from seed_control.tasks.steps import steps_of
from seed_control.tasks.task import Phase, WorkFrame
from seed_core.config import ConfigError, load_text
from seed_core.hand import DEFAULT_STIFFNESS, Tool
from seed_core.spatial import pose_from_rpy, rotation_error, so3_log

UPRIGHT = pose_from_rpy((np.pi, 0.0, 0.0), (0.0, 0.0, 0.0))[:3, :3]
NAMES = [
    "attitudes",
    "find_edge",
    "follow",
    "insert_peg",
    "insert_plug",
    "peg",
    "pen",
    "squeegee",
    "torque_driver",
    "write",
]


def bench_at(task_name: str) -> tuple[Bench, TaskPlayer]:
    task = load_task(task_name)
    place = np.array(task.frame.position) + np.array((0.0, 0.0, 0.03))
    return Bench(start=pose_from_rpy((np.pi, 0.0, 0.0), place)).enabled(), TaskPlayer(task)


def play(bench: Bench, player: TaskPlayer, seconds: float, until: str = "") -> TaskStatus:
    status = player.step(bench.t, bench.state)
    for _ in range(round(seconds / DT)):
        if status.setpoint is not None:
            bench.controller.set_setpoint(status.setpoint, bench.t)
        bench.step()
        status = player.step(bench.t, bench.state)
        if status.done or (until and status.phase == until):
            break
    return status


def test_a_task_is_sent_by_its_name_or_as_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    short = "{name: short, frame: {position: 0.4 0 0 m}, phases: [{name: go, to: 0 0 0.1 m}]}"
    (tmp_path / "pen").write_text(short)
    monkeypatch.chdir(tmp_path)
    assert task_to_send("pen") == "pen"  # as load_task has it, though a file here has that name
    assert read_task(task_to_send("./pen")) == load_task("./pen")  # of one line
    assert load_task("./pen").name == "short"
    with pytest.raises(TaskError, match=r"no task 'penn'.*did you mean pen\?"):
        task_to_send("penn")
    (tmp_path / "long.yaml").write_text(f"{short}  # {'-' * 1_000_000}")
    with pytest.raises(TaskError, match="too many to be sent; at most 1000000"):
        task_to_send("long.yaml")


def test_every_shipped_task_loads_under_its_name() -> None:
    assert list(shipped_tasks()) == NAMES
    for name in NAMES:
        task = load_task(name)
        assert task.name == name
        assert len(steps_of(task)) >= 4


def test_squeegee_presses_wipes_and_lifts() -> None:
    bench, player = bench_at("squeegee")
    status = play(bench, player, 30.0, until="wipe")
    began, start = bench.t, bench.X_WE[0, 3]
    assert_allclose(bench.force, 10.0, atol=1.0)
    status = play(bench, player, 30.0, until="lift")
    assert_allclose(bench.X_WE[0, 3] - start, 0.25, atol=2e-3)
    assert_allclose(bench.t - began, 0.25 / 0.05 + 0.05 / 0.2, atol=0.05)  # 50 mm/s and one ramp at each end
    held = np.array(bench.forces[-200:])
    assert_allclose(held, 10.0, atol=0.1)
    status = play(bench, player, 10.0)
    assert status.done
    assert not status.failed
    assert status.progress == 1.0
    assert bench.force == 0.0


def test_progress_rises_from_nothing_to_one() -> None:
    bench, player = bench_at("squeegee")
    seen = [player.step(bench.t, bench.state).progress]
    while not (status := play(bench, player, 0.2)).done:
        seen.append(status.progress)
    assert len(seen) > 20
    assert np.all(np.diff([*seen, status.progress]) >= -1e-12)
    assert seen[0] < 0.05


def test_progress_of_a_task_that_only_turns_the_tool_goes_from_nothing_to_one() -> None:
    task = load_text("name: turn\nphases: [{name: turn, tilt: 0 0 10 deg}]\n", Task, "turn.yaml")
    bench, player = bench_at("squeegee")[0], TaskPlayer(task)
    seen = [player.step(bench.t, bench.state).progress]
    while not (status := play(bench, player, 0.1)).done:
        seen.append(status.progress)
    assert len(seen) > 4  # 10 degrees at 0.3 rad/s
    assert np.all(np.diff([*seen, status.progress]) > 0.0)
    assert (seen[0], status.progress) == (0.0, 1.0)


@pytest.mark.parametrize("phase", ["approach", "press", "wipe", "lift"])
def test_cancel_at_any_point_leaves_the_tool_lifted(phase: str) -> None:
    bench, player = bench_at("squeegee")
    play(bench, player, 30.0, until=phase)
    play(bench, player, 0.3)
    player.cancel()
    status = play(bench, player, 10.0)
    assert status.done
    assert status.cancelled
    assert not status.failed
    bench.run(0.5)
    assert bench.force == 0.0
    assert bench.tip_height() > 0.04


def test_cancel_before_the_first_step_does_not_start_the_task() -> None:
    bench, player = bench_at("squeegee")
    player.cancel()
    before = bench.X_WE.copy()
    status = play(bench, player, 10.0)
    assert status.done
    assert status.cancelled
    bench.run(2.0)
    assert_allclose(bench.X_WE, before, atol=1e-6)


def test_a_task_that_is_cancelled_in_a_turn_turns_no_further() -> None:
    task = Task(name="t", frame=WorkFrame((0.5, 0.0, 0.25)), phases=(Phase("turn", (0, 0, 0), tilt=(80.0, 0, 0)),))
    bench, player = Bench(start=pose_from_rpy((np.pi, 0.0, 0.0), (0.5, 0.0, 0.25))).enabled(), TaskPlayer(task)
    before = bench.X_WE[:3, :3].copy()
    play(bench, player, 1.5)
    turned = np.linalg.norm(rotation_error(bench.X_WE[:3, :3], before))
    player.cancel()
    assert play(bench, player, 10.0).cancelled
    bench.run(2.0)
    assert 0.2 < turned < 0.6
    assert np.linalg.norm(rotation_error(bench.X_WE[:3, :3], before)) < turned + 0.05


def test_a_table_that_falls_away_is_named_as_that() -> None:
    bench, player = bench_at("squeegee")
    play(bench, player, 30.0, until="wipe")
    play(bench, player, 1.0)
    for _ in range(4000):
        bench.table -= 0.15 * DT  # [m/s]
        status = play(bench, player, DT)
        if status.done:
            break
    assert status.failed
    assert "contact is lost, and there is none within max_free_travel" in status.message
    assert "the surface has ended or fallen away" in status.message


def test_missing_table_fails_the_task_and_says_why() -> None:
    bench, player = bench_at("squeegee")
    bench.table = -0.5
    status = play(bench, player, 30.0)
    assert status.done
    assert status.failed
    assert "no contact within" in status.message


def test_condition_that_never_holds_times_out_and_lifts(tmp_path: Path) -> None:
    text = shipped_tasks()["squeegee"].read_text().replace("until: settled", "until: settled\n    timeout: 0.1 s")
    file = tmp_path / "short.yaml"
    text = text.replace("to: -0.015 0 0.015 m", "to: -0.015 0 0.03 m").replace("speed: 0.015 m/s", "speed: 0.2 m/s")
    file.write_text(text)
    bench, _ = bench_at("squeegee")
    bench.table = -0.02
    status = play(bench, TaskPlayer(load_task(file)), 30.0)
    assert status.done
    assert status.failed
    assert "phase 'press' waited 0.1 s for 'settled'" in status.message
    assert bench.force == 0.0


def test_an_approach_may_take_longer_than_the_timeout_while_it_gets_nearer() -> None:
    """For 1 N a stiff grasp lets its gripper go at 3 mm/s: 15 s for what the paper is too low by."""
    bench = replace(bench_at("pen")[0], stiffness=DEFAULT_STIFFNESS.scaled(2.0), table=-0.035).enabled()
    bench.told = lambda estimate: replace(estimate, covariance=1e-9 * np.eye(6))
    status = play(bench, TaskPlayer(load_task("pen")), 60.0, until="stroke 1/3 draw")
    assert status.phase == "stroke 1/3 draw", status.message
    assert bench.t > 12.0
    assert_allclose(bench.force, 1.0, atol=0.1)


def test_a_force_goes_by_its_profile_along_the_path() -> None:
    phases = load_task("squeegee").phases
    wipe = next(p for p in phases if p.name == "wipe")
    assert wipe.control is not None
    changes = replace(wipe, control=replace(wipe.control, profile=(1.0, 0.6, 1.2)))
    task = replace(load_task("squeegee"), phases=tuple(changes if p.name == "wipe" else p for p in phases))
    bench, _ = bench_at("squeegee")
    player = TaskPlayer(task)
    play(bench, player, 30.0, until="wipe")
    start, off = bench.X_WE[0, 3], list[float]()
    while (status := play(bench, player, 0.1)).phase == "wipe":
        way = (bench.X_WE[0, 3] - start) / 0.25
        wanted = 10.0 * np.interp(way, (0.0, 0.5, 1.0), (1.0, 0.6, 1.2))
        off.append(bench.force - wanted)
    assert not status.failed
    assert len(off) > 40
    assert max(map(abs, off)) < 0.3
    with pytest.raises(TaskError, match=r"phase 'wipe' asks for a force of 12 N, beyond .* max_force = 11 N"):
        check_fits(task, Tool(name="squeegee"), ControllerParameters(max_force=11.0))


def test_a_tip_that_lands_beside_its_place_stays_there_and_comes_back_along_the_path() -> None:
    """As `press` and `wipe` without the drag: nothing is pushed for against friction while the tip stands."""
    phases = {p.name: p for p in load_task("squeegee").phases}
    touch, wipe = replace(phases["press"], to=None, dwell=1.0), replace(phases["wipe"], to=(0.1, 0.0, 0.0))
    task = replace(load_task("squeegee"), frame=WorkFrame(), phases=(touch, wipe))
    player, start = TaskPlayer(task), pose_from_rpy((np.pi, 0.0, 0.0), (0.0, 0.0, 0.01))
    state = ControllerState(0.0, "approach", enabled=True, X_W_tip=start)
    landed = pose_from_rpy((np.pi, 0.0, 0.0), (0.001, -0.002, 0.0))
    rng, asked = np.random.default_rng(0), list[np.ndarray]()
    for i in range(1000):
        if i > 100:
            X = landed.copy()
            X[:3, 3] += 1e-3 * rng.standard_normal(3) * (1.0, 1.0, 0.0)
            state = state._replace(mode="contact", in_contact=True, settled=True, X_W_tip=X)
        status = player.step(i * 0.02, state)
        if status.setpoint is None:
            break
        asked.append(status.setpoint.X_W_tip[:2, 3])
    stood = np.array(asked[130:150])
    assert_allclose(stood[-1], landed[:2, 3], atol=6e-4)
    assert np.ptp(stood, axis=0).max() == 0.0
    way = np.array(asked[155:])
    assert np.abs(way[way[:, 0] > 0.0101, 1]).max() < 1e-9
    assert_allclose(way[-1], (0.1, 0.0), atol=1e-4)  # of the step before the end


def test_force_can_be_given_and_keeps_its_direction() -> None:
    task = load_task("squeegee", force=5.0)
    assert [p.control.force for p in task.phases if p.control] == [(0.0, 0.0, -5.0)] * 2
    pen = load_task("pen", force=1.5)
    assert pen.draw is not None
    assert pen.draw.control.force == (0.0, 0.0, -1.5)
    assert pen.draw.forces == ()
    with pytest.raises(TaskError, match=r"force = -5 N must be from 0.1 to 200 N"):
        load_task("squeegee", force=-5.0)


def test_force_that_is_given_is_also_that_of_a_touch_within_its_bounds() -> None:
    task = load_task("find_edge", force=1.0)
    assert {p.contact_stop.force for p in task.phases if p.contact_stop} == {1.0}
    assert load_task("find_edge", force=0.5).phases
    assert load_task("find_edge", force=20.0).phases
    for force in (0.4, 20.5):
        with pytest.raises(TaskError, match=rf"force = {force} N: contact_stop touches with 0\.5 to 20 N: give"):
            load_task("find_edge", force=force)


def test_text_can_be_given_to_a_task_that_writes() -> None:
    assert len(steps_of(load_task("write", text="I"))) < len(steps_of(load_task("write", text="SEED")))
    with pytest.raises(TaskError, match=r"does not write"):
        load_task("squeegee", text="SEED")
    with pytest.raises(TaskError, match=r"task 'write': text = 'Straße': .*no strokes for 'ß'"):
        load_task("write", text="Straße")


def test_letters_have_the_height_asked_for_and_stand_on_the_line() -> None:
    points = np.array([p for s in strokes_of_text("HEN", 0.02, (0.1, 0.2)) for p in s])
    assert_allclose((points[:, 1].min(), points[:, 1].max()), (0.2, 0.22), atol=1e-12)
    assert_allclose(points[:, 0].min(), 0.1, atol=1e-12)
    with pytest.raises(FontError, match=r"font 'arial' is unknown"):
        strokes_of_text("H", 0.02, font="arial")


def test_route_keeps_speed_and_acceleration_and_arrives() -> None:
    route = Route([(0, 0, 0), (0.1, 0, 0), (0.1, 0.05, 0)], 0.05, 0.2)
    t = np.arange(0.0, route.duration + 0.1, 1e-3)
    speed = np.array([np.linalg.norm(route.at(s)[1]) for s in t])
    assert speed.max() <= 0.05 + 1e-12
    assert np.abs(np.diff(speed)).max() <= 0.2e-3 * 1.01
    assert_allclose(route.at(route.duration)[0], (0.1, 0.05, 0.0))
    steps = np.array([route.at(s)[0] for s in t])
    assert_allclose(np.linalg.norm(np.diff(steps, axis=0), axis=1).sum(), 0.15, atol=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "speed: 0.05 m/s",
            "speed: 50 mm/s",
            r":26: phases\[2\].speed = '50 mm/s' must be numbers with their unit, m/s",
        ),
        ("speed: 0.05 m/s", "speed: 0.05", r":26: .*speed = 0.05 must be numbers with their unit"),
        ("speed: 0.05 m/s", "speed: 5 m/s", r":26: .*speed = 5 m/s must be within 0.0001 and 0.25 m/s"),
        ("speed: 0.05 m/s", "velocity: 0.05 m/s", r":26: unknown key 'phases\[2\].velocity'; known here: name, to"),
        ("force: 0 0 -10 N", "force: 0 -10 N", r":17: .*force has 2 values; it needs 3"),
        ("force: 0 0 -10 N", "force: 1 0 -10 N", r"1 N along x, which is not among force_directions"),
        ("force: 0 0 -10 N", "force: 0 0 .nan N", r":17: .*must be numbers with their unit, N"),
        ("until: settled", "until: done", r":22: .*until = 'done' must be one of: arrived, contact, settled"),
        ("contact_resists: [x]", "contact_resists: [y]", "nothing would stop the rotation"),
        ("[z]", "[z]\n      profile: [1.0]", "profile has one share: give the force itself"),
        ("[z]", "[z]\n      profile: [1.0, 20.0]", r"profile.* = 20 must be within 0.1 and 10"),
        ("[z]", "[w]", "force_directions has 'w'; known: x, y, z"),
        ("tip_rpy: 180 0 0 deg", "tip_rpy: 3.14 0 0 rad", r":7: tip_rpy = .* with their unit, deg"),
    ],
)
def test_errors_in_a_file_name_line_key_value_and_remedy(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = shipped_tasks()["squeegee"].read_text()
    assert old in text
    file = tmp_path / "task.yaml"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError, match=words) as caught:
        load_task(file)
    assert str(caught.value).startswith(str(file))


def test_unknown_task_names_the_known_ones() -> None:
    with pytest.raises(TaskError, match=r"no task 'sweep'.*insert_peg, .*write"):
        load_task("sweep")


def test_a_stroke_of_one_point_is_refused() -> None:
    strokes = "strokes: [[[0.0, 0.0], [0.1, 0.0]], [[0.05, 0.0]]]"
    phases = "phases: [{name: go, to: 0 0 0.02 m}, {name: lift, to: 0 0 0.05 m}]"
    text = f"name: dots\n{phases}\ndraw: {{control: {{force: 0 0 -2 N}}, {strokes}}}\n"
    with pytest.raises(ConfigError, match="stroke 2 has 1 point"):
        load_text(text, Task, "dots.yaml")
    load_text(text.replace(", [[0.05, 0.0]]", ""), Task, "dots.yaml")


def small_task(*phases: str) -> Task:
    """Starts 15 mm above a table that may be there."""
    return load_text(
        "name: small\nframe: {position: 0.5 0 0 m}\nphases:\n"
        + "".join(f"  - {{{phase}}}\n" for phase in ("name: approach, to: 0 0 0.015 m", *phases)),
        Task,
    )


def above(table: float = 0.0) -> Bench:
    return Bench(table=table, start=pose_from_rpy((np.pi, 0.0, 0.0), (0.5, 0.0, 0.03))).enabled()


def turn(status: TaskStatus) -> float:
    """[deg] about y of the wanted tip, from upright."""
    assert status.setpoint is not None
    return float(np.rad2deg(so3_log(UPRIGHT.T @ status.setpoint.X_W_tip[:3, :3])[1]))


@pytest.mark.parametrize(
    ("phase", "words"),
    [
        ("along: surface, search: {}, control: {force: 0 0 -2 N}", "go along the work frame: leave out along"),
        ("along: surface, contact_stop: {}", "go along the work frame: leave out along"),
        ("until: settled, contact_stop: {}", "leave out until and dwell"),
        ("dwell: 1 s, contact_stop: {}", "leave out until and dwell"),
        ("search: {pattern: here}, control: {force: 0 0 -2 N}", "say until: settled"),
        ("search: {}, until: contact, control: {force: 0 0 -2 N}", "pattern: spiral ends .* leave out until and dwell"),
        ("search: {}, dwell: 5 s, control: {force: 0 0 -2 N}", "pattern: spiral ends .* leave out until and dwell"),
        ("insert: {depth: 0.01 m}, until: settled, control: {force: 0 0 -2 N}", "its depth: leave out until and dwell"),
        ("insert: {depth: 0.01 m}, dwell: 5 s, control: {force: 0 0 -2 N}", "its depth: leave out until and dwell"),
        ("to: 0 0 0 m, until: settled", "until: settled waits for a force: say which, by control"),
        ("to: 0 0 0 m, control: {force: 0 0 0 N, profile: [1, 2]}", "shares of a force of 0 N: give force"),
    ],
)
def test_what_a_phase_would_not_do_is_refused(phase: str, words: str) -> None:
    with pytest.raises(ConfigError, match=f"^<text>:5: .*{words}"):
        small_task(f"name: odd, {phase}")


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("font: futural", "font: futurall", 22, "font 'futurall' is unknown; known: .*did you mean futural"),
        ("text: SEED", "text: hé", 21, "text = 'hé': font 'futural' has no strokes for 'é': leave it out"),
        ("text: SEED", "text: '   '", 21, "text = '   ' has nothing to write: give more than spaces"),
        (
            "text: SEED",
            "strokes: [[[0, 0], [0.1, 0]]]\n  forces: [3]",
            22,
            "forces are sizes along control.force, and that is 0 N: say there which way it presses",
        ),
    ],
)
def test_what_a_drawing_cannot_write_is_refused_when_it_is_loaded(
    tmp_path: Path, old: str, new: str, line: int, words: str
) -> None:
    file = tmp_path / "task.yaml"
    text = shipped_tasks()["write"].read_text().replace(old, new)
    file.write_text(text.replace("force: 0 0 -2 N", "force: 0 0 0 N") if "forces" in new else text)
    with pytest.raises(ConfigError, match=f"{file}:{line}: .*{words}"):
        load_task(file)


@pytest.mark.parametrize("control", ["", "control: {force: 0 0 -5 N}, "])
def test_a_tilt_stays_until_it_is_changed_along_a_surface_too(control: str) -> None:
    task = small_task(
        "name: tilted, to: 0 0 0.012 m, tilt: 0 10 0 deg",
        f"name: going, along: surface, {control}to: 0.02 0 0 m",
        f"name: upright, along: surface, {control}to: 0.02 0 0 m, tilt: 0 0 0 deg",
    )
    bench, player = above(), TaskPlayer(task)
    play(bench, player, 20.0, until="going")
    assert turn(play(bench, player, 0.3, until="upright")) == pytest.approx(10.0, abs=0.5)
    assert turn(play(bench, player, 20.0, until="upright")) == pytest.approx(10.0, abs=0.5)
    last = 10.0
    for _ in range(2000):
        status = play(bench, player, DT)
        if status.done:
            break
        last = turn(status)
    assert abs(last) < 0.5 or control  # a found surface is followed slowly
    assert last < 9.0


def test_phases_that_share_a_name_are_told_apart_by_their_index() -> None:
    go = [f"name: {name}, to: {x} 0 0.015 m" for name, x in (("go", 0.02), ("turn back", 0.01), ("go", 0.0))]
    bench, player = above(table=-5.0), TaskPlayer(small_task(*go))
    told: list[tuple[str, int | None]] = []
    while not (status := play(bench, player, DT)).done:
        told.append((status.phase, status.index))
    assert list(dict.fromkeys(told)) == [("approach", 0), ("go", 1), ("turn back", 2), ("go", 3)]
    player = TaskPlayer(small_task(*go))
    play(bench, player, 0.1)
    player.cancel()
    assert play(bench, player, 0.1).index is None  # while it lifts


def test_a_touch_with_a_tilt_turns_the_tool_gradually() -> None:
    bench, player = above(), TaskPlayer(small_task("name: stop, tilt: 0 30 0 deg, contact_stop: {}, speed: 0.005 m/s"))
    last, steps = 0.0, []
    for _ in range(1000):
        status = play(bench, player, DT)
        if status.done:
            break
        steps.append(abs(turn(status) - last))
        last = turn(status)
    assert max(steps) < 0.2
    assert last > 20.0


@pytest.mark.parametrize(("edge", "most"), [("", 0.02), ("edge: x, ", 0.05)])
def test_what_is_not_touched_within_reach_ends_with_a_lift(edge: str, most: float) -> None:
    reach = 0.02 if not edge else 0.3
    task = small_task(f"name: stop, contact_stop: {{{edge}reach: {reach} m}}, speed: 0.02 m/s")
    bench, player = above(table=-5.0), TaskPlayer(task)
    status = play(bench, player, 30.0)
    assert f"found nothing within {most:g} m along -z" in status.message
    assert bench.state.mode != "holding"
    assert bench.tip_height() > 0.015 - most + 0.5 * task.lift  # it was lifted


def test_with_an_edge_reach_bounds_the_way_along_the_surface_alone() -> None:
    task = small_task("name: edge, contact_stop: {edge: x, reach: 0.01 m}, speed: 0.02 m/s")
    bench = above()  # the tip comes down by 15 mm, on a table without an end
    status = play(bench, TaskPlayer(task), 30.0)
    assert "found no edge within reach = 0.01 m along x" in status.message


def test_a_reach_beyond_the_controllers_free_travel_is_refused_before_it_begins() -> None:
    with pytest.raises(
        TaskError, match=r"reaches for 0\.15 m, and the controller holds after max_free_travel = 0\.06 m"
    ):
        check_fits(small_task("name: stop, contact_stop: {reach: 0.15 m}"), Tool(), ControllerParameters())
    check_fits(small_task("name: stop, contact_stop: {edge: x, reach: 0.15 m}"), Tool(), ControllerParameters())


def test_a_task_that_may_not_wait_fails_where_the_arm_holds_at_its_first_step() -> None:
    """Accepted, then held: a later enable must not start it."""
    bench = above()
    waiting, accepted = TaskPlayer(small_task()), TaskPlayer(small_task(), waits=False)
    bench.controller.hold(bench.t, "stopped on request")
    state = bench.step()
    assert waiting.step(bench.t, state).phase == "waiting"
    status = accepted.step(bench.t, state)
    assert status.done
    assert status.failed
    assert "arm holds: stopped on request" in status.message

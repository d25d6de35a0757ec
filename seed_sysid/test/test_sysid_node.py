# SPDX-License-Identifier: Apache-2.0
"""The live node against the simulated cell: it resumes, finishes, writes, cancels, and refuses in words."""

import json
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from toy_membrane import toy_dataset

pytest.importorskip("rclpy", reason="needs ROS 2")
IdentifyStiffness = pytest.importorskip("seed_msgs.action", reason="needs the built messages").IdentifyStiffness

from geometry_msgs.msg import PoseStamped, WrenchStamped  # noqa: E402
from rclpy.node import Node  # noqa: E402
from std_msgs.msg import String  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from seed_bringup.launching.description import describe  # noqa: E402
from seed_core.clocks import read_clocks, save_clocks  # noqa: E402
from seed_core.errors import SeedError  # noqa: E402
from seed_core.spatial import Wrench, make_pose  # noqa: E402
from seed_core.stiffness_file import load_stiffness  # noqa: E402
from seed_ros.conversions import pose_stamped, wrench_stamped  # noqa: E402
from seed_ros.qos import LATCHED, QUEUE  # noqa: E402
from seed_ros.testing import Bench  # noqa: E402
from seed_sim.identification.cell import SimulatedCell  # noqa: E402
from seed_sim.ros.identification_cell import CellNode  # noqa: E402
from seed_sysid.data.sample_file import Recorder, read  # noqa: E402
from seed_sysid.fit.analysis import analyse  # noqa: E402
from seed_sysid.ros import goal as goal_module  # noqa: E402
from seed_sysid.ros import node as node_module  # noqa: E402
from seed_sysid.ros.node import LINES, SysidNode  # noqa: E402
from seed_sysid.run.excitation import design  # noqa: E402
from seed_sysid.run.procedure import Command, average  # noqa: E402

pytestmark = pytest.mark.ros

ROOT = Path(__file__).resolve().parents[1]
LEFT = 4  # poses that the node has to visit itself
SENSOR = {"sensor__position": [0.0, 0.0, 0.06], "sensor__rpy_deg": [180.0, 0.0, 30.0]}
QUICK = {
    "procedure__widths": [0.02],
    "procedure__motion__grip_time": 0.2,
    "procedure__settle__window": 0.4,
    "procedure__settle__hold": 0.6,
    "procedure__settle__average": 0.4,
}


def _nodes(bench: Bench, camera_clock: float = 0.0, **more: Any) -> tuple[Any, Any]:
    return bench.add(CellNode, seed=5, camera_clock=camera_clock), bench.add(SysidNode, **SENSOR, **QUICK, **more)


def _begin(cell: Any, node: Any, folder: Path, left: int = LEFT) -> None:
    """All but the last poses, as an interrupted run of the same grasp leaves them."""
    from seed_core.hand import Hand
    from seed_sysid.data.dataset import Header
    from seed_sysid.run.live import Live, Streams

    streams = Streams(X_WE=cell.X_WE, pose_stamp=0.0, wrench_stamp=0.0)
    head = Header(
        hand=Hand().name, tool="ft_sensor", sensor_xyz=(0.0, 0.0, 0.06), sensor_rpy=(np.pi, 0.0, np.deg2rad(30.0))
    )
    live = Live(node.procedure, head, Hand().X_EC, streams, folder / "samples.jsonl", 0.0, "before")
    live.recorder.close()
    writer = Recorder(folder / "samples.jsonl", live.recorder.header)
    twin, p = SimulatedCell(cell.scenario, 5), node.procedure
    targets = design(p.excitation, p.limits, p.fit.model)
    for i, target in enumerate(targets[: len(targets) - left]):
        readings = twin.rest(Command(target.X_TC, 0.02, 1, "measuring"), 20)
        sample = average(target, 0, readings, 1.0, False)
        writer.record(0.0, replace(sample, stamp=time.time() - 300.0 + 4.0 * i))
    writer.close()


def test_a_cell_of_membranes_is_refused_which_this_node_does_not_simulate(bench: Bench, tmp_path: Path) -> None:
    file = tmp_path / "membranes.yaml"
    file.write_text("name: membranes\ngrasp: {kind: membrane}")
    with pytest.raises(SeedError, match="membrane: this node simulates a bushing only"):
        bench.add(CellNode, scenario=str(file))


def test_a_goal_resumes_visits_the_rest_and_leaves_a_stiffness_file(bench: Bench, tmp_path: Path) -> None:
    save_clocks(tmp_path / "before.yaml", 0.01, 0.001, "2026-11-22")
    cell, node = _nodes(bench, camera_clock=0.04, clocks=str(tmp_path / "before.yaml"))
    _begin(cell, node, tmp_path)
    lines: list[str] = []
    bench.client.create_subscription(String, "identification/samples", lambda m: lines.append(m.data), LINES)
    assert bench.until(lambda: not node.streams.missing(node.now()))
    goal = IdentifyStiffness.Goal(output=str(tmp_path), poses="kinematic")
    cancelled = bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)
    assert bench.until(cancelled.cancel_goal_async().done)
    assert "cancelled" in bench.result(cancelled).result.message
    handle = bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)
    result = bench.result(handle, 120.0).result
    assert result.success, result.message
    data = read(tmp_path / "samples.jsonl")
    assert len(data.samples) == node.procedure.excitation.poses
    true = cell.cell.truth.stiffness[1]
    np.testing.assert_allclose([*result.rotation, *result.translation], true, rtol=0.03)
    grips = load_stiffness(result.stiffness_file).grips
    np.testing.assert_allclose([*grips[0].rotation, *grips[0].translation], true, rtol=0.03)
    clock = json.loads((tmp_path / "summary.json").read_text())["camera_clock"]
    assert clock["value"] == pytest.approx(0.04, abs=0.005)
    assert "clocks.yaml" in result.message
    total = read_clocks(str(tmp_path / "clocks.yaml")).offset  # what was taken off before, and what was left
    assert total == pytest.approx(0.01 + 0.04, abs=0.005)
    assert "<svg" in (tmp_path / "report.html").read_text()
    assert bench.until(lambda: len(lines) == 2 * (len(data.samples) + 1) - LEFT)  # the cancelled goal's, then all
    away = np.abs(cell.X_WE - cell.settings.flange.pose).max()
    assert away < 1e-6  # back at the grasp


def test_an_analysis_that_fails_ends_its_goal_and_not_the_node(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stumble(*_: object) -> None:
        raise ZeroDivisionError("float division by zero")

    cell, node = _nodes(bench)
    _begin(cell, node, tmp_path, left=0)
    assert bench.until(lambda: not node.streams.missing(node.now()))
    monkeypatch.setattr(goal_module, "analyse", stumble)
    goal = IdentifyStiffness.Goal(output=str(tmp_path), poses="kinematic")
    failed = bench.result(bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)).result
    assert not failed.success
    assert "the analysis failed (ZeroDivisionError: float division by zero)" in failed.message
    assert f"--from {tmp_path / 'samples.jsonl'}" in failed.message
    monkeypatch.undo()
    again = bench.result(bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)).result
    assert again.success, again.message


def test_a_goal_is_cancelled_while_its_poses_are_analysed(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    go_on, began = threading.Event(), threading.Event()

    def analyse_slowly(*arguments: Any) -> Any:
        began.set()
        go_on.wait(60.0)
        return analyse(*arguments)

    cell, node = _nodes(bench)
    _begin(cell, node, tmp_path, left=0)
    assert bench.until(lambda: not node.streams.missing(node.now()))
    monkeypatch.setattr(goal_module, "analyse", analyse_slowly)
    goal = IdentifyStiffness.Goal(output=str(tmp_path), poses="kinematic")
    handle = bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)
    assert bench.until(began.is_set)
    assert bench.until(handle.cancel_goal_async().done)
    bench.spin(0.1)
    go_on.set()
    result = bench.result(handle).result
    assert result.message == f"cancelled; 60 of 60 poses are kept: call again with output {tmp_path} to go on"
    assert not (tmp_path / "summary.json").exists()
    assert len(read(tmp_path / "samples.jsonl").samples) == 60


def test_an_axis_that_is_not_determined_names_no_stiffness_file(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A grasp of membranes whose friction hides the stiffness along x: there is a membrane map, and no stiffness."""
    found = analyse(toy_dataset(np.random.default_rng(0)), "kinematic")
    cell, node = _nodes(bench)
    _begin(cell, node, tmp_path, left=0)
    assert bench.until(lambda: not node.streams.missing(node.now()))
    monkeypatch.setattr(goal_module, "analyse", lambda *_: found)
    goal = IdentifyStiffness.Goal(output=str(tmp_path), poses="kinematic")
    result = bench.result(bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)).result
    assert (result.success, result.stiffness_file) == (True, "")
    command = [sys.executable, "-m", "seed_bringup.commands.dispatch", "identify", "--live", "--out", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert bench.until(lambda: process.poll() is not None, 60.0)
        assert process.stdout is not None
        said = process.stdout.read()
    assert process.returncode == 1
    assert "no stiffness.yaml is written: an axis is not determined" in said
    assert f"left in {tmp_path}: membrane_map.previous.yaml, membrane_map.yaml, report.html, samples.jsonl" in said


def test_the_command_asks_the_node_in_the_namespace_that_it_names(bench: Bench, tmp_path: Path) -> None:
    (node,) = describe(ROOT / "launch/identify_launch.xml", {"robot": "real", "namespace": "left"}).nodes
    assert (node.namespace, node.name) == ("/left", "sysid")
    bench.add(lambda **given: SysidNode(namespace=node.namespace, **given), **SENSOR, **QUICK)
    command = [sys.executable, "-m", "seed_bringup.commands.dispatch", "identify", "--live", "--namespace", "left"]
    with subprocess.Popen([*command, "--out", str(tmp_path)], stderr=subprocess.PIPE, text=True) as process:
        assert bench.until(lambda: process.poll() is not None, 60.0)
        assert process.stderr is not None
        assert "seed identify: cannot start: " in process.stderr.read()  # the node's words: it has no cell around it


def test_cancelling_holds_and_keeps_what_was_measured(bench: Bench, tmp_path: Path) -> None:
    cell, node = _nodes(bench)
    assert bench.until(lambda: not node.streams.missing(node.now()))
    goal = IdentifyStiffness.Goal(output=str(tmp_path))
    handle = bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)
    file = tmp_path / "samples.jsonl"
    assert bench.until(lambda: file.exists() and file.read_text().count('"sample"') >= 2, 60.0)
    future = handle.cancel_goal_async()
    assert bench.until(future.done)
    result = bench.result(handle).result
    assert not result.success
    assert "cancelled" in result.message
    before = cell.X_WE.copy()
    bench.spin(0.3)
    np.testing.assert_array_equal(cell.X_WE, before)
    assert len(read(file).samples) >= 2


def test_a_goal_that_names_no_folder_gets_one_of_its_own(bench: Bench, tmp_path: Path) -> None:
    _, node = _nodes(bench, output=str(tmp_path))
    assert bench.until(lambda: not node.streams.missing(node.now()))
    handle = bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", IdentifyStiffness.Goal())
    assert bench.until(handle.cancel_goal_async().done)
    message = bench.result(handle).result.message
    (folder,) = tmp_path.glob("identify-2*")
    assert f"0 of 60 poses are kept: call again with output {folder} to go on" in message


def test_an_interrupted_command_says_how_it_goes_on(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, node = _nodes(bench)
    assert bench.until(lambda: not node.streams.missing(node.now()))
    monkeypatch.delenv("SEED_ROOT", raising=False)
    monkeypatch.chdir(tmp_path)
    first = _command(bench)
    (folder,) = (tmp_path / "results").glob("identify-2*")
    assert f"results go to {folder}; if it is interrupted, --out {folder} goes on" in first
    assert f"0 of 60 poses are kept: call again with output {folder} to go on" in first
    again = _command(bench, "--out", str(folder))
    assert f"results go to {folder}; the run that has samples there goes on; a new grasp wants another folder" in again


def _command(bench: Bench, *more: str) -> str:
    """What ./seed identify --live says when it is interrupted as its first pose is visited."""
    command = [sys.executable, "-m", "seed_bringup.commands.dispatch", "identify", "--live", *more]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    said: list[str] = []
    reader = threading.Thread(target=lambda: said.extend(process.stderr or ()))
    reader.start()
    assert bench.until(lambda: "pose 0 of 60" in "".join(said), 30.0), said
    process.send_signal(signal.SIGINT)
    assert bench.until(lambda: process.poll() is not None, 30.0)
    reader.join()
    return "".join(said)


def test_an_arm_that_holds_ends_the_goal_and_is_not_measured(bench: Bench, tmp_path: Path) -> None:
    _, node = _nodes(bench)
    told = bench.client.create_publisher(String, "arm_hold_reason", LATCHED)
    told.publish(String(data=""))
    assert bench.until(lambda: not node.streams.missing(node.now()))
    goal = IdentifyStiffness.Goal(output=str(tmp_path))
    handle = bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)
    bench.spin(0.3)
    told.publish(String(data="protective stop"))
    result = bench.result(handle).result
    assert "the arm holds: protective stop; 0 of " in result.message
    again = bench.result(bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)).result
    assert again.message == "cannot start: the arm holds: protective stop"


def test_a_goal_that_is_refused_does_not_zero_the_sensor(bench: Bench, tmp_path: Path) -> None:
    cell, node = _nodes(bench)
    told = bench.client.create_publisher(String, "arm_hold_reason", LATCHED)
    assert bench.until(lambda: not node.streams.missing(node.now()))
    goal = IdentifyStiffness.Goal(output=str(tmp_path), zero_sensor=True)
    first = bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)
    assert bench.until((tmp_path / "samples.jsonl").exists)
    zero = cell._zero
    second = bench.result(bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)).result
    assert second.message == "an identification is running: cancel it first"
    told.publish(String(data="protective stop"))
    assert "the arm holds" in bench.result(first).result.message
    third = bench.result(bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)).result
    assert third.message == "cannot start: the arm holds: protective stop"
    assert cell._zero is zero


def test_a_run_that_goes_on_keeps_the_zero_of_its_sensor(bench: Bench, tmp_path: Path) -> None:
    """Interrupted at a pose that loads the sensor, that load would be the zero of the poses to come."""
    cell, node = _nodes(bench)
    _begin(cell, node, tmp_path)
    assert bench.until(lambda: not node.streams.missing(node.now()))
    zero = cell._zero
    goal = IdentifyStiffness.Goal(output=str(tmp_path), zero_sensor=True)
    handle = bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)
    assert bench.until(lambda: node._moving is not None)
    assert bench.until(handle.cancel_goal_async().done)
    assert "cancelled" in bench.result(handle).result.message
    assert cell._zero is zero
    other = IdentifyStiffness.Goal(output=str(tmp_path / "other"), zero_sensor=True)
    handle = bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", other)
    assert bench.until(handle.cancel_goal_async().done)
    assert "cancelled" in bench.result(handle).result.message
    assert cell._zero is not zero  # of a new one it is taken


def test_an_empty_file_of_samples_is_begun_with_a_zero_of_the_sensor(bench: Bench, tmp_path: Path) -> None:
    """As without zero_sensor: a disk that was full, or a crash, may leave one."""
    cell, node = _nodes(bench)
    assert bench.until(lambda: not node.streams.missing(node.now()))
    (tmp_path / "samples.jsonl").touch()
    zero = cell._zero
    goal = IdentifyStiffness.Goal(output=str(tmp_path), zero_sensor=True)
    handle = bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)
    assert bench.until(handle.cancel_goal_async().done)
    assert "cancelled" in bench.result(handle).result.message
    assert cell._zero is not zero


def test_a_bag_that_is_begun_late_has_the_samples_of_the_last_run_alone(bench: Bench, tmp_path: Path) -> None:
    """One with those of the run before as well would be refused: it holds two identifications."""
    _, node = _nodes(bench)
    assert bench.until(lambda: not node.streams.missing(node.now()))
    for name in ("first", "second"):
        goal = IdentifyStiffness.Goal(output=str(tmp_path / name))
        handle = bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)
        assert bench.until(handle.cancel_goal_async().done)
        assert "cancelled" in bench.result(handle).result.message
    lines: list[str] = []
    bench.client.create_subscription(String, "identification/samples", lambda m: lines.append(m.data), LINES)
    assert bench.until(lambda: lines)
    bench.spin(0.5)
    assert lines == (tmp_path / "second" / "samples.jsonl").read_text().splitlines()


def test_a_sensor_that_does_not_answer_ends_the_goal(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(node_module, "ZERO_PATIENCE", 0.5)
    node = bench.add(SysidNode, **SENSOR, **QUICK)
    sensor = Node("sensor", context=bench.context)  # that nobody spins
    sensor.create_service(Trigger, "ft_sensor/zero", lambda _, response: response)
    assert bench.until(node._zero.service_is_ready)
    goal = IdentifyStiffness.Goal(output=str(tmp_path), zero_sensor=True)
    first = bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)
    assert bench.until(lambda: node._starting)
    second = bench.result(bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)).result
    assert second.message == "an identification is running: cancel it first"
    message = bench.result(first).result.message
    assert message == "ft_sensor/zero has not answered for 0.5 s: is the sensor's driver running?"
    assert not node._starting
    sensor.destroy_node()


@pytest.mark.parametrize(("given", "frame"), [("", "ft_sensor"), ("wrist", "wrist")])
def test_wrenches_of_another_frame_are_refused(bench: Bench, given: str, frame: str) -> None:
    node = bench.add(SysidNode, **SENSOR, sensor_frame=given)
    loads = bench.client.create_publisher(WrenchStamped, "ft_sensor/wrench", QUEUE)
    told = {"ft_sensor": 1.0}
    bench.every.append(lambda: [loads.publish(wrench_stamped(pressed(f), 0.0, name)) for name, f in told.items()])
    if not given:
        assert bench.until(lambda: node.streams.wrenches)
        told["wrist"] = 2.0
    assert bench.until(lambda: node.counters["wrenches_refused"])
    assert f"ft_sensor/wrench.header.frame_id = '{'ft_sensor' if given else 'wrist'}' is unknown here" in (
        node.counters.last
    )
    assert f"known: {frame}" in node.counters.last
    assert {w[5] for w in node.streams.wrenches} == (set() if given else {1.0})


def pressed(force: float) -> Wrench:
    return Wrench(np.zeros(3), np.array([0.0, 0.0, force]))


def test_a_file_of_the_whole_hand_is_taken(bench: Bench) -> None:
    node = bench.add(SysidNode, **SENSOR, hand__name="mine", tool__mass=0.3, grasp__translation=[800.0, 1200.0, 800.0])
    assert node.hand.name == "mine"


def test_a_pose_that_no_arm_has_is_refused(bench: Bench) -> None:
    node = bench.add(SysidNode, **SENSOR, **QUICK)
    poses = bench.client.create_publisher(PoseStamped, "current_pose", QUEUE)
    far = pose_stamped(make_pose(None, (0.4, 1e9, 0.3)), 0.0, "base")
    bench.every.append(lambda: poses.publish(far))
    assert bench.until(lambda: node.counters["poses_refused"])
    assert "1e+09 m from the base: no arm reaches 10 m" in node.counters.last
    assert node.streams.X_WE is None


def test_a_folder_that_cannot_be_written_is_told(bench: Bench, tmp_path: Path) -> None:
    _, node = _nodes(bench)
    assert bench.until(lambda: not node.streams.missing(node.now()))
    (tmp_path / "file").write_text("no folder")
    goal = IdentifyStiffness.Goal(output=str(tmp_path / "file" / "hand1"))
    result = bench.result(bench.send_goal(IdentifyStiffness, "sysid/identify_stiffness", goal)).result
    assert not result.success
    assert "Not a directory" in result.message


def test_without_a_sensor_the_goal_is_refused_in_words(bench: Bench, tmp_path: Path) -> None:
    bench.add(SysidNode, **SENSOR, **QUICK)
    handle = bench.send_goal(
        IdentifyStiffness, "sysid/identify_stiffness", IdentifyStiffness.Goal(output=str(tmp_path))
    )
    result = bench.result(handle).result
    assert not result.success
    assert "current_pose never came" in result.message
    assert not (tmp_path / "samples.jsonl").exists()

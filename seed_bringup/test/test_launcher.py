# SPDX-License-Identifier: Apache-2.0
"""The launcher with real processes: nothing survives it, and nothing dies in silence."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from seed_bringup.launching.launcher import Launch
from seed_bringup.launching.process import without_interrupts

pytestmark = pytest.mark.realtime
PROGRAMS = {
    "sleeper": "trap 'exit 0' INT\nwhile :; do sleep 0.1; done",
    "parent": "sleep 300 &\necho $! > \"$CHILD\"\ntrap 'exit 0' INT\nwhile :; do sleep 0.1; done",
    "stubborn": "trap '' INT TERM\nwhile :; do sleep 0.1; done",
    "slow_to_end": "trap 'sleep 2; echo written; exit 0' INT\necho up\nwhile :; do sleep 0.1; done",
    "noting": "trap 'sleep 2; touch \"$SEED_TEST_MARK/ended\"; exit 0' INT\nwhile :; do sleep 0.1; done",
    "dying": "sleep 0.2; echo last words; exit 7",
    "finishing": "echo done",
    "starting": f"exec {sys.executable} -c 'import time; print(\"up\", flush=True); time.sleep(60)'",
    "says": 'echo "$*"; for last; do :; done; cat "$last"',
}


@pytest.fixture
def cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package `cell` with the programs above; every process it starts carries a mark in its environment."""
    (tmp_path / "share/ament_index/resource_index/packages").mkdir(parents=True)
    (tmp_path / "share/ament_index/resource_index/packages/cell").touch()
    (tmp_path / "lib/cell").mkdir(parents=True)
    for name, body in PROGRAMS.items():
        program = tmp_path / "lib/cell" / name
        program.write_text(f"#!/bin/sh\n{body}\n")
        program.chmod(0o755)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.setenv("CHILD", str(tmp_path / "child"))
    monkeypatch.setenv("SEED_TEST_MARK", str(tmp_path))
    return tmp_path


def launch_file(folder: Path, *nodes: str) -> Path:
    file = folder / "under_test_launch.xml"
    lines = [f'<node pkg="cell" {node}/>' for node in nodes]
    file.write_text("\n".join(["<launch>", *lines, "</launch>"]))
    return file


def marked_processes(folder: Path) -> list[int]:
    """Living processes below this test, but this one."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            environment = (entry / "environ").read_bytes()
            state = (entry / "stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            continue
        if f"SEED_TEST_MARK={folder}".encode() in environment and state != "Z" and int(entry.name) != os.getpid():
            found.append(int(entry.name))
    return found


def eventually_none_left(folder: Path, patience: float) -> bool:
    deadline = time.monotonic() + patience
    while marked_processes(folder) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not marked_processes(folder)


def start_cli(file: Path) -> subprocess.Popen[str]:
    """The command line in a process of its own, up and running."""
    code = "import sys; from seed_bringup.commands.launch import main; sys.exit(main(sys.argv[1:]))"
    process = subprocess.Popen(
        [sys.executable, "-c", code, "--own", str(file)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdout is not None
    while "nodes running" not in process.stdout.readline():
        assert process.poll() is None
    return process


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
def test_interrupt_ends_nodes_and_their_children(cell: Path, number: signal.Signals) -> None:
    process = start_cli(launch_file(cell, 'exec="sleeper"', 'exec="parent"'))
    time.sleep(0.3)
    assert len(marked_processes(cell)) >= 4  # launcher, two nodes, one node's child
    process.send_signal(number)
    assert process.wait(timeout=5.0) == 128 + number
    assert eventually_none_left(cell, 0.5)


def test_interrupt_ends_even_the_stubborn_within_five_seconds(cell: Path) -> None:
    process = start_cli(launch_file(cell, 'exec="stubborn" name="mule"', 'exec="sleeper"'))
    time.sleep(0.3)
    assert len(marked_processes(cell)) >= 3
    started = time.monotonic()
    process.send_signal(signal.SIGINT)
    output = process.communicate(timeout=6.0)[0]
    assert time.monotonic() - started < 5.0
    assert "mule still running after 4.5 s: SIGKILL" in output
    assert not marked_processes(cell)


@pytest.mark.parametrize("name", ["controller", "camera"])
def test_ctrl_c_says_what_becomes_of_arm_and_nodes(cell: Path, name: str) -> None:
    process = start_cli(launch_file(cell, f'exec="sleeper" name="{name}"'))
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    output = process.communicate(timeout=6.0)[0]
    arm = ": the arm stops where it is, and a tool is not lifted" if name == "controller" else ""
    assert output.splitlines()[-2:] == [f"[launch] stopping{arm}", "[launch] every node has ended"]


def test_ctrl_c_lets_nodes_end_by_themselves_though_nobody_reads_the_output(cell: Path) -> None:
    ended = cell / "ended"
    process = start_cli(launch_file(cell, 'exec="noting" name="camera"'))
    time.sleep(0.3)
    assert process.stdout is not None
    process.stdout.close()
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=6.0) == 141
    assert eventually_none_left(cell, 5.0)
    assert ended.exists()


def test_a_node_has_as_long_to_end_as_it_asks_for(cell: Path) -> None:
    said: list[str] = []
    hasty, slow = 'exec="stubborn" name="hasty" sigterm_timeout="0.1"', 'exec="slow_to_end" sigterm_timeout="9.0"'
    with Launch(launch_file(cell, hasty, slow), output=lambda _, line: said.append(line)):
        deadline = time.monotonic() + 5.0
        while "up" not in said and time.monotonic() < deadline:
            time.sleep(0.05)
    told = [line for line in said if "still running" in line]
    assert told == ["hasty still running after 0.1 s: SIGTERM", "hasty still running after 1.6 s: SIGKILL"]
    assert "written" in said


def test_nodes_do_not_outlive_a_killed_launcher(cell: Path) -> None:
    process = start_cli(launch_file(cell, 'exec="stubborn"', 'exec="parent"'))
    time.sleep(0.3)
    assert len(marked_processes(cell)) >= 4
    process.kill()
    process.wait()
    assert eventually_none_left(cell, 5.0)


def test_death_of_one_node_ends_the_run_with_its_name(cell: Path) -> None:
    process = start_cli(launch_file(cell, 'exec="dying" name="gripper"', 'exec="sleeper"'))
    output = process.communicate(timeout=5.0)[0]
    assert process.returncode == 1
    assert "[gripper] last words" in output
    assert "[launch] gripper died with exit code 7" in output
    assert not marked_processes(cell)


def test_killed_node_ends_the_run_with_its_signal(cell: Path) -> None:
    lines: list[str] = []
    launch = Launch(
        launch_file(cell, 'exec="sleeper" name="a"'), output=lambda who, line: lines.append(f"{who}: {line}")
    )
    launch.start()
    os.kill(launch.nodes[0].process.pid, signal.SIGKILL)
    assert launch.wait(timeout=5.0) == 1
    assert any("a died with exit code -9, signal SIGKILL" in line for line in lines)


def test_finished_node_leaves_the_others_running_unless_it_must_live(cell: Path) -> None:
    with Launch(launch_file(cell, 'exec="finishing"', 'exec="sleeper"')) as launch:
        assert launch.wait(timeout=0.5) is None
        assert [n.node.label for n in launch.nodes] == ["sleeper"]
    with Launch(launch_file(cell, 'exec="finishing" on_exit="shutdown"', 'exec="sleeper"')) as launch:
        assert launch.wait(timeout=5.0) == 1
    assert not marked_processes(cell)


def test_run_of_finishing_nodes_ends_well(cell: Path) -> None:
    assert Launch(launch_file(cell, 'exec="finishing"', 'exec="finishing" name="b"')).start().wait(timeout=5.0) == 0


def test_respawned_node_starts_again(cell: Path) -> None:
    lines: list[str] = []
    file = launch_file(cell, 'exec="dying" respawn="true" respawn_delay="0.1"')
    with Launch(file, output=lambda _, line: lines.append(line)) as launch:
        launch.wait(timeout=1.0)
    assert lines.count("last words") >= 2


def test_parameters_reach_the_node_in_a_file(cell: Path) -> None:
    lines: list[str] = []
    file = cell / "under_test_launch.xml"
    file.write_text(
        '<launch><node pkg="cell" exec="says" name="n" namespace="left"><remap from="a" to="b"/>'
        '<param name="rate" value="2.0"/></node></launch>'
    )
    Launch(file, output=lambda _, line: lines.append(line)).start().wait(timeout=5.0)
    assert lines[0].startswith("--ros-args -r __node:=n -r __ns:=/left -r a:=b --params-file")
    assert yaml.safe_load("\n".join(lines[1:4])) == {"/left/n": {"ros__parameters": {"rate": 2.0}}}


def test_a_node_that_is_stopped_while_it_starts_leaves_no_traceback(cell: Path) -> None:
    said: list[str] = []
    with Launch(launch_file(cell, 'exec="starting"'), output=lambda _, line: said.append(line)):
        deadline = time.monotonic() + 20.0
        while "up" not in said and time.monotonic() < deadline:
            time.sleep(0.02)
    assert said == ["up"]


def test_only_an_interrupt_of_ours_is_left_out() -> None:
    trace = ["Traceback (most recent call last):", '  File "x.py", line 1', "    go()"]
    interrupt, error = [*trace, "KeyboardInterrupt"], [*trace, "ValueError: 3"]
    assert list(without_interrupts(["a", *interrupt, "b"], lambda: True)) == ["a", "b"]
    assert list(without_interrupts(["a", *error, *trace], lambda: True)) == ["a", *error, *trace]
    assert list(without_interrupts(interrupt, lambda: False)) == interrupt
    fatal = [
        "Fatal Python error: init_import_site: Failed to import the site module",
        "Python runtime state: initialized",
    ]
    assert not list(without_interrupts([*fatal, *interrupt], lambda: True))
    importing = [
        *trace,
        '  File "<frozen importlib._bootstrap>", line 1176, in _find_and_load',
        "ImportError: numpy",
        "in words",
    ]
    assert not list(without_interrupts(importing, lambda: True))
    assert list(without_interrupts(importing, lambda: False)) == importing

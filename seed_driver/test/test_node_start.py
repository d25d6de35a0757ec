# SPDX-License-Identifier: Apache-2.0
"""Nodes that start wrongly say why and stay up; nodes that end leave nothing behind."""

import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed")
pytest.importorskip("tf2_msgs", reason="the workspace is not built (./seed test does it)")
pytest.importorskip("rtde_control", reason="ur_rtde is not installed (pip install ur-rtde==1.6.5)")

from seed_testing.fault_bench.bench import leftover_processes
from seed_ur.standin_client import StandIn, private_host

pytestmark = pytest.mark.ros


class Node:
    """A driver node and what it has said."""

    def __init__(self, tmp_path, *parameters: str) -> None:
        self.file = tmp_path / "said"
        arguments = [part for p in parameters for part in ("-p", p)]
        with self.file.open("w") as out:
            command = [sys.executable, "-m", "seed_driver.ros.node", "--ros-args", *arguments]
            self.process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)

    def says(self, text: str, within: float = 60.0) -> bool:
        until = time.monotonic() + within
        while time.monotonic() < until and text not in self.file.read_text():
            time.sleep(0.05)
        return text in self.file.read_text()

    def end(self) -> int:
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(10.0)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ([], "robot_ip is empty"),
        (["robot_ip:=127.0.0.9", "max_speed:=9.0"], "max_speed = 9 m/s must be within 0.001 and 1 m/s"),
        (["robot_ip:=127.0.0.9", "max_speed:=fast"], "max_speed = 'fast' must be a number"),
        (
            ["robot_ip:=127.0.0.9", "calibration_file:=/nowhere.yaml"],
            "calibration_file = '/nowhere.yaml' does not exist",
        ),
    ],
    ids=["no-address", "too-fast", "wrong-type", "no-calibration"],
)
def test_a_wrong_parameter_is_named_and_the_node_stays(tmp_path, parameters, message) -> None:
    node = Node(tmp_path, *parameters)
    assert node.says(message), node.file.read_text()
    assert node.process.poll() is None
    assert node.end() == 0


def test_a_parameter_that_does_not_exist_is_named(tmp_path) -> None:
    node = Node(tmp_path, "robot_ip:=127.0.0.9", "max_sped:=0.1")
    assert node.says("driver has no parameter 'max_sped'; did you mean max_speed"), node.file.read_text()
    assert node.process.wait(10.0) == 1


def test_a_priority_of_the_loop_out_of_bounds_ends_the_node(tmp_path) -> None:
    """It is read-only: nothing could be corrected."""
    node = Node(tmp_path, "robot_ip:=127.0.0.9", "loop_priority:=99")
    assert node.process.wait(60.0) == 1
    assert "error: driver: loop_priority = 99 must be within 0 and 98" in node.file.read_text()


def test_an_autostart_that_is_no_bool_is_named_without_a_trace(tmp_path) -> None:
    node = Node(tmp_path, "robot_ip:=127.0.0.9", "autostart:=1")
    assert node.process.wait(60.0) == 1
    said = node.file.read_text()
    assert "error: " in said
    assert "'autostart' to '1' of type 'INTEGER', expecting type 'BOOL'" in said
    assert "Traceback" not in said


def test_a_node_without_a_robot_waits_and_ends_on_interrupt(tmp_path) -> None:
    host = private_host()
    node = Node(tmp_path, f"robot_ip:={host}")
    assert node.says(f"no controller at {host}:30004"), node.file.read_text()
    with StandIn(host):
        assert node.says("ready: following target_frame"), node.file.read_text()
        children = leftover_processes(node.process.pid)
        assert len(children) == 1
        assert node.end() == 0
        assert leftover_processes(node.process.pid) == []


def test_a_node_that_is_killed_takes_its_servo_process_along(tmp_path) -> None:
    with StandIn() as robot:
        node = Node(tmp_path, f"robot_ip:={robot.host}")
        assert node.says("ready: following target_frame"), node.file.read_text()
        node.process.kill()
        node.process.wait()
        time.sleep(1.0)
        assert robot.ask("state")["runtime_state"] == 1  # the robot has stopped by itself
        assert robot.ask("state")["clients"].get("rtde", 0) == 0

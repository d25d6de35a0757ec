# SPDX-License-Identifier: Apache-2.0
"""The operator page of a cell whose arm is a UR: what it is called, why it holds, and that Stop reaches its driver."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("viser", reason="needs viser (./seed test has it)")
pytest.importorskip("pydrake", reason="needs Drake")
pytest.importorskip("rtde_control", reason="needs ur_rtde")

from seed_bringup.launching.launcher import Launch
from seed_bringup.page.visitor import Visitor
from seed_ur.standin_client import private_host

ROOT = Path(__file__).resolve().parents[2]
HOST = private_host()
pytestmark = pytest.mark.ros


@pytest.fixture(scope="module")
def page() -> Iterator[Visitor]:
    """Of a stand-in with the simulated gripper."""
    lines: list[str] = []
    told = threading.Event()

    def hear(label: str, line: str) -> None:
        lines.append(f"[{label}] {line}")
        if label == "page" and "http://" in line:
            told.set()

    arguments = {"robot": "ur", "robot_ip": HOST, "method": "truth", "view": "true", "view_port": "0", "links": "false"}
    with Launch(ROOT / "seed_bringup/launch/cell_launch.xml", arguments, output=hear):
        assert told.wait(60.0), lines
        with Visitor(next(line for line in lines if "http://" in line).split()[-1]) as visitor:
            yield visitor


def comes(condition: Callable[[], Any], patience: float) -> bool:
    deadline = time.monotonic() + patience
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.1)
    return True


def until(condition: Callable[[], Any], page: Visitor) -> None:
    assert comes(condition, 60.0), page.words


def enable(page: Visitor) -> None:
    """Press it until the cell is ready: a pause of a busy machine meanwhile is a hold, as it has to be."""
    for _ in range(6):
        page.press("Enable")
        if comes(lambda: "Ready" in page.words and "arm holds" not in page.words, 10.0):
            return
    raise AssertionError(page.words)


def test_the_arm_is_told_by_model_and_address(page: Visitor) -> None:
    until(lambda: f"arm UR5e, stand-in at {HOST}" in page.words, page)


def test_stop_reaches_the_driver_whose_reason_is_read_and_enable_ends_it(page: Visitor) -> None:
    until(lambda: "Not enabled" in page.words or "Arm holds" in page.words, page)  # a pause of a busy machine holds it
    page.press("Grasp")
    until(lambda: "grasped the squeegee" in page.words, page)
    enable(page)
    page.press("STOP")
    until(lambda: "Stop: driver comes to rest" in page.words and "Stop: controller comes to rest" in page.words, page)
    until(lambda: "Arm holds Stopped on request. Nothing is wrong." in page.words, page)
    until(lambda: "arm holds stopped on request" in page.words, page)
    enable(page)

# SPDX-License-Identifier: Apache-2.0
"""The unmodified ur_rtde wheel against the stand-in: what connects, moves and fails as on a robot."""

import itertools
import json
import socket
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

from seed_core.errors import SeedError
from seed_ur import rtde
from seed_ur.standin.controller import Controller
from seed_ur.standin.options import PLANT_PORT, SCRIPT_PORTS, SIDE_PORT, Options
from seed_ur.standin_client import StandIn

pytestmark = pytest.mark.realtime
pytest.importorskip("rtde_control", reason="ur_rtde is not installed (pip install ur-rtde==1.6.5)")

HEAD = """
import json, os, sys, time
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface
from seed_ur.standin_client import StandIn
host = sys.argv[1]
robot = StandIn.__new__(StandIn); robot.host = host
out = {}
receive = RTDEReceiveInterface(host)
control = RTDEControlInterface(host)
"""
TAIL = """
print("RESULT" + json.dumps(out), flush=True)
os._exit(0)
"""


def client(robot: StandIn, body: str, timeout: float = 60.0) -> dict:
    """Run a ur_rtde program in a process of its own (the library may crash); what it put into `out`."""
    code = HEAD + textwrap.dedent(body) + TAIL
    done = subprocess.run([sys.executable, "-c", code, robot.host], capture_output=True, text=True, timeout=timeout)
    lines = [line for line in done.stdout.splitlines() if line.startswith("RESULT")]
    assert lines, f"exit code {done.returncode}: {done.stdout[-500:]} {done.stderr[-2000:]}"
    return json.loads(lines[-1].removeprefix("RESULT"))


@pytest.mark.parametrize("version", ["3.15.8", "5.4.2", "5.9.4", "5.12.4", "5.23.0", "5.26.0", "10.10.0"])
def test_every_polyscope_connects_streams_and_stops(version: str) -> None:
    with StandIn(None, "--version", version) as robot:
        out = client(
            robot,
            """
            pose = receive.getActualTCPPose()
            for i in range(100):
                goal = list(pose); goal[2] += 0.0001 * i
                assert control.servoL(goal, 0, 0, 0.002, 0.05, 300)
                time.sleep(0.004)
            for i in range(50):
                control.servoL(goal, 0, 0, 0.002, 0.05, 300); time.sleep(0.01)
            out["stopped"] = control.servoStop()
            time.sleep(0.1)
            out["rise"] = receive.getActualTCPPose()[2] - pose[2]
            out["moved"] = control.moveL(pose, 0.2, 1.0)
            """,
        )
        assert out["stopped"]
        assert out["moved"]
        assert out["rise"] == pytest.approx(0.0099, abs=2e-4)


def test_commands_of_the_control_script_answer_as_a_robot_does() -> None:
    with StandIn() as robot:
        out = client(
            robot,
            """
            pose, q = receive.getActualTCPPose(), receive.getActualQ()
            out["ik"] = max(abs(a - b) for a, b in zip(control.getInverseKinematics(pose, q), q))
            out["fk"] = max(abs(a - b) for a, b in zip(control.getForwardKinematics(q, [0, 0, 0.1, 0, 0, 0]), pose))
            far = [3.0, 0, 0, 0, 0, 0]
            out["has"] = control.getInverseKinematicsHasSolution(pose), control.getInverseKinematicsHasSolution(far)
            out["joint"] = control.moveJ([t + 0.1 for t in q], 1.0, 2.0)
            out["q"] = max(abs(a - b - 0.1) for a, b in zip(receive.getActualQ(), q))
            control.setTcp([0, 0, 0.1, 0, 0, 0]); out["tcp"] = control.getTCPOffset()[2]
            control.setTcp([0, 0, 0, 0, 0, 0])
            control.setPayload(1.5, [0, 0, 0.05]); out["payload"] = robot.ask("state")["payload"]
            control.speedL([0, 0, 0.05, 0, 0, 0], 1.0); time.sleep(0.4)
            out["speed"] = receive.getActualTCPSpeed()[2]; out["speedstop"] = control.speedStop()
            start = time.time(); out["async"] = control.moveJ(q, 0.5, 1.0, True); out["returned"] = time.time() - start
            while control.getAsyncOperationProgress() >= 0 and time.time() - start < 10: time.sleep(0.01)
            time.sleep(0.05)
            out["back"] = max(abs(a - b) for a, b in zip(receive.getActualQ(), q))
            """,
        )
    assert out["ik"] < 1e-6
    assert out["fk"] == pytest.approx(0.1, abs=1e-3)
    assert out["has"] == [True, False]
    assert out["joint"]
    assert out["q"] < 1e-3
    assert out["tcp"] == pytest.approx(0.1)
    assert out["payload"] == 1.5
    assert out["speed"] == pytest.approx(0.05, abs=2e-3)
    assert out["speedstop"]
    assert out["async"]
    assert out["returned"] < 0.5
    assert out["back"] < 1e-3


def test_a_script_sent_again_finds_the_old_command_and_moves() -> None:
    """The hazard that the driver has to close; if the stand-in lost it, the driver's test would prove nothing."""
    with StandIn() as robot:
        out = client(
            robot,
            """
            pose = receive.getActualTCPPose()
            far = list(pose); far[1] += 0.05
            control.servoL(far, 0, 0, 0.002, 0.2, 100)
            time.sleep(0.01)
            robot.ask("pendant_stop")
            time.sleep(0.3)
            stopped = receive.getActualTCPPose()[1]
            control.reuploadScript()
            time.sleep(1.5)
            out["jump"] = receive.getActualTCPPose()[1] - stopped
            """,
        )
        assert out["jump"] > 0.03


def test_protective_stop_unlocks_after_its_time_and_the_watchdog_ends_the_program() -> None:
    with StandIn(None, "--unlock-after", "0.5") as robot:
        out = client(
            robot,
            """
            from dashboard_client import DashboardClient
            dashboard = DashboardClient(host); dashboard.connect()
            robot.ask("protective_stop"); time.sleep(0.05)
            out["stopped"] = receive.isProtectiveStopped()
            try:
                dashboard.unlockProtectiveStop(); out["early"] = "accepted"
            except RuntimeError as error:
                out["early"] = str(error)
            time.sleep(0.6); dashboard.unlockProtectiveStop(); time.sleep(0.05)
            out["after"] = receive.isProtectiveStopped()
            control.servoStop()
            out["again"] = control.reuploadScript(); time.sleep(0.2)
            out["watchdog"] = control.setWatchdog(20)
            time.sleep(0.3)
            out["runtime"] = receive.getRuntimeState()
            """,
        )
    assert out["stopped"] is True
    assert "5s" in out["early"]
    assert out["after"] is False
    assert out["watchdog"]
    assert out["runtime"] == 1


def test_moving_while_servoing_ends_the_program_and_so_does_an_unreachable_pose() -> None:
    with StandIn() as robot:
        out = client(
            robot,
            """
            pose = receive.getActualTCPPose()
            control.servoL(pose, 0, 0, 0.002, 0.1, 300); time.sleep(0.05)
            out["move"] = control.moveL(pose, 0.1, 0.5)
            time.sleep(0.1)
            out["runtime"] = receive.getRuntimeState()
            control.reuploadScript(); time.sleep(0.2)
            control.servoL([2.0, 0, 0, 0, 0, 0], 0, 0, 0.002, 0.1, 300); time.sleep(0.1)
            out["unreachable"] = receive.getRuntimeState()
            """,
        )
        messages = robot.ask("state")["messages"]
    assert not out["move"]
    assert out["runtime"] == 1
    assert out["unreachable"] == 1
    assert any("Another thread" in m for m in messages)
    assert any("out of reach" in m for m in messages)


def test_a_virtual_wall_pushes_back() -> None:
    with StandIn() as robot:
        height = robot.ask("state")["tcp_pose"][2]
        robot.ask("wall", z=height, stiffness=2000.0)
        out = client(
            robot,
            """
            pose = receive.getActualTCPPose(); goal = list(pose); goal[2] -= 0.01
            control.moveL(goal, 0.1, 0.5); time.sleep(0.1)
            out["force"] = receive.getActualTCPForce()[2]
            """,
        )
    assert out["force"] == pytest.approx(20.0, abs=0.5)


def test_a_wall_presses_on_the_tcp_without_a_torque_about_it() -> None:
    """A load on the flange beside it has one: 3 N along z of a flange that looks down, 0.1 m beside the TCP."""
    with StandIn(None, "--version", "3.15.8") as robot:
        robot.ask("tool", tcp=[0.1, 0.0, 0.2, 0.0, 0.0, 0.0])
        robot.ask("wall", z=robot.ask("state")["tcp_pose"][2] + 0.005, stiffness=2000.0)
        assert robot.ask("state")["wrench"] == pytest.approx([0.0, 0.0, 10.0, 0.0, 0.0, 0.0], abs=1e-6)
        robot.ask("wrench", wrench=[0.0, 0.0, -3.0, 0.0, 0.0, 0.0])
        *force, tx, ty, _ = robot.ask("state")["wrench"]
    assert force == pytest.approx([0.0, 0.0, 13.0], abs=0.02)
    assert (tx**2 + ty**2) ** 0.5 == pytest.approx(0.3, abs=0.01)


def test_an_e_series_tells_torque_about_the_flange() -> None:
    """10 N at a TCP that is 0.1 m aside; and a load on the flange, which has none."""
    with StandIn() as robot:
        robot.ask("tool", tcp=[0.1, 0.0, 0.2, 0.0, 0.0, 0.0])
        robot.ask("wrench", wrench=[0.0, 0.0, -3.0, 0.0, 0.0, 0.0])
        assert robot.ask("state")["wrench"][3:] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
        robot.ask("wrench", wrench=[0.0] * 6)
        robot.ask("wall", z=robot.ask("state")["tcp_pose"][2] + 0.005, stiffness=2000.0)
        *_, fz, tx, ty, _ = robot.ask("state")["wrench"]
    assert fz == pytest.approx(10.0, abs=1e-6)
    assert (tx**2 + ty**2) ** 0.5 == pytest.approx(1.0, abs=0.03)


def test_the_side_port_refuses_what_it_does_not_know() -> None:
    with StandIn() as robot:
        with pytest.raises(SeedError, match="unknown request; 'do' must be one of"):
            robot.ask("dance")
        with pytest.raises(SeedError, match=r"seconds = -1\.0 must be 0 to 3600"):
            robot.ask("freeze", seconds=-1)
        with pytest.raises(SeedError, match="must be stuck_ready"):
            robot.ask("switch", name="x")
        with pytest.raises(SeedError, match="finite"):
            robot.ask("wrench", wrench=[float("nan")] * 6)


@pytest.mark.parametrize(
    ("do", "given", "why"),
    [
        ("corrupt", {"name": "robot_mode", "value": float("nan")}, "value = nan must be a whole number for robot_mode"),
        ("corrupt", {"name": "safety_mode", "value": 1e12}, "value = 1000000000000.0 cannot be sent as INT32"),
        ("corrupt", {"name": "runtime_state", "value": -1}, "cannot be sent as UINT32, the kind of runtime_state"),
        ("corrupt", {"name": "actual_q", "index": 9, "value": 1.0}, "index = 9 must be a whole number from 0 to 5"),
        ("corrupt", {"name": "timestamp", "index": float("inf"), "value": 1.0}, "index = inf must be a whole number"),
        ("corrupt", {"name": "payload", "value": 10**400}, "too large"),
        ("play", {"name": "rtde_control", "offset": 100}, "register offset = 100 must be 0 to 24"),
        ("tool", {"cog": [0.0]}, "must be 3 numbers"),
    ],
)
def test_the_side_port_refuses_what_would_end_it(do: str, given: dict, why: str) -> None:
    with StandIn() as robot:
        with pytest.raises(SeedError, match=why):
            robot.ask(do, **given)
        robot.ask("play", name="rtde_control", seconds=0.1)
        time.sleep(0.1)
        assert robot.ask("state")["program"] == "rtde_control"


SCRIPTS = (
    b"def rtde_control():\n# float register offset 100\nend\n",
    b"def path():\n# inject move path\nmovel(p[a, b], a=1.2)\nend\n",
    b"sec voltage():\nset_tool_voltage(99999999999)\nend\n",
)


def test_nonsense_at_the_other_ports_does_not_end_it() -> None:
    nested = b"[" * 2000
    with StandIn() as robot:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plant:
            plant.sendto(nested, (robot.host, PLANT_PORT))
            plant.sendto(b'{"until": ' + b"1" * 400 + b"}", (robot.host, PLANT_PORT))
        with socket.create_connection((robot.host, SIDE_PORT)) as side:
            side.sendall(nested + b"\n")
            assert b"recursion" in side.recv(1000)
        for text in SCRIPTS:
            with socket.create_connection((robot.host, SCRIPT_PORTS[0])) as script:
                script.sendall(text)
        time.sleep(0.2)
        state = robot.ask("state")
    assert any(m.startswith("plant: maximum recursion depth") for m in state["messages"])
    assert state["uploads"] == 0
    assert state["tool_voltage"] == 0


def test_what_was_corrupted_is_sent_as_it_is_again() -> None:
    """A temperature does not change by itself, joint angles do."""
    with StandIn() as robot:
        out = client(
            robot,
            """
            def told():
                time.sleep(0.1)
                return receive.getJointTemperatures(), receive.getActualQ()
            out["before"] = told()
            for name in ("joint_temperatures", "actual_q"):
                robot.ask("corrupt", name=name, index=2, value=500.0)
            out["meanwhile"] = told()
            for name in ("joint_temperatures", "actual_q"):
                robot.ask("corrupt", name=name)
            out["after"] = told()
            """,
        )
    assert [numbers[2] for numbers in out["meanwhile"]] == [500.0, 500.0]
    assert out["after"] == out["before"]


def test_every_output_that_may_be_corrupted_can_be_sent() -> None:
    robot = Controller(Options())
    robot.tick(0.0)
    recipe = rtde.Recipe.of(rtde.OUTPUTS, rtde.OUTPUTS)
    values = [0, -1, 3, 200, 2**31, 2**63, 1.5, float("nan"), float("inf")]
    taken = 0
    for name, value in itertools.product(rtde.OUTPUTS, values):
        try:
            robot.faults.corrupt = {name: rtde.checked_number(name, 0, value)}
        except ValueError:
            continue
        taken += 1
        decoded = recipe.decode(recipe.encode(1, robot.outputs)[4:])
        number = decoded[name] if isinstance(decoded[name], int | float) else decoded[name][0]
        assert number == value or np.isnan(value) or rtde.OUTPUTS[name] == "BOOL"
    assert taken > 3 * len(rtde.OUTPUTS)


def test_two_robots_live_beside_each_other() -> None:
    with StandIn() as one, StandIn(None, "--model", "ur10e") as two:
        assert one.host != two.host
        one.ask("protective_stop")
        assert one.ask("state")["safety_mode"] == 3
        assert two.ask("state")["safety_mode"] == 1

# SPDX-License-Identifier: Apache-2.0
"""The side port: one JSON object per line in, one per line out. Faults, statistics, an outside view of the arm.

Requests are {"do": NAME, ...}; replies {"ok": true, ...} or {"ok": false, "error": TEXT}. See docs/ur_controller.md.
"""

import json
import os
import socket
import time
from collections import Counter
from collections.abc import Callable
from typing import Any, TypeAlias

from seed_core.errors import SeedError
from seed_ur import rtde
from seed_ur.pose import checked_pose, matrix_from_pose
from seed_ur.standin.channel import Channel, Network
from seed_ur.standin.controller import TOOL_BIT, Controller
from seed_ur.standin.options import PERIOD
from seed_ur.standin.script import (
    CONTROL_SCRIPT,
    LAST_OFFSET,
    OtherProgram,
    Script,
    ScriptChannel,
    register_offset,
)
from seed_ur.standin.server import Server

Request: TypeAlias = dict[str, Any]
Action: TypeAlias = Callable[[Server, Request], dict[str, Any] | None]
SERVO_L = 24  # number of servoL in the command register of ur_rtde's script


class SideChannel(Channel):
    """A connection to port 30099."""

    name, outside = "side", True

    def __init__(self, server: Server, connection: socket.socket, robot: Controller, network: Network) -> None:
        super().__init__(connection, robot, network)
        self.server = server

    def received(self) -> None:
        for line in self.lines():
            reply = answer(self.server, line)
            self.socket.setblocking(True)
            self.socket.settimeout(1.0)
            try:
                self.socket.sendall(reply)
                self.socket.setblocking(False)
            except OSError:
                self.open = False


def answer(server: Server, line: bytes) -> bytes:
    """The reply to one request line."""
    try:
        request = json.loads(line)
        if not isinstance(request, dict) or request.get("do") not in ACTIONS:
            raise ValueError(f"unknown request; 'do' must be one of {', '.join(sorted(ACTIONS))}")
        reply = ACTIONS[request["do"]](server, request) or {}
        return json.dumps({"ok": True, **reply}).encode() + b"\n"
    except (SeedError, ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
        return json.dumps({"ok": False, "error": str(error)}).encode() + b"\n"


def _seconds(request: Request) -> float:
    seconds = float(request.get("seconds", 1.0))
    if not 0.0 <= seconds <= 3600.0:
        raise ValueError(f"seconds = {seconds} must be 0 to 3600")
    return seconds


def _for_seconds(name: str) -> Action:
    """Have a fault of the network last for some seconds."""
    return lambda server, request: setattr(server.network, name, time.monotonic() + _seconds(request))


def _of_seconds(name: str) -> Action:
    """Give a fault of the network its length."""
    return lambda server, request: setattr(server.network, name, _seconds(request))


def _drop(server: Server, request: Request) -> None:
    share = float(request.get("share", 0.5))
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"share = {share} must be 0 to 1")
    server.network.drop = share


def _switch(server: Server, request: Request) -> None:
    name = str(request.get("name"))
    if name not in ("stuck_ready", "refuse_unlock", "refuse_script"):
        raise ValueError(f"name = {name!r} must be stuck_ready, refuse_unlock or refuse_script")
    setattr(server.robot.faults, name, bool(request.get("on", True)))


def _option(server: Server, request: Request) -> None:
    options, name, value = server.robot.options, str(request.get("name")), request.get("value")
    if name == "program_on_stop" and value in ("paused", "stopped", "playing"):
        options.program_on_stop = str(value)
    elif name in ("remote_control", "watchdog_sleeps"):
        setattr(options, name, bool(value))
        if name == "remote_control" and not value:  # a UR closes the connections for programs
            server.drop(ScriptChannel.name)
    elif name == "speed_slider":
        server.robot.arm.slider = max(0.0, min(1.0, float(value)))  # type: ignore[arg-type]
    elif name == "speed_scaling":
        server.robot.arm.limiting = max(0.0, min(1.0, float(value)))  # type: ignore[arg-type]
    elif name == "servo_error":
        server.robot.arm.error = max(-0.01, min(0.01, float(value)))  # type: ignore[arg-type]
    elif name == "unlock_after":
        options.unlock_after = float(value)  # type: ignore[arg-type]
    else:
        names = (
            "program_on_stop, remote_control, watchdog_sleeps, unlock_after, speed_slider, speed_scaling, servo_error"
        )
        raise ValueError(f"option {name!r} = {value!r} cannot be set; use {names}")


def _corrupt(server: Server, request: Request) -> None:
    """A value that cannot be among the outputs, from now on; without a value: no more."""
    name, index, value = str(request.get("name")), request.get("index", 0), request.get("value")
    if name not in rtde.OUTPUTS:
        raise ValueError(f"name = {name!r} is no output")
    if value is None:
        server.robot.faults.corrupt.pop(name, None)
    else:
        server.robot.faults.corrupt[name] = rtde.checked_number(name, index, value)


def _wall(server: Server, request: Request) -> None:
    off = request.get("z") is None
    server.robot.faults.wall = None if off else (float(request["z"]), float(request.get("stiffness", 2000.0)))


def _state(server: Server, _: Request) -> dict[str, Any]:
    robot = server.robot
    return {
        "time": robot.robot_time,
        "tcp_pose": robot.arm.tcp_pose(),
        "q": robot.arm.q,
        "robot_mode": robot.robot_mode,
        "safety_mode": robot.safety_mode,
        "runtime_state": robot.runtime_state,
        "program": robot.program.name if robot.program else None,
        "uploads": robot.uploads,
        "command": robot.in_int[robot.offset],
        "registers": robot.offset,
        "freedrive": robot.freedrive,
        "wrench": robot.wrench_W(),
        "tool_outputs": int(robot.values["actual_digital_output_bits"]) >> TOOL_BIT & 3,  # type: ignore[arg-type]
        "tool_voltage": robot.values["tool_output_voltage"],
        "payload": robot.payload,
        "payload_cog": robot.payload_cog,
        "payload_inertia": robot.payload_inertia,
        "tcp_offset": robot.arm.tcp_offset,
        "speed_slider": robot.arm.slider,
        "speed_scaling": robot.arm.limiting,
        "clients": Counter(channel.name for channel in server.channels),
        "messages": list(robot.faults.messages),
    }


def _tool(server: Server, request: Request) -> None:
    """As somebody sets it on the pendant, or another program by set_tcp and set_payload."""
    robot = server.robot
    if "tcp" in request:
        robot.arm.set_tcp(matrix_from_pose(checked_pose(request["tcp"], "tcp")))
    robot.payload = float(request.get("payload", robot.payload))
    cog = [float(x) for x in request.get("cog", robot.payload_cog)]
    if len(cog) != 3:
        raise ValueError(f"cog = {cog} must be 3 numbers [m]")
    robot.payload_cog = cog


def _stale_command(server: Server, request: Request) -> None:
    """As a client leaves it that dies before it can write 0; its pose is the last one's, or as given."""
    robot, first = server.robot, server.robot.offset
    if "pose" in request:
        robot.in_double[first : first + 6] = checked_pose(request["pose"], "pose")
    robot.in_int[first] = SERVO_L


def _play(server: Server, request: Request) -> None:
    """A program from the pendant; one called rtde_control is that of a driver that is gone."""
    robot, name = server.robot, str(request.get("name", "pick_and_place"))
    own = f"def {name}():\n# float register offset {register_offset(request.get('offset', LAST_OFFSET))}\nend\n"
    other = OtherProgram(name, int(_seconds(request) / PERIOD))
    robot.play(Script(robot, own) if name == CONTROL_SCRIPT else other)


ACTIONS: dict[str, Action] = {
    "state": _state,
    "stats": lambda server, _: server.robot.recorder.report(),
    "motion": lambda server, request: {"motion": server.robot.recorder.motion(float(request.get("since", 0.0)))},
    "servo_times": lambda server, _: {"times": list(server.robot.recorder.servo_times)},
    "targets": lambda server, _: {"targets": [list(t) for t in server.robot.recorder.targets]},
    "reset_stats": lambda server, _: server.robot.recorder.reset(),
    "kill": lambda *_: os._exit(1),  # as if the controller lost its power
    "freeze": _of_seconds("freeze"),
    "silence": _for_seconds("silent_until"),
    "pause_outputs": _for_seconds("outputs_paused_until"),
    "mute": _for_seconds("mute_until"),
    "no_data": _for_seconds("no_data_until"),
    "drop_rtde": lambda server, _: server.drop("rtde"),
    "drop_all": lambda server, _: server.drop(""),
    "refuse": lambda server, request: server.refuse(_seconds(request)),
    "slow": _of_seconds("delay"),
    "drop": _drop,
    "protective_stop": lambda server, _: server.robot.protective_stop(),
    "emergency_stop": lambda server, _: server.robot.emergency_stop(),
    "safety_fault": lambda server, _: server.robot.safety_fault(),
    "release_emergency_stop": lambda server, _: server.robot.release_emergency_stop(),
    "pendant_stop": lambda server, _: server.robot.stop_program(),
    "play": _play,
    "tool": _tool,
    "set_clock_back": lambda server, request: server.robot.set_clock_back(_seconds(request)),
    "stale_command": _stale_command,
    "switch": _switch,
    "option": _option,
    "corrupt": _corrupt,
    "wall": _wall,
    "place": lambda server, request: server.place(
        request["pose"], request["near"], request.get("clock"), stay=request.get("stay") is True
    ),
    "wrench": lambda server, request: server.robot.set_wrench(request["wrench"]),
}

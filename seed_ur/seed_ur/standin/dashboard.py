# SPDX-License-Identifier: Apache-2.0
"""Port 29999, the dashboard server: a line in, a line out, with the literal answers that clients check.

Source: Universal Robots, "Dashboard Server e-Series".
"""

import socket
from collections.abc import Callable

from seed_ur.standin.channel import Channel, Network
from seed_ur.standin.controller import Controller
from seed_ur.standin.options import NORMAL, PAUSED, PLAYING, PROTECTIVE, ROBOT_EMERGENCY, SAFETY_FAULT, STOPPED

GREETING = "Connected: Universal Robots Dashboard Server\n"
_MODES = {3: "POWER_OFF", 4: "POWER_ON", 5: "IDLE", 7: "RUNNING"}
_SAFETY = {
    NORMAL: "NORMAL",
    PROTECTIVE: "PROTECTIVE_STOP",
    ROBOT_EMERGENCY: "ROBOT_EMERGENCY_STOP",
    SAFETY_FAULT: "FAULT",
}
_STATES = {STOPPED: "STOPPED", PLAYING: "PLAYING", PAUSED: "PAUSED"}
UNKNOWN = "could not understand: '{}'"


def answer(robot: Controller, line: str) -> str:
    """The reply to one command line."""
    command = line.strip()
    action = _COMMANDS.get(command.lower())
    if command.lower() in _SINCE_5_6 and robot.options.version[:2] < (5, 6):
        return UNKNOWN.format(command)
    if action is not None:
        return action(robot)
    for prefix, reply in _PREFIXES.items():
        if command.lower().startswith(prefix):
            return reply.format(command[len(prefix) :].strip())
    return UNKNOWN.format(command)


def _stop(robot: Controller) -> str:
    robot.stop_program()
    return "Stopped"


def _play(robot: Controller) -> str:
    return "Starting program" if robot.resume() or robot.runtime_state == PLAYING else "Failed to execute: play"


def _pause(robot: Controller) -> str:
    if robot.runtime_state != PLAYING:
        return "Failed to execute: pause"
    robot.runtime_state = PAUSED
    robot.arm.stop()
    return "Pausing program"


def _unlock(robot: Controller) -> str:
    if robot.unlock_protective_stop():
        return "Protective stop releasing"
    return "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop first"


def _power(on: bool) -> Callable[[Controller], str]:
    def action(robot: Controller) -> str:
        if on and robot.safety_mode == ROBOT_EMERGENCY:
            return "Failed to execute: power on"
        robot.power(on)
        return "Powering on" if on else "Powering off"

    return action


def _restart_safety(robot: Controller) -> str:
    robot.restart_safety()
    return "Restarting safety"


def _state(robot: Controller) -> str:
    return f"{_STATES[robot.runtime_state]} {robot.program.name if robot.program else '<unnamed>'}"


_COMMANDS: dict[str, Callable[[Controller], str]] = {
    "polyscopeversion": lambda robot: "URSoftware {}.{}.{}.{} (stand-in)".format(*robot.options.version),
    "version": lambda robot: "{}.{}.{}.{}".format(*robot.options.version),
    "get serial number": lambda _: "20215500001",
    "get robot model": lambda robot: robot.options.model.rstrip("e").upper(),
    "is in remote control": lambda robot: str(robot.options.remote_control).lower(),
    "robotmode": lambda robot: f"Robotmode: {_MODES.get(robot.robot_mode, 'NO_CONTROLLER')}",
    "safetymode": lambda robot: f"Safetymode: {_SAFETY[robot.safety_mode]}",
    "safetystatus": lambda robot: f"Safetystatus: {_SAFETY[robot.safety_mode]}",
    "programstate": _state,
    "running": lambda robot: f"Program running: {str(robot.runtime_state == PLAYING).lower()}",
    "get loaded program": lambda _: "No program loaded",
    "isprogramsaved": lambda _: "true",
    "stop": _stop,
    "play": _play,
    "pause": _pause,
    "unlock protective stop": _unlock,
    "power on": _power(True),
    "power off": _power(False),
    "brake release": lambda robot: "Brake releasing" if robot.release_brakes() else "Failed to execute: brake release",
    "close safety popup": lambda _: "closing safety popup",
    "close popup": lambda _: "closing popup",
    "restart safety": _restart_safety,
    "quit": lambda _: "Disconnected",
    "shutdown": lambda _: "Shutting down",
}
_SINCE_5_6 = frozenset(("get serial number", "is in remote control", "get robot model"))
_PREFIXES = {
    "load ": "Loading program: {}, ",
    "popup ": "showing popup",
    "addtolog ": "Added log message",
    "setuserrole ": "Setting user role: {}",
}


class DashboardChannel(Channel):
    """A connection to port 29999."""

    name = "dashboard"

    def __init__(self, connection: socket.socket, robot: Controller, network: Network) -> None:
        super().__init__(connection, robot, network)
        if not network.mute:
            self.send(GREETING.encode())

    def received(self) -> None:
        for line in self.lines():
            if self.network.mute:
                return
            self.send(answer(self.robot, line.decode("utf-8", "replace")).encode() + b"\n")
            if line.strip() == b"quit":
                self.open = False

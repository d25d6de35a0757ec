# SPDX-License-Identifier: Apache-2.0
"""Port 29999, the dashboard server: a line in, a line out, with the literal answers that clients check.

Source: Universal Robots, "Dashboard Server e-Series".
"""

from __future__ import annotations

import socket
from collections.abc import Callable

from seed_ur.standin.channel import Channel, Network
from seed_ur.standin.controller import Controller
from seed_ur.standin.options import NORMAL, PAUSED, PLAYING, PROTECTIVE, ROBOT_EMERGENCY, STOPPED

GREETING = "Connected: Universal Robots Dashboard Server\n"
_MODES = {3: "POWER_OFF", 4: "POWER_ON", 5: "IDLE", 7: "RUNNING"}
_SAFETY = {NORMAL: "NORMAL", PROTECTIVE: "PROTECTIVE_STOP", ROBOT_EMERGENCY: "ROBOT_EMERGENCY_STOP"}
_STATES = {STOPPED: "STOPPED", PLAYING: "PLAYING", PAUSED: "PAUSED"}
UNKNOWN = "could not understand: '{}'"


def answer(box: Controller, line: str) -> str:
    """The reply to one command line."""
    command = line.strip()
    action = _COMMANDS.get(command.lower())
    if command.lower() in _SINCE_5_6 and box.options.version[:2] < (5, 6):
        return UNKNOWN.format(command)
    if action is not None:
        return action(box)
    for prefix, reply in _PREFIXES.items():
        if command.lower().startswith(prefix):
            return reply.format(command[len(prefix) :].strip())
    return UNKNOWN.format(command)


def _stop(box: Controller) -> str:
    box.stop_program()
    return "Stopped"


def _play(box: Controller) -> str:
    return "Starting program" if box.resume() or box.runtime_state == PLAYING else "Failed to execute: play"


def _pause(box: Controller) -> str:
    if box.runtime_state != PLAYING:
        return "Failed to execute: pause"
    box.runtime_state = PAUSED
    box.arm.stop()
    return "Pausing program"


def _unlock(box: Controller) -> str:
    if box.unlock_protective_stop():
        return "Protective stop releasing"
    return "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop first"


def _power(on: bool) -> Callable[[Controller], str]:
    def action(box: Controller) -> str:
        if on and box.safety_mode == ROBOT_EMERGENCY:
            return "Failed to execute: power on"
        box.power(on)
        return "Powering on" if on else "Powering off"

    return action


def _state(box: Controller) -> str:
    return f"{_STATES[box.runtime_state]} {box.program.name if box.program else '<unnamed>'}"


_COMMANDS: dict[str, Callable[[Controller], str]] = {
    "polyscopeversion": lambda box: "URSoftware {}.{}.{}.{} (stand-in)".format(*box.options.version),
    "version": lambda box: "{}.{}.{}.{}".format(*box.options.version),
    "get serial number": lambda _: "20215500001",
    "get robot model": lambda box: box.options.model.rstrip("e").upper(),
    "is in remote control": lambda box: str(box.options.remote_control).lower(),
    "robotmode": lambda box: f"Robotmode: {_MODES.get(box.robot_mode, 'NO_CONTROLLER')}",
    "safetymode": lambda box: f"Safetymode: {_SAFETY[box.safety_mode]}",
    "safetystatus": lambda box: f"Safetystatus: {_SAFETY[box.safety_mode]}",
    "programstate": _state,
    "running": lambda box: f"Program running: {str(box.runtime_state == PLAYING).lower()}",
    "get loaded program": lambda _: "No program loaded",
    "isprogramsaved": lambda _: "true",
    "stop": _stop,
    "play": _play,
    "pause": _pause,
    "unlock protective stop": _unlock,
    "power on": _power(True),
    "power off": _power(False),
    "brake release": lambda box: "Brake releasing" if box.release_brakes() else "Failed to execute: brake release",
    "close safety popup": lambda _: "closing safety popup",
    "close popup": lambda _: "closing popup",
    "restart safety": lambda _: "Restarting safety",
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

    def __init__(self, connection: socket.socket, box: Controller, network: Network) -> None:
        super().__init__(connection, box, network)
        if not network.mute:
            self.send(GREETING.encode())

    def received(self) -> None:
        for line in self.lines():
            if self.network.mute:
                return
            self.send(answer(self.box, line.decode("utf-8", "replace")).encode() + b"\n")
            if line.strip() == b"quit":
                self.open = False

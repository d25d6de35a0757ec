# SPDX-License-Identifier: Apache-2.0
"""The connector at the tool: its two digital outputs and its voltage, for a gripper. Each call waits until it is so.

Sources: Universal Robots, "Real-Time Data Exchange (RTDE) Guide" (outputs, and the bits that show them) and the script
manual (set_tool_voltage; a secondary program, `sec`, runs beside the one that plays).
"""

import socket
import time
from collections.abc import Callable

from seed_driver.robot.link import LinkError
from seed_driver.robot.own_sockets import SCRIPT_PORT
from seed_driver.robot.rtde_client import ONCE, RtdeClient, hold_inputs
from seed_ur import rtde

OUTPUT = rtde.Recipe.of(("tool_digital_output_mask", "tool_digital_output"), rtde.INPUTS)
FIRST_BIT = 16  # of the tool's outputs, in actual_digital_output_bits
VOLTAGES = (0, 12, 24)  # [V]
DONE_WITHIN = 1.0  # [s]


def set_tool_output(host: str, pin: int, on: bool) -> str:
    """Switch digital output 0 or 1 of the tool; returns what was done, raises LinkError."""
    with hold_inputs(host, OUTPUT.names, "the tool's outputs") as client:
        client.start(("actual_digital_output_bits",), ONCE)
        client.send(OUTPUT.encode(1, {"tool_digital_output_mask": 1 << pin, "tool_digital_output": on << pin}))
        bit = FIRST_BIT + pin
        _wait(client, lambda: int(client.values["actual_digital_output_bits"]) >> bit & 1 == on, "switch an output")
    return f"tool output {pin} is {'on' if on else 'off'}"


def set_tool_voltage(host: str, volts: int) -> str:
    """Supply the tool with 0, 12 or 24 V; returns what was done, raises LinkError."""
    if volts not in VOLTAGES:
        raise LinkError(f"tool voltage = {volts} V must be one of {', '.join(map(str, VOLTAGES))} V")
    with RtdeClient(host) as client:
        client.start(("tool_output_voltage",), ONCE)
        try:
            with socket.create_connection((host, SCRIPT_PORT), DONE_WITHIN) as script:
                script.sendall(f"sec seed_tool_voltage():\n  set_tool_voltage({volts})\nend\n".encode())
                _wait(client, lambda: client.values["tool_output_voltage"] == volts, f"supply {volts} V")
        except OSError as error:
            raise LinkError(f"no scripts are taken at {host}:{SCRIPT_PORT} ({error})") from error
    return f"the tool is supplied with {volts} V"


def _wait(client: RtdeClient, done: Callable[[], bool], what: str) -> None:
    client.never_wait()
    until = time.monotonic() + DONE_WITHIN
    while not done():
        if time.monotonic() > until:
            raise LinkError(f"the robot at {client.host} does not {what} at the tool: is it in local control?")
        time.sleep(0.01)
        client.poll()

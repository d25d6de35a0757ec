# SPDX-License-Identifier: Apache-2.0
"""The servo process's hold on ur_rtde. Every call here may block; the node watches the heartbeat and kills if so."""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import time
from collections.abc import Sequence
from typing import Any

from seed_core.quaternion import Quaternion, from_rotation_vector, multiply, rotate, rotation_vector
from seed_core.vector3 import Vector3
from seed_driver.config import DriverConfig
from seed_driver.process.shared_memory import Modes, Sample
from seed_driver.robot import link, probe
from seed_driver.robot.probe import LinkError
from seed_driver.robot.receive import StateStream

CONTROL_RATE = 125.0  # [Hz] of what ur_rtde's own thread reads: a third of the process's time at the full rate
CLEARING = 0.2  # [s] from the answer to an unlock to states without the stop
INSTALL = "ur_rtde is not installed: pip install ur-rtde==1.6.5 (wheels exist for Python 3.10 to 3.12 on x86_64)"


def load() -> Any:
    """The control class; raises LinkError naming the pip command when ur_rtde is missing."""
    try:
        from rtde_control import RTDEControlInterface
    except ImportError as error:
        raise LinkError(f"{INSTALL} [{error}]") from error
    return RTDEControlInterface


class Robot:
    """A stream of states and, once a program is wanted, ur_rtde's control interface."""

    def __init__(self, config: DriverConfig) -> None:
        self.config = config
        self.control_class = load()
        self.look = probe.look(config.robot_ip)
        self.rate = config.frequency or (125.0 if self.look.version[0] == 3 else 500.0)
        self.states = StateStream(config.robot_ip, self.rate)
        self.control: Any = None
        self._slider: probe.MiniRtde | None = None

    @property
    def timestamp(self) -> float:
        """The controller's clock in the newest package [s]."""
        self.states.poll()
        return self.states.timestamp

    @property
    def packages(self) -> int:
        """How many packages there have been."""
        return self.states.packages

    @property
    def connected(self) -> bool:
        """Whether both connections stand (necessary, not sufficient)."""
        return self.states.open and (self.control is None or bool(self.control.isConnected()))

    def sample(self) -> Sample:
        """The newest state."""
        v = self.states.values
        modes = Modes(v[38], v[39], v[40], v[42], v[41])
        tcp_orientation = from_rotation_vector(v[23:26])
        tcp = self.states.tcp_offset or self.config.tcp
        if not any(tcp):
            return Sample(
                v[2:8], v[8:14], v[14:20], v[20:23], tcp_orientation, v[26:32], v[32:38], modes, v[43] * v[44]
            )
        p_tcp, (x, y, z, w) = _split(tcp)
        q = multiply(tcp_orientation, (-x, -y, -z, w))
        arm = rotate(q, p_tcp)  # from flange to TCP, in base
        wx, wy, wz = v[29:32]
        twist = (
            v[26] - (wy * arm[2] - wz * arm[1]),
            v[27] - (wz * arm[0] - wx * arm[2]),
            v[28] - (wx * arm[1] - wy * arm[0]),
            wx,
            wy,
            wz,
        )
        p = v[20] - arm[0], v[21] - arm[1], v[22] - arm[2]
        return Sample(v[2:8], v[8:14], v[14:20], p, q, twist, v[32:38], modes, v[43] * v[44])

    def start_program(self) -> None:
        """Get our control script running with nothing in the command register; raises LinkError."""
        self._wait_able()
        if self.control is None:
            probe.require_control(self.config.robot_ip, self.look.version)
            self._construct()
        elif self.states.runtime_state != link.PLAYING:
            self._send_again()
        self._wait_playing()
        self._set_up()

    def _wait_able(self) -> None:
        """A stop that was just unlocked takes a moment to be gone from the states."""
        deadline = time.monotonic() + CLEARING
        while why := link.unable(self.states.robot_mode, self.states.safety_bits):
            if time.monotonic() > deadline:
                raise LinkError(why)
            time.sleep(0.004)
            self.states.poll()

    def _construct(self) -> None:
        try:
            self.control = self.control_class(self.config.robot_ip, min(self.rate, CONTROL_RATE))
        except RuntimeError as error:
            raise LinkError(f"the robot does not start our program: {error}") from error
        send_at_once(probe.RTDE_PORT)

    def _send_again(self) -> None:
        """Clear the command register first: a script that finds an old servo command there moves at once."""
        self.control.servoStop()  # the program is dead: this fails, but writes 0
        time.sleep(0.01)
        left = probe.command_register(self.config.robot_ip)
        if left not in (0, None):
            raise LinkError(f"command register still holds {left}; the program is not sent again, restart the driver")
        self.control.reuploadScript()

    def _wait_playing(self) -> None:
        self.states.poll()
        deadline = time.monotonic() + 1.5
        while self.states.runtime_state != link.PLAYING:
            demand(time.monotonic() < deadline, "start our program")
            time.sleep(0.004)
            self.states.poll()
        time.sleep(3.0 / CONTROL_RATE)  # until ur_rtde knows it too: it refuses commands to a program that does not run

    def _set_up(self) -> None:
        self.apply_tool(self.config)
        demand(self.control.setWatchdog(self.config.watchdog_frequency), "take the watchdog")

    def apply_tool(self, config: DriverConfig) -> None:
        """Send TCP, payload and speed slider to the controller."""
        self.config = config
        demand(self.control.setTcp(list(config.tcp)), "take the TCP")
        demand(self.control.setPayload(config.payload_mass, list(config.payload_cog)), "take the payload")
        self.set_slider(config.speed_slider)

    def set_slider(self, fraction: float) -> None:
        """Move the speed slider, by a connection of its own that stays open."""
        if self._slider is None:
            if fraction == self.states.speed_fraction:
                return
            self._slider = probe.MiniRtde(self.config.robot_ip)
            self._slider.version()
            self._slider.ask("I", b"speed_slider_mask,speed_slider_fraction")
        self._slider.send(struct.pack(">BId", 1, 1, fraction))

    def servo(self, p: Vector3, q: Quaternion, period: float) -> None:
        """Stream one flange pose."""
        c = self.config
        if not any(c.tcp):
            pose = [*p, *rotation_vector(q)]
        else:
            p_tcp, q_tcp = _split(c.tcp)
            x, y, z = rotate(q, p_tcp)
            pose = [p[0] + x, p[1] + y, p[2] + z, *rotation_vector(multiply(q, q_tcp))]
        self.control.servoL(pose, 0.0, 0.0, period, c.servo_lookahead, c.servo_gain)

    def close(self) -> None:
        """End the program; the arm has to stand still."""
        if self.control is not None:
            self.control.servoStop()
            self.control.stopScript()


def _split(pose: Sequence[float]) -> tuple[Vector3, Quaternion]:
    """Position and quaternion of a pose vector."""
    return (pose[0], pose[1], pose[2]), from_rotation_vector((pose[3], pose[4], pose[5]))


def demand(done: bool, what: str) -> None:
    """Raise LinkError unless the robot has done what it was asked for."""
    if not done:
        raise LinkError(f"the robot does not {what}; look at the pendant")


def send_at_once(port: int) -> None:
    """Have no connection of this process to a `port` hold small packages back until the last one is acknowledged.

    ur_rtde leaves that on (Nagle's algorithm): its commands would wait for the next package of data from the robot.
    """
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):  # no socket, or not connected
            link = socket.socket(fileno=int(name))
            try:
                if link.family == socket.AF_INET and link.getpeername()[1] == port:
                    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            finally:
                link.detach()

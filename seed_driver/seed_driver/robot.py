# SPDX-License-Identifier: Apache-2.0
"""The servo process's hold on ur_rtde. Every call here may block; the node watches the heartbeat and kills if so."""

from __future__ import annotations

import struct
import time
from math import dist
from typing import Any

from seed_core.ur_pose import checked_pose
from seed_driver import link, probe
from seed_driver.config import DriverConfig
from seed_driver.probe import LinkError
from seed_driver.rotation import Quaternion, Vector, from_rotation_vector, multiply, rotate, rotation_vector
from seed_driver.shared import Modes, Sample

VARIABLES = [
    "timestamp",
    "actual_q",
    "actual_qd",
    "actual_current",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "actual_TCP_force",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "robot_status_bits",
    "safety_status_bits",
    "speed_scaling",
    "target_speed_fraction",
]
STATE_RATE = 250.0  # [Hz] of the states; the control connection needs the full rate, or servoL waits for it
INSTALL = "ur_rtde is not installed: pip install ur-rtde==1.6.5 (wheels exist for Python 3.10 to 3.12 on x86_64)"


def load() -> tuple[Any, Any]:
    """The control and receive classes; raises LinkError naming the pip command when ur_rtde is missing."""
    try:
        from rtde_control import RTDEControlInterface
        from rtde_receive import RTDEReceiveInterface
    except ImportError as error:
        raise LinkError(f"{INSTALL} [{error}]") from error
    return RTDEControlInterface, RTDEReceiveInterface


class Robot:
    """Receive and, once a program is wanted, Control."""

    def __init__(self, config: DriverConfig) -> None:
        self.config = config
        self.control_class, receive_class = load()
        self.look = probe.look(config.robot_ip)
        self.rate = config.frequency or (125.0 if self.look.version[0] == 3 else 500.0)
        self.receive = receive_class(config.robot_ip, min(self.rate, STATE_RATE), VARIABLES)
        self.control: Any = None
        self._slider: probe.MiniRtde | None = None
        self._set_tcp(config)
        if not self.receive.isConnected():
            raise LinkError(f"{config.robot_ip} sends no RTDE data")

    def _set_tcp(self, config: DriverConfig) -> None:
        x, y, z, *r = checked_pose(config.tcp, "tcp")
        self.p_tcp: Vector = (x, y, z)  # in the flange frame
        self.q_tcp = from_rotation_vector((r[0], r[1], r[2]))

    @property
    def timestamp(self) -> float:
        """The controller's clock in the newest package [s]."""
        return float(self.receive.getTimestamp())

    @property
    def connected(self) -> bool:
        """Whether both connections say so (necessary, not sufficient)."""
        return bool(self.receive.isConnected()) and (self.control is None or bool(self.control.isConnected()))

    def sample(self) -> Sample:
        """The newest state."""
        r = self.receive
        pose, speed = r.getActualTCPPose(), r.getActualTCPSpeed()
        tcp_orientation = from_rotation_vector((pose[3], pose[4], pose[5]))
        inverse = (-self.q_tcp[0], -self.q_tcp[1], -self.q_tcp[2], self.q_tcp[3])
        q = multiply(tcp_orientation, inverse)
        arm = rotate(q, self.p_tcp)  # from flange to TCP, in base
        w = speed[3:]
        twist = (
            speed[0] - (w[1] * arm[2] - w[2] * arm[1]),
            speed[1] - (w[2] * arm[0] - w[0] * arm[2]),
            speed[2] - (w[0] * arm[1] - w[1] * arm[0]),
            *w,
        )
        return Sample(
            tuple(r.getActualQ()),
            tuple(r.getActualQd()),
            tuple(r.getActualCurrent()),
            (pose[0] - arm[0], pose[1] - arm[1], pose[2] - arm[2]),
            q,
            twist,
            tuple(r.getActualTCPForce()),
            Modes(
                r.getRobotMode(),
                r.getSafetyMode(),
                int(r.getRuntimeState()),
                r.getSafetyStatusBits(),
                int(r.getRobotStatus()),
            ),
            r.getSpeedScaling() * r.getTargetSpeedFraction(),
        )

    def start_program(self) -> None:
        """Get our control script running with nothing in the command register; raises LinkError."""
        why = link.unable(self.receive.getRobotMode(), self.receive.getSafetyStatusBits())
        if why:
            raise LinkError(why)
        if self.control is None:
            probe.require_control(self.config.robot_ip, self.look.version)
            self._construct()
        elif int(self.receive.getRuntimeState()) != link.PLAYING:
            self._send_again()
        self._wait_playing()
        self._set_up()

    def _construct(self) -> None:
        try:
            self.control = self.control_class(self.config.robot_ip, self.rate)
        except RuntimeError as error:
            raise LinkError(f"the robot does not start our program: {error}") from error

    def _send_again(self) -> None:
        """Clear the command register first: a script that finds an old servo command there moves at once."""
        self.control.servoStop()  # the program is dead: this fails, but writes 0
        time.sleep(0.01)
        left = probe.command_register(self.config.robot_ip)
        if left not in (0, None):
            raise LinkError(f"command register still holds {left}; the program is not sent again, restart the driver")
        self.control.reuploadScript()

    def _wait_playing(self) -> None:
        deadline = time.monotonic() + 1.5
        while int(self.receive.getRuntimeState()) != link.PLAYING:
            if time.monotonic() > deadline:
                raise LinkError("the robot does not start our program; look at the pendant")
            time.sleep(0.004)

    def _set_up(self) -> None:
        self.apply_tool(self.config)
        if not self.control.setWatchdog(self.config.watchdog_frequency):
            raise LinkError("the robot does not take the watchdog; look at the pendant")

    def apply_tool(self, config: DriverConfig) -> None:
        """Send TCP, payload and speed slider to the controller."""
        self.config = config
        self._set_tcp(config)
        if not self.control.setTcp(list(config.tcp)):
            raise LinkError("the robot does not take the TCP; look at the pendant")
        if not self.control.setPayload(config.payload_mass, list(config.payload_cog)):
            raise LinkError("the robot does not take the payload; look at the pendant")
        self.set_slider(config.speed_slider)

    def set_slider(self, fraction: float) -> None:
        """Move the speed slider, by a connection of its own that stays open."""
        if self._slider is None:
            if fraction == float(self.receive.getTargetSpeedFraction()):
                return
            self._slider = probe.MiniRtde(self.config.robot_ip)
            self._slider.version()
            self._slider.ask("I", b"speed_slider_mask,speed_slider_fraction")
        self._slider.send(struct.pack(">BId", 1, 1, fraction))

    def servo(self, p: Vector, q: Quaternion, period: float) -> None:
        """Stream one flange pose."""
        arm = rotate(q, self.p_tcp)
        turn = rotation_vector(multiply(q, self.q_tcp))
        c = self.config
        pose = [p[0] + arm[0], p[1] + arm[1], p[2] + arm[2], *turn]
        self.control.servoL(pose, 0.0, 0.0, period, c.servo_lookahead, c.servo_gain)

    def close(self) -> None:
        """End the program; the arm has to stand still."""
        if self.control is not None:
            self.control.servoStop()
            self.control.stopScript()


def model_error(flange: Vector, expected: tuple[float, ...]) -> float:
    """Distance [m] between where the robot says its flange is and where our kinematics puts it."""
    return dist(flange, expected)

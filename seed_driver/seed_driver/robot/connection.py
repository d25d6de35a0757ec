# SPDX-License-Identifier: Apache-2.0
"""The robot as the servo process has it: states, our program by ur_rtde, and one flange pose per cycle.

Every call of ur_rtde may block; the node watches the heartbeat and kills the process if so.
"""

import time
from collections.abc import Mapping, Sequence
from math import dist
from typing import Any

from seed_core.arm.quaternion import (
    Quaternion,
    from_rotation_vector,
    multiply,
    rotate,
    rotation_vector,
    turn_between,
)
from seed_core.vector3 import Vector3, norm
from seed_driver.config import DriverConfig
from seed_driver.process.shared_memory import Modes, RobotState
from seed_driver.robot import link, registers, rtde_client, tcp_and_payload
from seed_driver.robot.link import LinkError
from seed_driver.robot.own_sockets import ScriptConnection, send_at_once
from seed_driver.robot.program import program, program_file
from seed_driver.robot.state_checks import check_state
from seed_driver.robot.tcp_and_payload import TcpAndPayload
from seed_ur import rtde

STATES = (
    "timestamp", "actual_q", "actual_qd", "actual_current", "actual_TCP_pose", "actual_TCP_speed", "actual_TCP_force",
    "target_q", "target_TCP_pose",
    "robot_mode", "safety_mode", "runtime_state", "safety_status_bits", "speed_scaling", "target_speed_fraction",
    *tcp_and_payload.OUTPUTS,  # of the controllers that know them
)  # fmt: skip
CONTROL_RATE = 125.0  # [Hz] of what ur_rtde's own thread reads: a third of the process's time at the full rate
TAKING = 1.0  # [s] from sending TCP and payload to states that show them
SHORTLY = 0.01  # [s] that servo commands may wait for them
PARTING = 0.05  # [s] between the ends of the two connections to a controller that is gone
CLEARING = 0.2  # [s] from the answer to an unlock to states without the stop
HELD_OFF, TURNED_OFF = 0.005, 0.02  # [m], [rad] by which friction and load may hold a standing arm off its target
NEXT_TO_ZERO = 1e-6  # [m] of a centre of mass
INERTIA = (5, 11)  # first PolyScope that is told of it: neither our program nor ur_rtde's does so on CB3
UPLOAD, UPPER_REGISTERS, NO_WAIT, NO_EXTERNAL_SENSOR = 1, 8, 16, 64  # ur_rtde's flags
CAP_PORT = 50002  # ur_rtde's default; nothing listens there without its flag for External Control
OUR_PRIORITY = -1  # leave the threads' as it is
INSTALL = "ur_rtde is not installed: pip install ur-rtde==1.6.5 (wheels exist for Python 3.10 to 3.12 on x86_64)"
SLIDER = rtde.Recipe.of(("speed_slider_mask", "speed_slider_fraction"), rtde.INPUTS)


def load_ur_rtde() -> Any:
    """Its class of the control interface; raises LinkError with the pip command when it is not installed."""
    try:
        from rtde_control import RTDEControlInterface
    except ImportError as error:
        raise LinkError(f"{INSTALL} [{error}]") from error
    return RTDEControlInterface


class Robot:
    """A stream of states and, once a program is wanted, ur_rtde's control interface."""

    def __init__(self, config: DriverConfig) -> None:
        """Raises LinkError with what is wrong and what to do."""
        self.config = config
        self._control_class = load_ur_rtde()
        self.version = rtde_client.supported_version(config.robot_ip)
        self.rate = config.frequency or (125.0 if self.version[0] == 3 else 500.0)
        self.states = rtde_client.follow_outputs(config.robot_ip, STATES, self.rate, tcp_and_payload.OUTPUTS)
        self.offset = registers.offset(config.registers, self.version)
        self.control: Any = None
        self._script = ScriptConnection()  # of the control interface, once there is one
        self.ours = False  # the program that plays, if one does
        self.tool: TcpAndPayload | None = None  # what the robot is to have while our program runs
        self._taken_until = 0.0  # [s] monotonic, until when it may not have taken it yet
        self._untold_tcp = config.tcp  # of controllers that do not tell theirs
        self._good: Mapping[str, Any] = {}  # the newest state that can be
        self._slider: rtde_client.RtdeClient | None = None

    @property
    def timestamp(self) -> float:
        """The controller's clock in the newest package [s]."""
        self.states.poll()
        return float(self.states.values["timestamp"])

    @property
    def packages(self) -> int:
        """How many packages there have been."""
        return self.states.packages

    @property
    def connected(self) -> bool:
        """Whether both connections stand (necessary, not sufficient)."""
        return self.states.open and (self.control is None or bool(self.control.isConnected()))

    def stays_connected(self) -> bool:
        """Whether both connections still stand a moment from now: one may hear first that the other side is gone."""
        end = time.monotonic() + PARTING
        while self.connected and time.monotonic() < end:
            time.sleep(0.002)
            self.states.poll()
        return self.connected

    @property
    def tcp(self) -> Sequence[float]:
        """The TCP of the robot's poses, in the flange frame, as a pose vector."""
        tcp: Sequence[float] = self._good.get("tcp_offset", self._untold_tcp)
        return tcp

    @property
    def tells_tcp(self) -> bool:
        """Whether poses are those of the flange before our program runs, too."""
        return "tcp_offset" in self.states.values

    def sample(self) -> RobotState:
        """The newest state, of the flange: what the controller tells is of its TCP. Raises StateError."""
        v = self.states.values
        check_state(v)
        self._good = v
        self.ours &= v["runtime_state"] not in link.ENDED
        twist, wrench = v["actual_TCP_speed"], v["actual_TCP_force"]
        p, q, (ax, ay, az) = self._flange(v["actual_TCP_pose"])
        if any(self.tcp):
            vx, vy, vz, wx, wy, wz = twist
            if not rtde.force_is_at_flange(self.version):
                fx, fy, fz, tx, ty, tz = wrench
                wrench = fx, fy, fz, tx + ay * fz - az * fy, ty + az * fx - ax * fz, tz + ax * fy - ay * fx
            twist = vx - (wy * az - wz * ay), vy - (wz * ax - wx * az), vz - (wx * ay - wy * ax), wx, wy, wz
        return RobotState(
            q=v["actual_q"],
            qd=v["actual_qd"],
            current=v["actual_current"],
            p=p,
            orientation=q,
            twist=twist,
            wrench=wrench,
            modes=Modes(v["robot_mode"], v["safety_mode"], v["runtime_state"], v["safety_status_bits"]),
            speed_scaling=v["speed_scaling"] * v["target_speed_fraction"],
        )

    def _flange(self, tcp_pose: Sequence[float]) -> tuple[Vector3, Quaternion, Vector3]:
        """Position and rotation of the flange for a pose vector of the TCP, and the way from it to the TCP, in base."""
        (x, y, z), q = _split(tcp_pose)
        if not any(tcp := self.tcp):
            return (x, y, z), q, (0.0, 0.0, 0.0)
        p_tcp, (qx, qy, qz, qw) = _split(tcp)
        q = multiply(q, (-qx, -qy, -qz, qw))
        ax, ay, az = rotate(q, p_tcp)
        return (x - ax, y - ay, z - az), q, (ax, ay, az)

    def meant(self, s: RobotState) -> RobotState:
        """The state with the joints and pose that the robot's own controller has for its target; else `s` itself.

        A standing arm is held off its target a little by friction and load. The program compares a command with the
        target, and a command of where the arm is would move the target by as much, at every start.
        """
        try:
            (p, q, _), joints = self._flange(self._good["target_TCP_pose"]), self._good["target_q"]
        except (KeyError, ValueError, ZeroDivisionError):
            return s
        return where_meant(s, s._replace(q=joints, p=p, orientation=q))

    def start_program(self) -> None:
        """Get our control script running with nothing in the command register; raises LinkError."""
        self._wait_until_able()
        host, command = self.config.robot_ip, registers.command(self.offset)
        if self.control is None:
            rtde_client.require_control(host, self.version, command)
        else:
            rtde_client.require_remote(host, self.version)
        if self.states.values["runtime_state"] == link.PLAYING and not self.ours:
            rtde_client.end_orphan(host, command)
        if self.control is None:
            try:
                self._send_first()
            except RuntimeError as error:
                raise LinkError(f"the robot does not start our program: {error}") from error
            send_at_once(rtde_client.PORT)
        elif self.states.values["runtime_state"] != link.PLAYING:
            self._send_again()
        self._wait_until_playing()
        self.ours = True
        self.tool = None
        try:
            self.apply_tool(self.config)
            require(self.control.setWatchdog(self.config.watchdog_frequency), "take the watchdog")
        except LinkError:
            self.control.stopScript()  # nobody would feed it
            raise

    def _wait_until_able(self) -> None:
        """A stop that was just unlocked takes a moment to be gone from the states."""
        deadline = time.monotonic() + CLEARING
        while why := link.unable(self.states.values["robot_mode"], self.states.values["safety_status_bits"]):
            if time.monotonic() > deadline:
                raise LinkError(why)
            time.sleep(0.004)
            self.states.poll()

    def _send_first(self) -> None:
        """ur_rtde's control interface, which clears the command register, and the program.

        Without its flag ur_rtde 1.6.5 takes the input `external_force_torque` as well (recipe 23 of
        RTDEControlInterface::setupRecipes), and fails where the driver of a force/torque sensor has it. With its own
        priority (0) it puts the calling thread, and so the one that it makes, at SCHED_FIFO 90 where the kernel is a
        real-time one (RTDEUtility::setRealtimePriority): on one `cpu` the first, which spins, then starves the second.
        """
        checked = self.config.robot_program == "checked"
        flags = (NO_WAIT if checked else UPLOAD) | (UPPER_REGISTERS if self.offset else 0) | NO_EXTERNAL_SENSOR
        rate = min(self.rate, CONTROL_RATE)
        self.control = self._control_class(self.config.robot_ip, rate, flags, CAP_PORT, OUR_PRIORITY)
        self._script = ScriptConnection()
        if checked:
            self.control.setCustomScriptFile(program_file(program(self.version, self.offset)))  # sends it, too

    def clear_command(self) -> None:
        """Nothing is left in the command register of a program that is stopped: it may go on later."""
        if self.control is not None:
            self.control.kickWatchdog()  # to a program that does not play: writes 0 and returns

    def _send_again(self) -> None:
        """Clear the command register first: a script that finds an old servo command there moves at once."""
        self.control.servoStop()  # the program is dead: this fails, but writes 0
        time.sleep(0.01)
        left = rtde_client.command_register(self.config.robot_ip, registers.command(self.offset))
        if left not in (0, None):
            raise LinkError(f"command register still holds {left}; the program is not sent again, restart the driver")
        self._script.renew(self.config.robot_ip)
        self.control.reuploadScript()

    def _wait_until_playing(self) -> None:
        self.states.poll()
        deadline = time.monotonic() + 1.5
        while self.states.values["runtime_state"] != link.PLAYING:
            require(time.monotonic() < deadline, "start our program")
            time.sleep(0.004)
            self.states.poll()
        time.sleep(3.0 / CONTROL_RATE)  # until ur_rtde knows it too: it refuses commands to a program that does not run

    def apply_tool(self, config: DriverConfig) -> None:
        """Send to the controller what is configured of TCP, payload and speed slider; the rest stays as it is there."""
        self.config, want = config, tcp_and_payload.wanted(config)
        if want.tcp is not None:
            require(self.control.setTcp(list(want.tcp)), "take the TCP")
            self._untold_tcp = config.tcp
        elif not self.tells_tcp and self.tool is None:
            x, y, z, rx, ry, rz = self.control.getTCPOffset()
            self._untold_tcp = x, y, z, rx, ry, rz
        if want.inertia is not None:
            if self.version[:2] < INERTIA:
                raise LinkError("payload_inertia needs PolyScope 5.11 or later: set it to zero")
            load = want.else_from(self._told)
            mass, cog = load.mass or (0.0,), load.cog or (0.0,) * 3
            require(self.control.setTargetPayload(mass[0], self._sent_cog(cog), list(want.inertia)), "take the payload")
        elif want.mass is not None:
            cog = self._sent_cog(config.payload_cog)
            require(self.control.setPayload(config.payload_mass, cog), "take the payload")
        self._await_tool(want)
        if config.speed_slider:
            self._set_slider(config.speed_slider)

    def _sent_cog(self, cog: Sequence[float]) -> list[float]:
        """What to send for a centre of mass [m]: ur_rtde's own script takes zero for the one that the robot has."""
        kept = self.config.robot_program == "ur_rtde" and not any(cog)
        return [NEXT_TO_ZERO, 0.0, 0.0] if kept else list(cog)

    @property
    def _told(self) -> TcpAndPayload:
        """What the robot says in its newest state."""
        return tcp_and_payload.told(self.states.values)

    def _await_tool(self, want: TcpAndPayload) -> None:
        """The states show a moment later what was sent."""
        self._taken_until = time.monotonic() + TAKING
        while tcp_and_payload.difference(want, self._told) and time.monotonic() < self._taken_until:
            if self.tool is not None and time.monotonic() > self._taken_until - TAKING + SHORTLY:
                break  # while our program runs, servo commands must not wait: `tool_changed` sees to the rest
            self.control.kickWatchdog()
            time.sleep(0.002)
            self.states.poll()
        self.sample()  # servo commands are for the TCP of these states from now on
        found = self._told
        if self.tool is None:
            tcp_and_payload.require(want, found)
        self.tool = want.else_from(found)
        if not tcp_and_payload.difference(want, found):
            self._taken_until = 0.0

    def tool_changed(self) -> str:
        """How the robot's TCP or payload is not what it was when our program started, in words; else empty."""
        if self.tool is None:
            return ""
        words = tcp_and_payload.difference(self.tool, self._told)
        if not words:
            self._taken_until = 0.0
        elif time.monotonic() < self._taken_until:
            return ""
        return words and f"the robot's {words} as before: set it back, or call resend_robot_program to go on with it"

    def _set_slider(self, fraction: float) -> None:
        """Move the speed slider, by a connection of its own that stays open, made anew where it was closed."""
        if self._slider is not None:
            self._slider.poll()
            if not self._slider.open:
                self._slider.close()
                self._slider = None
        if self._slider is None:
            if fraction == self.states.values["target_speed_fraction"]:
                return
            self._slider = rtde_client.hold_inputs(self.config.robot_ip, SLIDER.names, "the speed slider")
            self._slider.never_wait()
        self._slider.send(SLIDER.encode(1, {"speed_slider_mask": 1, "speed_slider_fraction": fraction}))

    @property
    def taking(self) -> bool:
        """Whether the states do not show a changed tool yet, and `servo` sends nothing."""
        return time.monotonic() < self._taken_until

    def servo(self, p: Vector3, q: Quaternion, period: float) -> None:
        """Stream one flange pose: position [m], quaternion; period [s] is that of the cycle.

        Nothing while the states do not show a changed tool yet: a pose might be taken for the wrong TCP.
        """
        if self.taking:
            self.control.kickWatchdog()
            return
        c = self.config
        x, y, z = p
        if any(tcp := self.tcp):  # the robot's own: what it is told are poses of that
            p_tcp, q_tcp = _split(tcp)
            ax, ay, az = rotate(q, p_tcp)  # from flange to TCP, in base
            x, y, z, q = x + ax, y + ay, z + az, multiply(q, q_tcp)
        self.control.servoL([x, y, z, *rotation_vector(q)], 0.0, 0.0, period, c.servo_lookahead, c.servo_gain)

    def close(self) -> None:
        """End the program; the arm has to stand still."""
        if self.control is not None:
            self.control.servoStop()
            self.control.stopScript()


def where_meant(s: RobotState, target: RobotState) -> RobotState:
    """A state with the target's joints and pose; `s` where the arm is further from them than friction and load do."""
    near = dist(target.p, s.p) <= HELD_OFF and norm(turn_between(target.orientation, s.orientation)) <= TURNED_OFF
    near &= all(abs(a - b) <= TURNED_OFF for a, b in zip(target.q, s.q, strict=True))
    return target if near else s


def _split(pose: Sequence[float]) -> tuple[Vector3, Quaternion]:
    """Position and quaternion of a pose vector."""
    return (pose[0], pose[1], pose[2]), from_rotation_vector((pose[3], pose[4], pose[5]))


def require(done: bool, what: str) -> None:
    """Raise LinkError unless the robot has done what it was asked for."""
    if not done:
        raise LinkError(f"the robot does not {what}; look at the pendant")

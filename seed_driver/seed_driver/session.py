# SPDX-License-Identifier: Apache-2.0
"""One robot, the link to it and our program on it: its states judged, and what may be asked of it when."""

import time
from math import dist

from seed_core.vector3 import norm
from seed_driver.config import TOLD_TO_CONTROLLER, DriverConfig
from seed_driver.motion.path_clock import STANDSTILL, PathClock
from seed_driver.motion.servo_motion import ServoMotion
from seed_driver.process.realtime import threads_above
from seed_driver.process.shared_memory import RobotState
from seed_driver.robot import link
from seed_driver.robot.connection import Robot, require
from seed_driver.robot.link import AbsentError, LinkError
from seed_driver.robot.state_checks import StateError
from seed_ur.models import MODELS

STATE_PERIOD = 0.002  # [s] between states of the robot
WAITING = "waiting for the robot program"
NO_SAMPLE = RobotState()
MODEL_TOLERANCE = 0.03  # [m] more is not calibration but the wrong model
SET_BACK = 0.1  # [s] a clock that goes back by more was set
CREEP, CREEP_TURNING = 0.01, 0.05  # [m/s], [rad/s] an arm that is no faster stands, for a jump back to it
BAD_CYCLES = 5  # with states that cannot be, after which a motion is not gone on with: the arm stands by then


def _moves(s: RobotState) -> bool:
    """Whether the arm of this state is on its way."""
    return norm(s.twist[:3]) > CREEP or norm(s.twist[3:]) > CREEP_TURNING


class Session:
    """From the first look at a robot to the end of the servo process; requests raise LinkError with the reason."""

    def __init__(self, motion: ServoMotion, config: DriverConfig, want_start: bool) -> None:
        """want_start: our program, as soon as the robot allows it."""
        self.motion, self.config = motion, config
        self.robot: Robot | None = None
        self.watch = link.LinkWatch()
        self.want_start = want_start
        self.linked = self.running = self.freedrive = False
        self.sample = NO_SAMPLE
        self.sample_time = 0.0
        self.clock = 0.0  # [s] of the robot, in the newest state
        self._unable = False  # the robot, in that state
        self.path = PathClock()
        self._waiting = WAITING  # or for what has to come before

    @property
    def reason(self) -> str:
        """Why the arm holds, or what the session waits for; empty while targets are accepted."""
        return self.motion.latch.reason

    # what the robot says
    def listen(self, robot: Robot, now: float) -> str:
        """Take the newest state; the reason to give up when the link is beyond hope, else ''."""
        clock = robot.timestamp
        if self.watch.update(robot.packages if self.config.simulated else clock, now):
            try:
                sample = robot.sample()
            except StateError as error:  # neither used nor told; the next good one is judged as after a stop
                self.want_start, self._unable = False, True
                self.motion.hold(str(error))
                if now - self.sample_time > BAD_CYCLES * self.motion.limiter.dt:
                    self.motion.halt()
                return ""
            if self.sample is not NO_SAMPLE and clock < self.clock - SET_BACK:
                self._set_back(clock)
            if clock != self.clock or self.sample is NO_SAMPLE:
                self.sample, self.sample_time, self.clock = sample, now, clock
            self.linked = True
            self._judge(sample)
            self.motion.feel(sample.wrench, self.clock)
            self._compare(sample)
            if self.running and (why := robot.tool_changed()) and why != self.reason:
                self.motion.hold(why)
        elif self.watch.lost(now):
            if self.linked:
                self.motion.hold("link lost: the controller's clock stands still")
                self.motion.halt()
            self.linked = False
        if self.watch.hopeless(now) or not robot.connected:
            return self.reason if not self.linked else "link lost: connection closed"
        return ""

    def _set_back(self, clock: float) -> None:
        """The controller's clock was set back to `clock` [s]: how much time has passed is not known."""
        self.motion.hold(f"the controller's clock went back by {self.clock - clock:.1f} s; call resend_robot_program")
        self.motion.halt()

    def _judge(self, s: RobotState) -> None:
        why = link.unable(s.modes.robot_mode, s.modes.safety_bits)
        was_unable, self._unable = self._unable, bool(why)
        if why:
            self.want_start = False
        if not self.running:
            if why or was_unable:
                self.motion.hold(why or self._waiting)
            return
        if not why and s.modes.runtime_state != link.PLAYING:
            tool = self.robot.tool_changed() if self.robot is not None else ""  # our program ends at another TCP
            why = tool or "robot program stopped (pendant, watchdog or a program error)"
        if why:
            end = link.at_range_end(s.q)
            self.motion.hold(f"{why}: {end}" if end else why)
            self.running = self.freedrive = False
            if self.robot is not None:
                self.robot.clear_command()

    def _compare(self, s: RobotState) -> None:
        """Go on with the path as the robot does, and hold when the arm is not where it was sent.

        An arm that moves is braked first: its state may be late, and going back to it would be a jump.
        """
        stood = self.path.heard(self.clock, s.speed_scaling)
        if not self.running or self.freedrive:
            return
        far, turned = self.motion.off(s)
        c, why = self.config, ""
        if far > c.max_tracking_error:
            why = f"the arm is {far:.3f} m from its command (max_tracking_error {c.max_tracking_error:g} m)"
        elif turned > c.max_angular_tracking_error:
            why = f"the arm is {turned:.2f} rad from its command (max_angular_tracking_error "
            why += f"{c.max_angular_tracking_error:g} rad)"
        if why and not self.reason:
            self.motion.hold(f"{why}: see what blocks or slows it, then call resend_robot_program")
        # Where the path's time stands still a command that brakes would do so for ever.
        braking = self.reason and self.path.scale < STANDSTILL and not self.motion.limiter.still
        if stood or ((why or braking) and not _moves(s)):
            self.take_back(s)  # nothing is made up for

    def take_back(self, s: RobotState) -> None:
        """Command what is: the pose of this state, unless our model says that the arm is elsewhere."""
        if self._off_model(s) <= MODEL_TOLERANCE:
            self.motion.restart(s if self.robot is None else self.robot.meant(s))

    # the robot's clock, which that of a simulation shows to run slower than ours
    def held_back(self, now: float) -> float:
        """How far a simulated robot's clock is behind ours [s]; 0 of a real one, whose clock runs as ours."""
        if not self.config.simulated:
            return 0.0
        return now - self.clock - min(now - self.watch.advanced_at, STATE_PERIOD)

    # what may be asked
    def need_robot(self) -> Robot:
        """The robot, if there is a link to it."""
        if self.robot is None or not self.linked:
            raise LinkError(f"no link to the robot: {self.reason}")
        return self.robot

    def _need_program(self) -> Robot:
        robot = self.need_robot()
        if not self.running:
            raise LinkError(f"the robot program is not running ({self.reason}); call resend_robot_program")
        return robot

    def _need_rest(self) -> None:
        if not self.motion.limiter.still or self.motion.latch.following:
            raise LinkError("the arm is moving; call stop first")

    def start(self) -> str:
        """Program running with a clean command register, arm standing, targets accepted."""
        robot = self.need_robot()
        sample = robot.sample()  # refused while the newest state cannot be
        if not self.running:
            if robot.tells_tcp:  # before anything is sent; else it can only be known afterwards
                self._require_model(sample)
            with threads_above(self.config):
                robot.start_program()
            self._begin(robot)
        elif self.freedrive:
            raise LinkError("the arm is in freedrive; end it first")
        elif self.tool_differs:
            robot.tool = None
            robot.apply_tool(self.config)
        self.want_start, self._waiting = False, WAITING
        self.motion.accept_targets()
        return "robot program running, waiting for target_frame"

    @property
    def tool_differs(self) -> bool:
        """Whether the robot has to be told of TCP and payload again, and waited for, before anything moves."""
        return self.robot is not None and (self.robot.tool is None or bool(self.robot.tool_changed()))

    @property
    def start_is_due(self) -> bool:
        """Whether it is time to start the program by ourselves."""
        return self.want_start and not self.running and self.linked

    def attempt_failed(self, why: LinkError | RuntimeError) -> None:
        """A look at the robot, or a start by ourselves, has failed: from now on only a request starts the program.

        Where nobody was there, or the link broke, nothing was refused.
        """
        if isinstance(why, AbsentError) or (self.robot is not None and not self.robot.stays_connected()):
            self.motion.hold(str(why))
            return
        self.want_start = False
        self.motion.hold(f"{why}; then call resend_robot_program")

    def _require_model(self, s: RobotState) -> None:
        """Raise LinkError unless the arm is where our model of it says."""
        off = self._off_model(s)
        if off > MODEL_TOLERANCE:
            raise LinkError(
                f"model {self.config.model} puts the flange {off:.3f} m from where the robot says it is "
                f"(limit {MODEL_TOLERANCE} m): set model or calibration_file; known are {' and '.join(MODELS)}, "
                "no arm of a CB3"
            )

    def _off_model(self, s: RobotState) -> float:
        """How far [m] the flange of this state is from where its joints put that of our model."""
        return dist(s.p, self.motion.arm.forward(s.q)[:3, 3])

    def _begin(self, robot: Robot) -> None:
        """Command what is: the pose where the robot has the standing arm."""
        self.clock = robot.timestamp
        self.watch.restart(self.clock, time.monotonic())
        self.sample = s = robot.sample()
        self._require_model(s)
        self.motion.restart(robot.meant(s))
        self.path.restart(self.clock, s.speed_scaling)
        self.running = True

    def stop(self) -> str:
        """Decelerate and hold, in freedrive too."""
        self.want_start = False
        try:
            if self.freedrive:
                self.set_freedrive(False)
        finally:
            self.motion.hold("stopped on request")
        return "holding"

    def target_refused(self, reason: str) -> str:
        """The node has refused a target: whatever moves, decelerates."""
        if self.motion.latch.following:
            self.motion.hold(reason)
        return ""

    def hold(self, reason: str) -> str:
        """The node has found what no motion may begin with; what holds already keeps its reason."""
        if not self.reason:
            self.motion.hold(reason)
        return ""

    def wait_for(self, reason: str) -> str:
        """The node has found what is in the way of our program ('' for nothing): told while that is waited for."""
        before, self._waiting = self._waiting, reason or WAITING
        if self.reason == before:
            self.motion.hold(self._waiting)
        return ""

    def zero_ft(self) -> str:
        """Zero the force/torque sensor while the arm stands."""
        robot = self._need_program()
        self._need_rest()
        require(robot.control.zeroFtSensor(), "zero the force/torque sensor")
        return "force/torque sensor zeroed"

    def set_freedrive(self, on: bool) -> str:
        """Let the arm be pushed by hand, or hold it again; one that is not in freedrive is left as it is."""
        robot = self._need_program()
        if not on and not self.freedrive:
            return f"was not in freedrive: the arm {f'holds ({self.reason})' if self.reason else 'follows targets'}"
        if on and not self.freedrive:
            self._need_rest()
            require(robot.control.servoStop() and robot.control.freedriveMode(), "go into freedrive")
            self.motion.hold("freedrive")
        elif not on:
            require(robot.control.endFreedriveMode(), "leave freedrive")
            self._begin(robot)
            self.motion.hold("freedrive ended")
        self.freedrive = on
        return "freedrive" if on else "holding"

    def set_config(self, config: DriverConfig) -> str:
        """Take changed settings; a hold where the robot refuses those of its tool, as it works with others then."""
        before, self.config = self.config, config
        self.motion.configure(config)
        if self.robot is None:
            return ""
        self.robot.config = config
        if self.running and any(getattr(before, n) != getattr(config, n) for n in TOLD_TO_CONTROLLER):
            try:
                self.robot.apply_tool(config)
            except (LinkError, RuntimeError) as error:  # the latter is ur_rtde's
                self.robot.tool = None  # which is sent again before anything moves
                self.motion.hold(f"{error}; then call resend_robot_program")
                raise
        return ""

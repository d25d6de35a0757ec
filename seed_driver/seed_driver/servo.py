# SPDX-License-Identifier: Apache-2.0
"""The servo process (`python -m seed_driver.servo`, started by the supervisor): owns ur_rtde and streams to the robot.

A process of its own because ur_rtde may hold the GIL, hang or crash (docs/driver_inside.md). It ends itself when the
link is dead, before ur_rtde tries to reconnect; the node sees the end, reports it and starts a new one.
"""

import json
import os
import socket
import struct
import sys
import time
from contextlib import suppress
from typing import Any

from seed_core.errors import SeedError
from seed_driver.config import DriverConfig, from_json
from seed_driver.motion.calibrated_kinematics import arm_kinematics
from seed_driver.motion.servo_motion import ServoMotion
from seed_driver.process.cycle_timing import Deadlines, PeriodHistogram
from seed_driver.process.realtime import become_realtime, die_with_parent, threads_above
from seed_driver.process.shared_memory import (
    CRASHED,
    LARGEST_MESSAGE,
    LOST,
    ORPHANED,
    ServoState,
    SharedMemory,
    Stage,
    TargetSlot,
)
from seed_driver.robot.connection import Robot, load_ur_rtde
from seed_driver.robot.link import LinkError
from seed_driver.session import WAITING, Session

RETRY = 0.5  # [s] between looks at an address where nobody is
CHECK_EVERY = 5  # cycles between looks at messages
PUBLISH_EVERY = 2  # cycles between states for the node, where it wants no more


class ServoProcess:
    """One life of the servo process."""

    def __init__(self, memory: SharedMemory, wire: socket.socket, config: DriverConfig, start: bool) -> None:
        """wire: requests from the node, replies to it; start: whether the robot program is wanted at once."""
        self.memory, self.wire = memory, wire
        self.motion = ServoMotion(memory, arm_kinematics(config), config)
        self.session = Session(self.motion, config, start)
        self.periods = PeriodHistogram()
        self.cycles = self.sent = 0
        self.publish_every = PUBLISH_EVERY
        self.latency = 0.0  # [s] from receipt of a target to the first command that uses it
        self._timed_target: TargetSlot | None = None
        self._quitting = False
        self._version = ""
        self._published_reason = ""

    # life
    def run(self) -> None:
        """Search, then stream until the process ends."""
        self.publish(Stage.STARTING)
        with suppress(LinkError):  # the search tells it
            load_ur_rtde()  # now: from a cold disk it takes longer than the search may go without a heartbeat
        robot = self._search()
        self.session.robot = robot
        self._version = "{}.{}.{}.{}".format(*robot.version)
        self.motion.hold(WAITING)
        self.motion.limiter.dt = 1.0 / robot.rate
        self.publish_every = PUBLISH_EVERY if PUBLISH_EVERY * self.session.config.publish_rate <= robot.rate else 1
        start = time.monotonic()
        deadlines = Deadlines(self.motion.limiter.dt, start)
        self.session.watch.restart(robot.timestamp, start)
        while True:
            self.tick(robot, time.monotonic())
            deadline = deadlines.next(time.monotonic())
            time.sleep(max(0.0, deadline - time.monotonic()))

    def _search(self) -> Robot:
        """The robot, once it is there and can be used; the node hears from us meanwhile."""
        next_look = 0.0
        while True:
            self.publish(Stage.SEARCHING)
            self._hear()
            if time.monotonic() < next_look:
                time.sleep(0.02)
                continue
            config = self.session.config
            try:
                with threads_above(config):
                    return Robot(config)
            except (LinkError, RuntimeError) as error:
                self.session.attempt_failed(error)
            except (struct.error, ValueError, KeyError) as error:
                self.motion.hold(f"{config.robot_ip} answers like no UR controller: {error}")
            next_look = time.monotonic() + RETRY

    def tick(self, robot: Robot, now: float) -> None:
        """One cycle: the robot's state, the node's requests, the newest target, the command, our state."""
        s = self.session
        self.cycles += 1
        if end := s.listen(robot, now):
            self.end(LOST, end)
        if self.cycles % CHECK_EVERY == 0:
            self._hear()
            if s.start_is_due:
                try:
                    self._start()
                except (LinkError, RuntimeError) as error:
                    s.attempt_failed(error)
        held_back = s.held_back(now)
        self.motion.take_target(now - held_back, held_back)
        if s.running:
            self._command(robot, now)
        elif self._quitting:
            os._exit(0)
        if self.cycles % self.publish_every == 0 or s.reason != self._published_reason:
            self.publish(Stage.SERVOING if s.running else Stage.MONITORING)

    def _command(self, robot: Robot, now: float) -> None:
        self.periods.tick(now)
        if self.session.freedrive:
            robot.control.kickWatchdog()
            return
        if robot.taking:  # nothing is sent meanwhile: the command stays where the arm is
            self.session.take_back(self.session.sample)
        limiter, target = self.motion.limiter, self.motion.target
        if share := self.session.path.share(limiter.dt, self.motion.rise):
            self.motion.step(share)
        robot.servo(*self.motion.command, limiter.dt)
        self.sent += 1
        if target is not None and target is not self._timed_target:
            self.latency, self._timed_target = time.monotonic() - target.received, target
        if self._quitting and limiter.still:
            robot.close()
            os._exit(0)

    # requests of the node
    def _hear(self) -> None:
        while True:
            try:
                data = self.wire.recv(LARGEST_MESSAGE, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self._orphaned()
            message = json.loads(data)
            try:
                reply = {"id": message["id"], "ok": True, "text": self._do(message)}
            except (SeedError, RuntimeError, ValueError) as error:
                reply = {"id": message["id"], "ok": False, "text": str(error)}
            self.wire.send(json.dumps(reply).encode())

    def _do(self, message: dict[str, Any]) -> str:
        s = self.session
        match message["do"]:
            case "start":
                return self._start()
            case "stop":
                return s.stop()
            case "refuse":
                return s.target_refused(str(message["reason"]))
            case "hold":
                return s.hold(str(message["reason"]))
            case "wait":
                return s.wait_for(str(message["reason"]))
            case "zero_ft":
                return s.zero_ft()
            case "freedrive":
                return s.set_freedrive(bool(message["on"]))
            case "config":
                return s.set_config(from_json(message["config"]))
            case "periods":
                return json.dumps(self.periods.counts())
            case "quit":
                return self._quit()
        raise SeedError(f"unknown request {message['do']!r}")

    def _start(self) -> str:
        self.session.need_robot()
        if not self.session.running or self.session.tool_differs:  # both may take longer than we may be silent
            self.publish(Stage.BUSY)
        return self.session.start()

    def _quit(self) -> str:
        """Decelerate, end the program, end the process."""
        with suppress(LinkError, RuntimeError):  # a robot that does not leave freedrive: our program ends all the same
            self.session.stop()
        self.motion.hold("the driver is shutting down")
        self._quitting = True
        if self.session.robot is None:
            os._exit(0)
        return ""

    def _orphaned(self) -> None:
        robot = self.session.robot
        if robot is not None and robot.control is not None and self.session.running:
            robot.control.servoStop()
        self.end(ORPHANED, "the node is gone")

    # our state, for the node
    def publish(self, stage: Stage) -> None:
        """Write the state, and that we live."""
        s, m, now = self.session, self.motion, time.monotonic()
        state = ServoState(
            heartbeat=now,
            sample_time=s.sample_time,
            stage=stage,
            armed=not s.reason and stage == Stage.SERVOING,
            linked=s.linked,
            sample=s.sample,
            command=m.command,
            timestamp=s.clock,
            target_number=m.target.number if m.target is not None else 0,
            sent=self.sent,
            latency=self.latency,
            period_p50=self.periods.p50,
            period_p99=self.periods.p99,
            period_max=self.periods.largest,
            wants_start=s.want_start,
            version=self._version,
            reason=s.reason,
        )
        self.memory.write_state(state)
        self._published_reason = s.reason

    def end(self, code: int, reason: str) -> None:
        """End at once: ur_rtde's own clean-up may hang."""
        self.session.linked = False
        self.motion.hold(reason)
        self.publish(Stage.SEARCHING)
        os._exit(code)


def discard_output() -> None:
    """ur_rtde prints a line per failed call: nothing is printed, unless SEED_DRIVER_DEBUG is set."""
    if not os.environ.get("SEED_DRIVER_DEBUG"):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)


def main() -> int:
    """Arguments: file descriptors of the shared memory and of the message socket; the first message is the set-up."""
    die_with_parent()
    memory, wire = SharedMemory(int(sys.argv[1])), socket.socket(fileno=int(sys.argv[2]))
    setup = json.loads(wire.recv(LARGEST_MESSAGE))
    config = from_json(setup["config"])
    os.environ.setdefault("RES_OPTIONS", "timeout:1 attempts:1")  # a name server may be silent for longer than we are
    become_realtime(config)
    discard_output()
    process = ServoProcess(memory, wire, config, bool(setup["start"]))
    try:
        process.run()
    except RuntimeError as error:  # ur_rtde's word for a broken connection
        process.end(LOST, f"link lost: {error}")
    except Exception as error:
        process.end(CRASHED, f"servo process failed: {type(error).__name__}: {error}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

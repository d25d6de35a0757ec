# SPDX-License-Identifier: Apache-2.0
"""The servo process (`python -m seed_driver.servo`, started by supervisor.py): owns ur_rtde and streams to the robot.

A process of its own because ur_rtde may hold the GIL, hang or crash (docs/driver.md). It ends itself when the link
is dead, before ur_rtde tries to reconnect; the node sees the end, reports it and starts a new one.
"""

from __future__ import annotations

import ctypes
import gc
import json
import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import hypot
from typing import Any

from seed_core.errors import SeedError
from seed_core.ur_kinematics import KinematicsError
from seed_driver import link
from seed_driver.config import TOOL, DriverConfig, from_json
from seed_driver.kinematics import arm_kinematics
from seed_driver.limits import Bounds, Follower, Reference
from seed_driver.probe import LinkError
from seed_driver.robot import STATE_RATE, Robot, load
from seed_driver.rotation import pose_matrix
from seed_driver.shared import NO_SAMPLE, Sample, SharedMemory, Stage, TargetSlot
from seed_driver.timing import Periods

LOST, CRASHED, ORPHANED = 3, 4, 5  # exit codes
RETRY = 0.5  # [s] between looks at an address where nobody is
MODEL_TOLERANCE = 0.03  # [m] more is not calibration but the wrong model
CHECK_EVERY = 5  # cycles between looks at messages and connections


class ServoProcess:
    """One life of the servo process."""

    def __init__(self, memory: SharedMemory, wire: socket.socket, config: DriverConfig, start: bool) -> None:
        self.memory, self.wire, self.config = memory, wire, config
        self.arm = arm_kinematics(config)
        self.published_reason = ""
        self.timed_target: TargetSlot | None = None
        self.robot: Robot | None = None
        self.watch = link.LinkWatch()
        self.want_start = start
        self.armed = self.running = self.freedrive = False
        self.reason = "starting"
        self.linked = False
        self.sample: Sample | None = None
        self.follower = Follower((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 0.002)
        self.reference: Reference | None = None
        self.guard_q: list[float] = [0.0] * 6
        self.target: TargetSlot | None = None
        self.seen = 0  # number of the newest target that was looked at
        self.sent = 0
        self.latency = 0.0
        self.periods = Periods()
        self.quitting = False
        self.version = ""
        self.ticks = 0
        self.listen_every = 1
        self.unseen = 0.0  # [s] of motion since the joints were looked at
        self.calm = 0  # steps that need no look, because every joint is far below its limit
        self.sample_time = 0.0
        self.next_try = 0.0
        self.bounds = _bounds(config)

    # life
    def run(self) -> None:
        """Search, then stream until the process ends."""
        self.publish(Stage.STARTING, time.monotonic())
        self._require_library()
        while self.robot is None:
            self.publish(Stage.SEARCHING, time.monotonic())
            self._hear()
            try:
                with _threads_above(self.config):
                    self.robot = Robot(self.config)
            except (LinkError, RuntimeError) as error:
                self.reason = str(error)
                self._pause(RETRY)
        self.version = "{}.{}.{}.{}".format(*self.robot.look.version)
        self.reason = "waiting for the robot program"
        self.follower.dt = 1.0 / self.robot.rate
        self.listen_every = max(1, round(self.robot.rate / STATE_RATE))
        self._stream(self.robot)

    def _require_library(self) -> None:
        while True:
            try:
                load()
                return
            except LinkError as error:
                self.reason = str(error)
                self._pause(2.0)

    def _pause(self, seconds: float) -> None:
        """Wait, with a heart that beats."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.publish(Stage.SEARCHING, time.monotonic())
            self._hear()
            time.sleep(0.02)

    def _stream(self, robot: Robot) -> None:
        """The loop: absolute deadlines, late cycles are skipped, never caught up."""
        period = self.follower.dt
        deadline = time.monotonic()
        self.watch.advanced_at = deadline
        while True:
            now = time.monotonic()
            self.tick(robot, now)
            deadline += period
            late = time.monotonic() - deadline
            if late > 0.0:
                deadline += period * (late // period)
            time.sleep(max(0.0, deadline - time.monotonic()))

    def tick(self, robot: Robot, now: float) -> None:
        """One cycle."""
        self.ticks += 1
        if self.ticks % self.listen_every == 0:
            self._listen(robot, now)
        if self.ticks % CHECK_EVERY == 0:
            self._hear()
            self._start_if_wanted(now)
        self._follow(now)
        if self.running:
            self._command(robot, now)
        elif self.quitting:
            os._exit(0)
        if self.ticks % self.listen_every == 0 or self.reason != self.published_reason:
            self.publish(Stage.SERVOING if self.running else Stage.MONITORING, now)

    # what the robot says
    def _listen(self, robot: Robot, now: float) -> None:
        if self.watch.update(robot.timestamp, now):
            self.sample, self.sample_time = robot.sample(), now
            self.linked = True
            self._judge(self.sample)
        elif self.watch.lost(now):
            if self.linked:
                self.hold("link lost: the controller's clock stands still")
            self.linked = False
        if self.watch.hopeless(now) or not robot.connected:
            self._end(LOST, self.reason if not self.linked else "link lost: connection closed")

    def _judge(self, s: Sample) -> None:
        why = link.unable(s.modes.robot_mode, s.modes.safety_bits)
        if why:
            self.want_start = False
        if not self.running:
            if why:
                self.reason = why
            return
        if not why and s.modes.runtime_state != link.PLAYING:
            why = "robot program stopped (pendant, watchdog or a program error)"
        if why:
            self.hold(why)
            self.running = self.freedrive = False

    def hold(self, reason: str) -> None:
        """Decelerate to rest; only an explicit request moves the arm again."""
        self.reason, self.armed, self.reference = reason, False, None

    # what the node says
    def _hear(self) -> None:
        while True:
            try:
                data = self.wire.recv(65_536, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self._orphaned()
            message = json.loads(data)
            try:
                text = _REQUESTS[message["do"]](self, message)
                reply = {"id": message["id"], "ok": True, "text": text}
            except (SeedError, RuntimeError, ValueError) as error:
                reply = {"id": message["id"], "ok": False, "text": str(error)}
            self.wire.send(json.dumps(reply).encode())

    def _orphaned(self) -> None:
        if self.robot is not None and self.robot.control is not None and self.running:
            self.robot.control.servoStop()
        self._end(ORPHANED, "the node is gone")

    def _need_robot(self) -> Robot:
        if self.robot is None or not self.linked:
            raise LinkError(f"no link to the robot: {self.reason}")
        return self.robot

    def _need_program(self) -> Robot:
        robot = self._need_robot()
        if not self.running:
            raise LinkError(f"the robot program is not running ({self.reason}); call resend_robot_program")
        return robot

    def _need_rest(self) -> None:
        if not self.follower.still or (self.armed and self.reference is not None):
            raise LinkError("the arm is moving; call stop first")

    def start(self, _: dict[str, Any]) -> str:
        """Program running with a clean command register, arm standing, targets accepted."""
        robot = self._need_robot()
        if not self.running:
            self.publish(Stage.BUSY, time.monotonic())
            with _threads_above(self.config):
                robot.start_program()
            self._begin(robot)
        elif self.freedrive:
            raise LinkError("the arm is in freedrive; end it first")
        self.armed, self.reason, self.want_start = True, "", False
        self.seen = self._newest_number()
        self.target = None
        return "robot program running, waiting for target_frame"

    def _newest_number(self) -> int:
        slot = self.memory.read_target(0)
        return slot.number if slot is not None else self.seen

    def _begin(self, robot: Robot) -> None:
        """Command what is: the pose where the arm stands now."""
        now = time.monotonic()
        self.watch.update(robot.timestamp, now)
        self.sample = s = robot.sample()
        expected = self.arm.forward(s.q)[:3, 3]
        off = hypot(*(float(a - b) for a, b in zip(expected, s.p, strict=True)))
        if off > MODEL_TOLERANCE:
            raise LinkError(
                f"model {self.config.model} puts the flange {off:.3f} m from where the robot says it is "
                f"(limit {MODEL_TOLERANCE} m): set model or calibration_file"
            )
        self.follower.restart(s.p, s.orientation)
        self.guard_q, self.reference, self.running = list(s.q), None, True
        self.watch.advanced_at, self.watch.ticks_since = now, 0

    def _start_if_wanted(self, now: float) -> None:
        if not self.want_start or self.running or not self.linked or now < self.next_try:
            return
        try:
            self.start({})
        except (LinkError, RuntimeError) as error:
            self.reason = str(error)
            self.next_try = time.monotonic() + 1.0

    def stop(self, _: dict[str, Any]) -> str:
        """Decelerate and hold."""
        self.want_start = False
        self.hold("stopped on request")
        return "holding"

    def refuse(self, message: dict[str, Any]) -> str:
        """The node has refused a target: whatever moves, decelerates."""
        if self.armed and self.reference is not None:
            self.hold(str(message["reason"]))
        return ""

    def zero_ft(self, _: dict[str, Any]) -> str:
        """Zero the force/torque sensor while the arm stands."""
        robot = self._need_program()
        self._need_rest()
        if not robot.control.zeroFtSensor():
            raise LinkError("the controller did not zero the force/torque sensor")
        return "force/torque sensor zeroed"

    def set_freedrive(self, message: dict[str, Any]) -> str:
        """Let the arm be pushed by hand, or hold it again."""
        robot, on = self._need_program(), bool(message["on"])
        if on and not self.freedrive:
            self._need_rest()
            self.hold("freedrive")
            robot.control.servoStop()
            robot.control.freedriveMode()
        elif not on and self.freedrive:
            robot.control.endFreedriveMode()
            self._begin(robot)
            self.reason = "freedrive ended"
        self.freedrive = on
        return "freedrive" if on else "holding"

    def set_config(self, message: dict[str, Any]) -> str:
        """Take changed settings."""
        before, self.config = self.config, from_json(message["config"])
        self.bounds = _bounds(self.config)
        if self.robot is None:
            return ""
        self.robot.config = self.config
        if self.running and any(getattr(before, n) != getattr(self.config, n) for n in TOOL):
            self.robot.apply_tool(self.config)
        return ""

    def report_periods(self, _: dict[str, Any]) -> str:
        """The distribution of the cycle's period so far."""
        return json.dumps(self.periods.histogram())

    def quit(self, _: dict[str, Any]) -> str:
        """Decelerate, end the program, end the process."""
        self.hold("the driver is shutting down")
        self.want_start, self.quitting = False, True
        if self.robot is None:
            os._exit(0)
        return ""

    # motion
    def _follow(self, now: float) -> None:
        """Look for a new target; none for too long is a stop."""
        if not self.armed:
            return
        slot = self.memory.read_target(self.seen)
        if slot is not None and slot.number > self.seen:
            self.seen, self.target = slot.number, slot
            if self.reference is None:
                self.reference = Reference(self.follower.inner_p, self.follower.inner_q)
            self.reference.set_goal(slot.p, slot.q, slot.received, self.config.command_timeout)
        elif self.reference is not None and self.target is not None:
            silent = now - self.target.received
            if silent > self.config.command_timeout:
                self.hold(f"no target_frame for {self.config.command_timeout} s")

    def _command(self, robot: Robot, now: float) -> None:
        self.periods.tick(now)
        if self.freedrive:
            robot.control.kickWatchdog()
            return
        f = self.follower
        feed = self.reference.step(f.dt) if self.reference is not None else ((0.0,) * 3, (0.0,) * 3)
        f.propose(self.reference, feed, self.bounds)
        if any(f.velocity) or any(f.turning):
            if self.unseen < self.calm * f.dt:
                self.unseen += f.dt
            else:
                self._guard_joints(self.unseen)
                self.unseen = 0.0
        f.advance(self.bounds)
        robot.servo(f.p, f.q, f.dt)
        self.sent += 1
        if self.target is not None and self.target is not self.timed_target:
            self.latency, self.timed_target = time.monotonic() - self.target.received, self.target
        if self.quitting and f.still:
            robot.close()
            os._exit(0)

    def _guard_joints(self, unseen: float) -> None:
        """Slow down where a joint would be too fast (near singularities); stop where there is no way."""
        f = self.follower
        try:
            q = self.arm.follow(pose_matrix(*f.next_pose()), self.guard_q)
            share = self._joint_share(q, f.dt + unseen)
            self.calm = 3 if share > 8.0 else int(share > 3.0)
            if share < 1.0:
                f.slow(share)
                q = self.arm.follow(pose_matrix(*f.next_pose()), self.guard_q)
                if self._joint_share(q, f.dt + unseen) < 0.9:
                    f.slow(0.0)  # a branch ends here
                    return
            self.guard_q = q
        except KinematicsError as error:
            f.slow(0.0)
            self.hold(str(error))

    def _joint_share(self, q: list[float], dt: float) -> float:
        """Share of the step that keeps every joint within its speed; above 1: room to spare."""
        own, top = self.arm.model.speed, self.config.max_joint_speed
        pairs = zip(q, self.guard_q, own, strict=True)
        return min(min(top, limit) * dt / max(1e-12, abs(a - b)) for a, b, limit in pairs)

    # what the node gets
    def publish(self, stage: Stage, now: float) -> None:
        """Write the state."""
        f = self.follower
        number = self.target.number if self.target is not None else 0
        self.memory.write_state(
            (now, self.sample_time, self.ticks, stage, self.armed and stage == Stage.SERVOING, self.linked),
            self.sample if self.sample is not None else NO_SAMPLE,
            (*f.p, *f.q),
            (max(0.0, self.watch.timestamp), number, self.sent, self.latency),
            (self.periods.p50, self.periods.p99, self.periods.largest),
            self.version,
            self.reason,
        )
        self.published_reason = self.reason

    def _end(self, code: int, reason: str) -> None:
        """End at once: ur_rtde's own clean-up may hang."""
        self.linked = self.armed = False
        self.reason = reason
        self.publish(Stage.SEARCHING, time.monotonic())
        os._exit(code)


_REQUESTS: dict[str, Callable[[ServoProcess, dict[str, Any]], str]] = {
    "start": ServoProcess.start,
    "stop": ServoProcess.stop,
    "refuse": ServoProcess.refuse,
    "zero_ft": ServoProcess.zero_ft,
    "freedrive": ServoProcess.set_freedrive,
    "config": ServoProcess.set_config,
    "periods": ServoProcess.report_periods,
    "quit": ServoProcess.quit,
}


def _bounds(c: DriverConfig) -> Bounds:
    low, high = c.workspace_low, c.workspace_high
    return Bounds(
        c.max_speed,
        c.max_turning,
        c.max_acceleration,
        c.max_turning_acceleration,
        c.max_jerk,
        (low[0], low[1], low[2]),
        (high[0], high[1], high[2]),
    )


def _realtime(config: DriverConfig, above: int = 0) -> None:
    """Real-time priority and one processor, when the system allows it."""
    try:
        if config.cpu >= 0:
            os.sched_setaffinity(0, {config.cpu})
        if config.realtime_priority > 0:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(config.realtime_priority + above))
    except OSError:
        pass  # ordinary users may not; timing is measured and shown in the diagnostics


@contextmanager
def _threads_above(config: DriverConfig) -> Iterator[None]:
    """Threads made in the block get a higher priority than ours: ur_rtde spins until they have received something."""
    _realtime(config, above=1)
    try:
        yield
    finally:
        _realtime(config)


def main() -> int:
    """Arguments: file descriptors of the shared memory and of the message socket; the first message is the set-up."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: never outlive the node
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the node decides when to end
    memory = SharedMemory(int(sys.argv[1]))
    wire = socket.socket(fileno=int(sys.argv[2]))
    setup = json.loads(wire.recv(65_536))
    config = from_json(setup["config"])
    gc.freeze()
    gc.disable()
    _realtime(config)
    if not os.environ.get("SEED_DRIVER_DEBUG"):
        silence = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silence, 1)
        os.dup2(silence, 2)  # ur_rtde prints a line per failed call
    process = ServoProcess(memory, wire, config, bool(setup["start"]))
    try:
        process.run()
    except RuntimeError as error:  # ur_rtde's word for a broken connection
        process._end(LOST, f"link lost: {error}")
    except Exception as error:
        process._end(CRASHED, f"servo process failed: {type(error).__name__}: {error}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: Apache-2.0
"""The servo process without a robot: the order in which it starts, and what becomes of a start that fails."""

import os
import signal
import socket
import subprocess
import time

import pytest

from seed_driver import servo
from seed_driver.config import DriverConfig
from seed_driver.process.shared_memory import SharedMemory, Stage
from seed_driver.process.supervisor import Supervisor
from seed_driver.robot.link import LinkError


def test_ur_rtde_is_loaded_while_the_process_starts_which_may_take_long(monkeypatch) -> None:
    memory, stages = SharedMemory.create(), []
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)

    def load() -> None:
        stages.append(memory.read_state().stage)
        raise LinkError("not installed")  # which is told by the search, again and again

    def search() -> None:
        stages.append("searching")
        raise RuntimeError("far enough")

    with ours, theirs:
        process = servo.ServoProcess(memory, theirs, DriverConfig(robot_ip="127.0.0.1"), start=False)
        monkeypatch.setattr(servo, "load_ur_rtde", load)
        monkeypatch.setattr(process, "_search", search)
        with pytest.raises(RuntimeError, match="far enough"):
            process.run()
    memory.close()
    assert stages == [Stage.STARTING, "searching"]


def no_more(*_: object, **__: object) -> None:
    raise OSError("no more processes")


def test_a_process_that_cannot_be_started_again_is_tried_later(monkeypatch) -> None:
    """A system that is out of processes or memory for a while must not end the node."""
    supervisor = Supervisor(DriverConfig(robot_ip="127.0.0.9"))
    supervisor.start(start_program=False)
    try:
        os.kill(supervisor.pid, signal.SIGKILL)
        while not supervisor.deaths:
            supervisor.step(time.monotonic())
        with monkeypatch.context() as meanwhile:
            meanwhile.setattr(subprocess, "Popen", no_more)
            state = supervisor.step(time.monotonic() + 1.0)
        assert (state.linked, state.reason) == (False, "servo process cannot be started: no more processes")
        supervisor.step(time.monotonic() + 3.0)
        assert supervisor.pid is not None
    finally:
        supervisor.close()


def test_a_start_that_fails_leaves_nothing_open(monkeypatch) -> None:
    supervisor, before = Supervisor(DriverConfig(robot_ip="127.0.0.9")), os.listdir("/proc/self/fd")
    monkeypatch.setattr(subprocess, "Popen", no_more)
    with pytest.raises(OSError, match="no more processes"):
        supervisor.start(start_program=False)
    assert os.listdir("/proc/self/fd") == before

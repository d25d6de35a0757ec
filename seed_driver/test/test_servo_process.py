# SPDX-License-Identifier: Apache-2.0
"""The servo process without a robot: the order in which it starts."""

import socket

import pytest

from seed_driver import servo
from seed_driver.config import DriverConfig
from seed_driver.process.shared_memory import SharedMemory, Stage
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

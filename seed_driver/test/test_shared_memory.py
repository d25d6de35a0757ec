# SPDX-License-Identifier: Apache-2.0
"""The shared memory hands over whole values only, leaves nothing behind, and survives a writer that dies."""

import mmap
import os
import signal
import time

from seed_driver.process.shared_memory import RobotState, ServoState, SharedMemory, Stage, TargetSlot


def test_targets_and_states_come_out_as_they_went_in() -> None:
    memory = SharedMemory.create()
    target = TargetSlot(3, 12.5, (0.1, 0.2, 0.3), (0.0, 0.6, 0.0, 0.8))
    memory.write_target(target)
    assert memory.read_target(2) == target
    assert memory.read_target(3) is None
    sample = RobotState()._replace(q=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0), speed_scaling=0.5)
    head = (9.0, 8.0, Stage.SERVOING, True, False, sample)
    command, words = ((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0)), (True, "5.12.4", "grüße")
    state = ServoState(*head, command, 4.0, 5, 6, 0.7, 0.1, 0.2, 0.3, *words)
    memory.write_state(state)
    assert memory.read_state() == state
    memory.close()


def test_a_long_reason_comes_out_whole() -> None:
    memory = SharedMemory.create()
    reason = 400 * "x" + "; call resend_robot_program"
    memory.write_state(ServoState(reason=reason))
    state = memory.read_state()
    assert state is not None
    assert state.reason == reason
    memory.close()


def test_a_value_of_which_one_part_is_old_is_not_read() -> None:
    memory = SharedMemory.create()
    memory.write_target(TargetSlot(7, 7.0, (7.0, 7.0, 7.0), (0.0, 0.0, 0.0, 1.0)))
    with mmap.mmap(memory.fd, 0) as other:
        whole = other[:80]
        for i in range(16, 72):  # behind the number and the time
            other[i] ^= 0x40
            assert memory.read_target(0) is None
            other[:80] = whole
    assert memory.read_target(0) is not None
    memory.close()


def test_a_reader_never_sees_half_a_target() -> None:
    memory = SharedMemory.create()
    child = os.fork()
    if child == 0:
        number = 0
        while True:
            number += 1
            x = float(number)
            memory.write_target(TargetSlot(number, x, (x, x, x), (x, x, x, x)))
    try:
        seen, until = set(), time.monotonic() + 30.0  # a busy machine may give the writer little time
        while len(seen) <= 100 and time.monotonic() < until:
            target = memory.read_target(0)
            if target is not None:
                assert {target.number, target.received, *target.p, *target.q} == {float(target.number)}
                seen.add(target.number)
        assert len(seen) > 100
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    # the writer was killed anywhere, perhaps in the middle: a new one is heard all the same
    memory.write_target(TargetSlot(10**9, 1.0, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0)))
    assert memory.read_target(0) == TargetSlot(10**9, 1.0, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))
    memory.close()


def test_closing_leaves_no_file_and_no_descriptor() -> None:
    before = set(os.listdir("/proc/self/fd")), set(os.listdir("/dev/shm"))
    memory = SharedMemory.create()
    memory.close()
    assert (set(os.listdir("/proc/self/fd")), set(os.listdir("/dev/shm"))) == before

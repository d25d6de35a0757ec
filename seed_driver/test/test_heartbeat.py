# SPDX-License-Identifier: Apache-2.0
"""A process without a heartbeat is found out by what it is doing, and one that starts slowly is given its time."""

import subprocess
import sys
import time

import pytest

from seed_driver.process.heartbeat import IDLE, LONGEST_START, SILENT, Heartbeat
from seed_driver.process.shared_memory import ServoState, Stage
from seed_driver.process.supervisor import exit_reason

FINE, GONE, HOPELESS = (False, False), (True, False), (True, True)


@pytest.mark.parametrize("stage", SILENT)
def test_a_silent_process_counts_as_gone_and_then_as_hopeless(stage: Stage) -> None:
    heart, last, patience = Heartbeat(), ServoState(heartbeat=100.0, stage=stage), SILENT[stage]
    assert heart.doubts(100.0 + 0.99 * patience.gone, last) == FINE
    assert heart.doubts(100.0 + 1.01 * patience.gone, last) == GONE
    assert heart.doubts(100.0 + 1.01 * patience.hopeless, last) == HOPELESS


def test_a_start_that_does_not_get_on_is_told_from_a_slow_one() -> None:
    starting = ServoState(heartbeat=0.0, stage=Stage.STARTING)
    command = [sys.executable, "-c", "print(flush=True); input()"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        time.sleep(0.3)  # it waits for its input by now
        heart = Heartbeat()
        heart.restart(process.pid, 100.0)
        heart.doubts(100.0, starting)
        assert heart.doubts(100.0 + 1.01 * IDLE.gone, starting)[0]
        assert heart.doubts(100.0 + 1.01 * IDLE.hopeless, starting)[1]
        process.communicate(b"\n")
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as process:
        heart.restart(process.pid, 100.0)
        for t in range(int(LONGEST_START)):
            assert heart.doubts(100.0 + t, starting) == FINE
        assert heart.doubts(100.0 + 1.01 * LONGEST_START, starting) == HOPELESS
        heart.restart(process.pid, 200.0)
        assert heart.doubts(200.0 + 1.01 * LONGEST_START, starting) == FINE  # the next has twice the time
        process.kill()


def test_a_process_that_has_ended_is_not_idle() -> None:
    with subprocess.Popen(["true"]) as process:
        process.wait()
    heart = Heartbeat()
    heart.restart(process.pid, 100.0)
    assert heart.doubts(130.0, ServoState(stage=Stage.STARTING)) == FINE


@pytest.mark.parametrize(
    ("code", "words"),
    [(3, "ended with code 3"), (-11, "died of SIGSEGV"), (-34, "died of SIGRTMIN"), (-40, "died of signal 40")],
)
def test_an_end_has_words_for_every_code(code: int, words: str) -> None:
    assert exit_reason(code) == f"servo process {words}"

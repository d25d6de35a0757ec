# SPDX-License-Identifier: Apache-2.0
"""Runs inputs against a node, and shrinks a sequence after which it fails to the inputs that it takes."""

import gc
import os
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from seed_testing.fuzz.scenes import subject
from seed_testing.fuzz.subject import Step, Subject

CALM = 15  # inputs from one good sequence to the next
TOPICS = 0.75  # share of inputs that are messages; the others are services, actions, parameters and the clock
SHRINKS = 60  # attempts, and
SHRINK_TIME = 40.0  # [s] that shrinking may take
BLOCKS = 0.2  # of Python's memory that an input may leave behind, once warm,
SPARE = 20_000  # beyond these: bounded queues still fill
MEGABYTES = 40.0  # that the process may grow by, once warm


@dataclass
class Failure:
    """One way to fail: where, how often, and the shortest inputs that were found for it."""

    words: str
    steps: list[Step]
    trace: str
    count: int = 1


@dataclass
class Findings:
    """What inputs did to a node."""

    inputs: int = 0
    longest: float = 0.0  # [s] of processor time for one input
    blocks: int = 0  # of memory that the second half of the inputs left behind
    megabytes: float = 0.0  # by which the process grew meanwhile
    failures: dict[str, Failure] = field(default_factory=dict)

    @property
    def grows(self) -> bool:
        """Whether the node keeps something of every input."""
        return self.blocks > SPARE + BLOCKS * self.inputs or self.megabytes > MEGABYTES


def fuzz(name: str, inputs: int, seed: int, make: Callable[[str], Subject] = subject) -> Findings:
    """Put inputs into the node of that name, until all are in; after a failure a new node goes on."""
    rng, found = Random(f"{seed} {name}"), Findings()
    half = (0, 0.0)
    under, begin, state = make(name), 0, rng.getstate()
    try:
        for number in range(inputs):
            if number == inputs // 2:
                half = _memory()
            step = drawn(rng, under, number)
            words, trace = outcome(under, step)
            if not words:
                continue
            if words in found.failures:
                found.failures[words].count += 1
            else:
                again = Random()
                again.setstate(state)  # the steps since the node was made; a list of all would be growth
                steps = [drawn(again, under, n) for n in range(begin, number + 1)]
                found.failures[words] = Failure(words, steps, trace)
            found.longest = max(found.longest, under.longest)
            under.close()
            under, begin, state = make(name), number + 1, rng.getstate()
        blocks, size = _memory()
        found.inputs, found.longest = inputs, max(found.longest, under.longest)
        found.blocks, found.megabytes = blocks - half[0], size - half[1]
    finally:
        under.close()
    for failure in found.failures.values():
        failure.steps = shrunk(failure, lambda: make(name))
    return found


def drawn(rng: Random, under: Subject, number: int) -> Step:
    """The next input."""
    seed = rng.getrandbits(32)
    if number % CALM == 0:
        return Step("calm", "cell", seed)
    topics = [key for key in under.inputs if key[0] == "in"]
    others = [key for key in under.inputs if key[0] not in ("in", "calm")]
    what, name = rng.choice(topics) if topics and rng.random() < TOPICS else rng.choice(others)
    return Step(what, name, seed)


def outcome(under: Subject, step: Step) -> tuple[str, str]:
    """What came out of an input: a word for the way it failed and the whole of it; '' if it was borne."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # NumPy tells of overflows that are refused afterwards
            under.apply(step)
    except Exception as error:  # anything: that is what is looked for
        return _signature(error), traceback.format_exc()
    return "", ""


def _signature(error: Exception) -> str:
    """Kind of the error and the line of ours that it comes from."""
    ours = [
        f for f in traceback.extract_tb(error.__traceback__) if "/seed_" in f.filename and "/fuzz/" not in f.filename
    ]
    at = f"{'/'.join(Path(ours[-1].filename).parts[-3:])}:{ours[-1].lineno}" if ours else "rclpy"
    words = "".join(c for c in str(error)[:80] if not c.isdigit())
    return f"{type(error).__name__} at {at}: {words}"


def shrunk(failure: Failure, make: Callable[[], Subject]) -> list[Step]:
    """Fewer steps after which a new node fails in the same way: ends first, then halves, quarters and single ones."""
    deadline, tries = time.monotonic() + SHRINK_TIME, SHRINKS

    def fails(steps: Sequence[Step]) -> bool:
        nonlocal tries
        if tries <= 0 or time.monotonic() > deadline:
            return False
        tries -= 1
        under = make()
        try:
            return any(outcome(under, step)[0] == failure.words for step in steps)
        finally:
            under.close()

    steps = failure.steps
    for length in (1, 2, 4, CALM, 4 * CALM):
        if length < len(steps) and fails(steps[-length:]):
            steps = steps[-length:]
            break
    chunk = len(steps) // 2
    while chunk >= 1:
        at = 0
        while at < len(steps) - 1:  # the last one is where it fails
            fewer = steps[:at] + steps[at + chunk :]
            if fewer and fewer[-1] == steps[-1] and fails(fewer):
                steps = fewer
            else:
                at += chunk
        chunk //= 2
    return steps


def _memory() -> tuple[int, float]:
    """Blocks of Python's memory in use, and the size of the process [MB]."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return sys.getallocatedblocks(), pages * os.sysconf("SC_PAGE_SIZE") / 1e6

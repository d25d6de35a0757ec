# SPDX-License-Identifier: Apache-2.0
"""Every file that the suite reads, spoilt: values, keys, lines and bytes; only a refusal in words may come out."""

import dataclasses
import json
import math
import time
import traceback
import warnings
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from seed_core.errors import SeedError
from seed_testing.fuzz.nonsense import real, text
from seed_testing.fuzz.readers import READERS, Reader
from seed_testing.fuzz.run import Failure, Findings
from seed_testing.fuzz.subject import LONGEST, FuzzError, Step

YAML_WORDS: tuple[str, ...] = (
    "",
    "~",
    "[]",
    "{}",
    "&a [*a]",
    "!!python/object:os.system {}",
    "1e400",
    ".nan",
    "- - -",
    "'",
    "yes",
    "0x",
)
YAML_WORDS += ("2026-01-01", "1_0", "? a", "!!binary abc", "!!timestamp x", "0o9", "1:30", "<<: 1", "!!set {a}", "=")
LARGE = 300  # items of a list that is far too long


def value(rng: Random) -> Any:
    """A value of any kind that YAML or JSON knows."""
    kinds: tuple[Callable[[], Any], ...] = (
        lambda: real(rng),
        lambda: text(rng).replace("\0", ""),
        lambda: rng.choice((None, True, False, 0, -1, 10**30, 10**400, 2**63)),
        lambda: [real(rng) for _ in range(rng.choice((0, 1, 2, 3, 4, 6, LARGE)))],
        lambda: {text(rng).replace("\0", ""): real(rng)},
        lambda: [[[]]],
    )
    return rng.choice(kinds)()


def spoil_tree(rng: Random, tree: Any) -> Any:
    """A tree of which one value, key or item, at any depth, is another."""
    if isinstance(tree, dict) and tree and rng.random() < 0.9:
        key = rng.choice(list(tree))
        chance = rng.random()
        if chance < 0.08:
            return {k: v for k, v in tree.items() if k != key}
        if chance < 0.14:
            return {**tree, rng.choice(("extra", key + "s", "")): value(rng)}
        return {**tree, key: spoil_tree(rng, tree[key])}
    if isinstance(tree, list) and tree and rng.random() < 0.85:
        at = rng.randrange(len(tree))
        chance = rng.random()
        if chance < 0.1:
            return tree[:at] + tree[at + 1 :]
        if chance < 0.2:
            return [*tree, *tree]
        return [*tree[:at], spoil_tree(rng, tree[at]), *tree[at + 1 :]]
    return value(rng)


def spoil_text(rng: Random, data: str) -> str:
    """Text of which a line is cut, doubled, moved or replaced by what a reader may trip over."""
    lines = data.split("\n")
    at = rng.randrange(len(lines))
    what = rng.randrange(5)
    if what == 0:
        return data[: rng.randrange(len(data) + 1)]
    if what == 1:
        lines.insert(at, lines[rng.randrange(len(lines))])
    elif what == 2:
        del lines[at]
    elif what == 3:
        key = lines[at].partition(":")[0]
        lines[at] = f"{key}: {rng.choice(YAML_WORDS)}"
    else:
        lines[at] = lines[at].replace(" ", rng.choice(("\t", "", "   ", "\u2028", "\0")), 1)
    return "\n".join(lines)


def spoil_bytes(rng: Random, data: bytes) -> bytes:
    """Bytes that are cut short or of which some are others."""
    if rng.random() < 0.3 or not data:
        return data[: rng.randrange(len(data) + 1)]
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        out[rng.randrange(len(out))] = rng.randrange(256)
    return bytes(out)


def spoilt(rng: Random, reader: Reader) -> bytes:
    """The bytes of one file for a reader."""
    good = rng.choice(reader.examples)
    chance = rng.random()
    if reader.kind == "bytes" or chance < 0.1:
        return spoil_bytes(rng, good)
    if reader.kind == "text" or chance < 0.35:
        return spoil_text(rng, good.decode()).encode()
    if reader.kind == "lines":
        lines = good.decode().split("\n")
        at = rng.randrange(len(lines) - 1)
        lines[at] = json.dumps(spoil_tree(rng, json.loads(lines[at])))
        return "\n".join(lines).encode()
    tree = yaml.load(good, yaml.CSafeLoader) if hasattr(yaml, "CSafeLoader") else yaml.safe_load(good)
    for _ in range(rng.choice((1, 1, 1, 2))):
        tree = spoil_tree(rng, tree)
    return yaml.safe_dump(tree, sort_keys=False, allow_unicode=True).encode()


def outcome(reader: Reader, file: Path) -> tuple[str, str]:
    """What came out of a file: a word for the way it failed and the whole of it; '' if it was read or refused."""
    began = time.thread_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read = reader.read(file)
        if not finite(read):
            raise FuzzError(f"{reader.name} is read with a value that is not finite")
        if time.thread_time() - began > LONGEST:
            raise FuzzError(f"{reader.name} takes {time.thread_time() - began:.1f} s of processor time")
    except FuzzError as error:
        return str(error), traceback.format_exc()
    except SeedError as error:
        return ("", "") if str(error) else ("refused without a word", traceback.format_exc())
    except Exception as error:  # anything: that is what is looked for
        at = [f for f in traceback.extract_tb(error.__traceback__) if "/seed_" in f.filename][-1]
        return f"{type(error).__name__} at {Path(at.filename).name}:{at.lineno}", traceback.format_exc()
    return "", ""


def finite(read: Any) -> bool:
    """Whether every number of a dataclass, list or mapping is one."""
    if isinstance(read, float):
        return math.isfinite(read)
    if dataclasses.is_dataclass(read) and not isinstance(read, type):
        return all(finite(getattr(read, f.name)) for f in dataclasses.fields(read))
    if isinstance(read, dict):
        return all(map(finite, read.values()))
    return not isinstance(read, list | tuple) or all(map(finite, read))


def fuzz_files(inputs: int, seed: int) -> dict[str, Findings]:
    """Findings by kind of file; the inputs are shared out evenly."""
    out = {}
    with TemporaryDirectory() as folder, chdir(folder):  # readers that look for a name find nothing of ours
        for reader in READERS():
            rng, found = Random(f"{seed} {reader.name}"), Findings()
            file = Path(folder, f"file{reader.suffix}")
            for _ in range(max(1, inputs // len(READERS()))):
                at = rng.getrandbits(32)
                file.write_bytes(spoilt(Random(at), reader))
                began = time.thread_time()
                words, trace = outcome(reader, file)
                found.longest = max(found.longest, time.thread_time() - began)
                found.inputs += 1
                if words in found.failures:
                    found.failures[words].count += 1
                elif words:
                    found.failures[words] = Failure(words, [Step("file", reader.name, at)], trace)
            out[reader.name] = found
    return out

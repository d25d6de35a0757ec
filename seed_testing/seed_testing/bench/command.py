# SPDX-License-Identifier: Apache-2.0
"""./seed bench: figures of speed on this machine, from each package's own benchmark."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
from collections.abc import Mapping
from typing import Any

from seed_core.command_line import Help, command
from seed_core.errors import SeedError

# Name on the command line, and the module whose run() returns nested numbers, names ending in their unit.
BENCHES = {
    "estimator": "seed_testing.bench.estimator",
    "control": "seed_testing.bench.control",
    "driver": "seed_testing.bench.driver",
    "node": "seed_testing.bench.pose_age",
}


def available() -> dict[str, str]:
    """The benchmarks that are installed."""
    return {name: module for name, module in BENCHES.items() if _exists(module)}


def _exists(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        return False


def run(names: list[str]) -> dict[str, Any]:
    """Results by name; all that are installed when none is named.

    Raises:
        SeedError: a name that is no benchmark here.
    """
    there = available()
    for name in names:
        if name not in there:
            raise SeedError(f"no benchmark '{name}'; there are: {', '.join(there) or 'none'}")
    return {name: importlib.import_module(there[name]).run() for name in names or there}


def lines(values: Mapping[str, Any], indent: str = "  ") -> list[str]:
    """Nested results as indented lines."""
    out = []
    for key, value in values.items():
        if isinstance(value, Mapping):
            out += [f"{indent}{key}", *lines(value, indent + "  ")]
        else:
            text = f"{value:.4g}" if isinstance(value, float) else str(value)
            out.append(f"{indent}{key:<{max(1, 44 - len(indent))}} {text}")
    return out


@command("seed bench")
def main(argv: list[str]) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="seed bench", description=__doc__, formatter_class=Help)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(available())}; all if none is given")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    options = parser.parse_args(argv)
    results = run(options.names)
    if options.json:
        print(json.dumps(results))
    else:
        for name, values in results.items():
            print("\n".join([name, *lines(values)]))
    return 0

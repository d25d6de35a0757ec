# SPDX-License-Identifier: Apache-2.0
"""All runs of a comparison on this machine's cores; each is kept in a file as it ends, and none is repeated."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from joblib import delayed

from seed_sim.campaigns import keep_run, kept_runs
from seed_sim.closed_loop.progress import in_parallel
from seed_sim.comparison.run import Run, scored
from seed_sim.comparison.tuning import Work


def scored_in_parallel(works: list[Work], jobs: int) -> Iterator[dict[str, Any]]:
    """The rows of all of them, as they end."""
    yield from in_parallel([delayed(scored)(run, s) for run, s in works], jobs, "run", ordered=False)


def campaign(works: list[Work], jobs: int, file: Path) -> list[dict[str, Any]]:
    """Every run, in the order of `works`; those that the file has with the same settings are taken from it.

    Raises:
        SeedError: the file is none of runs.
    """
    known = _known(file)
    missing = [(run, s) for run, s in works if known.get(run.key, {}).get("settings") != dict(s)]
    for row in scored_in_parallel(missing, jobs):
        keep_run(file, json.dumps(row))
        known[_key(row)] = row
    return [known[run.key] for run, _ in works]


def _key(row: dict[str, Any]) -> str:
    return Run(row["method"], row["case"], row["seed"]).key


def _known(file: Path) -> dict[str, dict[str, Any]]:
    return dict(kept_runs(file, lambda row: (_key(row), row), "a run of ./seed compare", "folder"))

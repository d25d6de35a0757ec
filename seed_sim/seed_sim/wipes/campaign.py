# SPDX-License-Identifier: Apache-2.0
"""Wipes under many conditions with many seeds, and the table of what they came to."""

import json
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

from joblib import delayed

from seed_sim.campaigns import keep_run, kept_runs, spread
from seed_sim.closed_loop.progress import in_parallel
from seed_sim.wipes.bandwidth import AMPLITUDES, FREQUENCIES, bandwidth, gain
from seed_sim.wipes.conditions import CONDITIONS
from seed_sim.wipes.run import Wipe, wipe


def campaign(
    names: Sequence[str], seeds: Sequence[int], law: str = "seed", jobs: int = 1, keep: Path | None = None
) -> list[Wipe]:
    """A wipe under each of the conditions with each of the seeds.

    keep: file with a line for each wipe as it ends; those that it holds already are not made again.
    """
    wanted = [(name, seed) for name in names for seed in seeds]
    known = _kept(keep, law)
    missing = [one for one in wanted if one not in known]
    for made in in_parallel([delayed(wipe)(*one, law) for one in missing], jobs, "wipe", ordered=False):
        known[made.condition, made.seed] = made
        keep_run(keep, json.dumps({"law": law} | made._asdict()))
    return [known[one] for one in wanted]


def _kept(file: Path | None, law: str) -> dict[tuple[str, int], Wipe]:
    """Wipes of that law in a file, by condition and seed."""

    def made(run: dict[str, Any]) -> tuple[str, Wipe]:
        return run["law"], Wipe(**{name: run[name] for name in Wipe._fields})

    return {(w.condition, w.seed): w for of, w in kept_runs(file, made, "a wipe of ./seed bench law") if of == law}


def summary(wipes: Sequence[Wipe]) -> dict[str, dict[str, Any]]:
    """By condition: median, 90 % and worst of the force's error and of the lean, and the wipes that ended early."""
    out = {}
    for name in dict.fromkeys(w.condition for w in wipes):
        of = [w for w in wipes if w.condition == name]
        out[name] = {
            "wipes": len(of),
            "force": spread([w.force for w in of]),
            "peak": spread([w.worst for w in of]),
            "lean": spread([w.lean for w in of]),
            "unknowable": spread([w.unknowable for w in of]),
            "ended": {str(w.seed): w.ended for w in of if w.ended},
        }
    return out


def table(result: dict[str, dict[str, Any]]) -> str:
    """The summary as text, a line per condition."""
    width = max(map(len, CONDITIONS))
    lines = [
        f"{'':{width}} wipes  force error, rms [N]   largest [N]            lean [deg]             ended",
        f"{'':{width}}        median   90 %  worst  median   90 %  worst  median   90 %  worst  early",
    ]
    for name, row in result.items():
        figures = "  ".join(
            f"{row[key]['median']:6.{d}f} {row[key]['p90']:6.{d}f} {row[key]['worst']:6.{d}f}"
            for key, d in (("force", 2), ("peak", 2), ("lean", 1))
        )
        lines.append(f"{name:{width}} {row['wipes']:5d}  {figures}  {len(row['ended']):5d}")
    correlated = [name for name in result if CONDITIONS[name].correlated]
    if correlated:
        known = ", ".join(f"{name}: {result[name]['unknowable']['median']:.2f} N" for name in correlated)
        lines.append(f"The mean over a wipe of what images are off by, which nothing else could tell (median): {known}")
    lines += [f"{name}, seed {seed}: {why}" for name, row in result.items() for seed, why in row["ended"].items()]
    return "\n".join(lines)


def bandwidths(seeds: Sequence[int], law: str = "seed", jobs: int = 1) -> dict[float, list[float]]:
    """Bandwidth of the force [Hz] by seed, for sines of each amplitude [N]."""
    asked = list(product(AMPLITUDES, seeds, FREQUENCIES))
    found = in_parallel([delayed(gain)(f, seed, law, a) for a, seed, f in asked], jobs, "run")
    gains = dict(zip(asked, found, strict=True))
    return {a: [bandwidth([(f, gains[a, seed, f]) for f in FREQUENCIES]) for seed in seeds] for a in AMPLITUDES}

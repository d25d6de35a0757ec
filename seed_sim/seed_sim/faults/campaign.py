# SPDX-License-Identifier: Apache-2.0
"""Many runs with faults, of every kind in turn, and the table of what they came to."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from joblib import delayed

from seed_sim.campaigns import keep_run, kept_runs
from seed_sim.closed_loop.progress import in_parallel
from seed_sim.faults.draw import KINDS, draw
from seed_sim.faults.run import Outcome, run_fault

MOST_EXCESS, MOST_TRAVEL = 5.0, 0.06  # [N], [m] that no run may be beyond
_WORST = 3  # seeds that are named


def campaign(
    runs: int, seed: int, kinds: Sequence[str] = KINDS, law: str = "seed", jobs: int = 1, keep: Path | None = None
) -> list[Outcome]:
    """So many runs of the kinds in turn, the first of each kind drawn from `seed`.

    keep: file with a line for each run as it ends; runs that it holds already are not made again.
    """
    wanted = [(kinds[i % len(kinds)], seed + i // len(kinds)) for i in range(runs)]
    known = _kept(keep, law)
    calls = [delayed(run_fault)(*one, law) for one in wanted if one not in known]
    for outcome in in_parallel(calls, jobs, "run", ordered=False):
        known[outcome.fault.kind, outcome.fault.seed] = outcome
        keep_run(keep, json.dumps({"law": law} | outcome.told()))
    return [known[one] for one in wanted]


def _kept(file: Path | None, law: str) -> dict[tuple[str, int], Outcome]:
    """Runs of that law in a file, by kind and seed."""

    def outcome(run: dict[str, Any]) -> tuple[str, Outcome]:
        figures = (run[name] for name in Outcome._fields[1:])
        return run["law"], Outcome(draw(run["kind"], run["seed"]), *figures)

    runs = kept_runs(file, outcome, "a run of ./seed validate faults")
    return {(o.fault.kind, o.fault.seed): o for of, o in runs if of == law}


def failed(outcome: Outcome) -> bool:
    """Whether a run is beyond what it may be."""
    worst = max(outcome.excess, outcome.norm)
    return worst > MOST_EXCESS or outcome.travel > MOST_TRAVEL or outcome.silent


def summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """By kind: how many runs, the worst of them, and what failed; under `all`, of all kinds."""
    by_kind = {kind: [o for o in outcomes if o.fault.kind == kind] for kind in KINDS}
    rows = {kind: _row(of) for kind, of in by_kind.items() if of}
    return {"kinds": rows, "all": _row(outcomes)}


def _row(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    worst = sorted(outcomes, key=lambda o: (failed(o), max(o.excess, o.norm)), reverse=True)[:_WORST]
    return {
        "runs": len(outcomes),
        "held": sum(bool(o.held) for o in outcomes),
        "served": sum(o.served for o in outcomes),
        "excess": max(o.excess for o in outcomes),
        "norm": max(o.norm for o in outcomes),
        "peak": max(o.peak for o in outcomes),
        "travel_mm": 1e3 * max(o.travel for o in outcomes),
        "silent": sum(o.silent for o in outcomes),
        "failed": sum(failed(o) for o in outcomes),
        "worst_seeds": [o.fault.seed for o in worst],
    }


def table(result: dict[str, Any]) -> str:
    """The summary as text, a line per kind."""
    lines = [
        f"{'fault':28s} runs  held served  excess N  by norm  peak N  free mm  no reason  failed  worst seeds",
    ]
    for name, r in [*result["kinds"].items(), ("all", result["all"])]:
        seeds = " ".join(map(str, r["worst_seeds"])) if name != "all" else ""
        lines.append(
            f"{name:28s}{r['runs']:5d}{r['held']:6d}{r['served']:7d}{r['excess']:10.2f}{r['norm']:9.2f}{r['peak']:8.2f}"
            f"{r['travel_mm']:9.1f}{r['silent']:11d}{r['failed']:8d}  {seeds}"
        )
    lines.append(
        f"excess: of the true force over the wanted one and along it, by norm: of its size, lasting 0.1 s (each at "
        f"most {MOST_EXCESS:g} N); free: way along a force direction without contact (at most {1e3 * MOST_TRAVEL:g} mm)"
    )
    return "\n".join(lines)

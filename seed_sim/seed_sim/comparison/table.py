# SPDX-License-Identifier: Apache-2.0
"""The runs of a comparison as tables: by case and score the median of every method, and who wins."""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from seed_sim.comparison.cases import case_named
from seed_sim.comparison.methods import method_named
from seed_sim.comparison.score import LARGER_IS_BETTER, OF_STEPS, OF_WIPES, SCORES

LEVEL = 0.05  # share within which another method counts as level with the best
ALL = "all cases"
SUMMED = ("press_rms", "peak", "overshoot", "rest", "bandwidth", "lean", "torque", "lost")


class Line(NamedTuple):
    """One row: median and 90 % over the runs by method, and the methods that win it.

    None: nothing to score, or no number, as too many of the runs failed.
    """

    case: str
    score: str
    medians: dict[str, float | None]
    ninety: dict[str, float | None]
    winners: tuple[str, ...]

    @property
    def won_by(self) -> str:
        """For a table; what nobody can have wins nothing."""
        return " = ".join(method_named(w).short for w in self.winners) or "-"


def lines_of(rows: Sequence[dict[str, Any]]) -> list[Line]:
    """Every case with every score that it has, then every score over all cases."""
    cases = list(dict.fromkeys(r["case"] for r in rows))
    lines = [_line(case, score, [r for r in rows if r["case"] == case]) for case in cases for score in SCORES]
    lines += [_line(ALL, score, rows) for score in SCORES]
    return [line for line in lines if any(v is not None for v in line.medians.values())]


def _line(case: str, score: str, rows: Sequence[dict[str, Any]]) -> Line:
    scored = [r for r in rows if _has(r["case"], score)]
    runs = {m: [r for r in scored if r["method"] == m] for m in dict.fromkeys(r["method"] for r in rows)}
    medians = {m: _percentile(score, r, 50.0) for m, r in runs.items()}
    ninety = {m: _percentile(score, r, 10.0 if score in LARGER_IS_BETTER else 90.0) for m, r in runs.items()}
    return Line(case, score, _finite(medians), _finite(ninety), _winners(score, medians))


def _has(case: str, score: str) -> bool:
    """Whether the runs of a case have the score, where they do not fail."""
    return score not in (OF_WIPES if case_named(case).steps else OF_STEPS)


def _percentile(score: str, rows: Sequence[dict[str, Any]], percent: float) -> float | None:
    """A run without the score has not touched, not come to rest or not finished: it is worse than any other."""
    worst = -np.inf if score in LARGER_IS_BETTER else np.inf
    values = [worst if r[score] is None else r[score] for r in rows]
    if not values:
        return None
    with np.errstate(invalid="ignore"):  # between two that failed
        found = float(np.percentile(values, percent))
    return worst if np.isnan(found) else found


def _finite(values: dict[str, float | None]) -> dict[str, float | None]:
    return {m: None if v is None or not np.isfinite(v) else v for m, v in values.items()}


def _winners(score: str, medians: dict[str, float | None]) -> tuple[str, ...]:
    real = {m: v for m, v in medians.items() if v is not None and not method_named(m).bound}
    if len(real) < 2:
        return ()
    sign = -1.0 if score in LARGER_IS_BETTER else 1.0
    best = min(sign * v for v in real.values())
    return tuple(m for m, v in real.items() if np.isfinite(v) and sign * v <= best + LEVEL * abs(best))


def text(rows: Sequence[dict[str, Any]]) -> str:
    """For the terminal: force error by case, then the other scores over all cases, then who failed."""
    lines = lines_of(rows)
    methods = list(dict.fromkeys(r["method"] for r in rows))
    seeds = len({r["seed"] for r in rows})
    head = f"{'':18s}" + "".join(f"{method_named(m).short:>10s}" for m in methods) + "  wins"
    out = [f"Force error [N], rms over the wipe, median of {seeds} seeds", head]
    out += [_text(line.case, line) for line in lines if line.score == "rms"]
    out += ["", "Over all cases, median", head]
    out += [
        _text(f"{line.score} [{SCORES[line.score][1]}]" if SCORES[line.score][1] else line.score, line)
        for line in lines
        if line.case == ALL and line.score in SUMMED
    ]
    ends = {m: sum(not r["finished"] for r in rows if r["method"] == m) for m in methods}
    out.append(f"{'not finished':18s}" + "".join(f"{ends[m]:10d}" for m in methods))
    out += ["", *(f"{method_named(m).short:10s} {m}: {method_named(m).says}" for m in methods)]
    return "\n".join(out)


def _text(head: str, line: Line) -> str:
    cells = "".join(f"{'-' if v is None else f'{v:.3g}':>10s}" for v in line.medians.values())
    return f"{head:18s}{cells}  {line.won_by}"


def write_csv(lines: Iterable[Line], file: Path) -> None:
    """One row per case and score: medians, then 90 % over the seeds, then the winners."""
    with file.open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out)
        first = True
        for line in lines:
            if first:
                spread = [f"{m}, 90 %" for m in line.ninety]
                writer.writerow(["case", "score", "unit", *line.medians, *spread, "wins"])
                first = False
            numbers = [*line.medians.values(), *line.ninety.values()]
            cells = ["" if v is None else f"{v:.4g}" for v in numbers]
            writer.writerow([line.case, line.score, SCORES[line.score][1], *cells, line.won_by])

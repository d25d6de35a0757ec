# SPDX-License-Identifier: Apache-2.0
"""The comparison as one page that opens offline: who wins what, pictures, settings, and every number."""

import base64
from collections.abc import Sequence
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any

from seed_sim.comparison.cases import CASES
from seed_sim.comparison.methods import OURS, Method, Settings, method_named
from seed_sim.comparison.score import SCORES
from seed_sim.comparison.table import ALL, SUMMED, Line, lines_of

TRACES = ("nominal", "hard table", "bumps", "force steps")
_SHOWN = 2.2  # [times the wanted force] of a trace
_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;max-width:1250px;margin:2em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;font-size:13px;margin:1em 0} td,th{padding:3px 8px;border-bottom:1px solid #ddd}
td{text-align:right} td:first-child,td:last-child,th:first-child{text-align:left}
.best{background:#cfead6;font-weight:600}
.ours{border-left:2px solid #087;border-right:2px solid #087} .bound{color:#888;font-style:italic} small{color:#777}
img{max-width:100%} details{margin:1em 0}
"""


def write_page(rows: Sequence[dict[str, Any]], settings: dict[str, Settings], file: Path) -> None:
    """Write the page of these runs."""
    lines = lines_of(rows)
    methods = [method_named(m) for m in dict.fromkeys(r["method"] for r in rows)]
    seeds = sorted({r["seed"] for r in rows})
    force = [line for line in lines if line.score == "rms"]
    summed = [line for line in lines if line.case == ALL and line.score in SUMMED]
    body = [
        "<h1>This suite and what people use instead</h1>",
        f"<p>{len(methods)} methods, {len(force) - 1} cases, seeds {seeds[0]} to {seeds[-1]}; the same simulated plant "
        "and tool for all. Every force is the plant's own, counted from first contact on. Medians over the seeds, "
        "90 % of them in small print, a dash where too many runs failed. Each method was tuned on a grid on other "
        "seeds.</p>",
        _verdict(force),
        "<h2>Force error over the wipe [N]</h2>",
        _table(force, methods),
        _picture(_errors(force, methods)),
        "<h2>Other scores, over all cases</h2>",
        _table(summed, methods, by_score=True),
        "<h2>Force over time, first seed</h2>",
        *(_picture(_traces(case, rows, methods)) for case in TRACES if any(r["case"] == case for r in rows)),
        "<h2>Methods and their settings</h2>",
        _described(methods, settings),
        "<h2>Cases</h2>",
        "<ul>" + "".join(f"<li><b>{escape(c.name)}</b>: {escape(c.says)}</li>" for c in CASES) + "</ul>",
        "<details><summary>Every case and score</summary>",
        _table([line for line in lines if line.case != ALL], methods, by_score=True, by_case=True),
        "</details>",
        _failures(rows),
    ]
    html = f"<!doctype html><meta charset='utf-8'><title>seed compare</title><style>{_STYLE}</style>" + "\n".join(body)
    file.write_text(html, encoding="utf-8")


def _verdict(lines: Sequence[Line]) -> str:
    """Which cases ours wins, and who wins the others."""
    cases = [line for line in lines if line.case != ALL]
    won = [line.case for line in cases if OURS in line.winners]
    lost = [f"{escape(line.case)} ({escape(line.won_by)})" for line in cases if OURS not in line.winners]
    said = f"<p>By force error <b>ours wins {len(won)} of {len(cases)} cases</b>: {escape(', '.join(won)) or 'none'}."
    return said + (f" Others win {', '.join(lost)}.</p>" if lost else "</p>")


def _table(lines: Sequence[Line], methods: Sequence[Method], by_score: bool = False, by_case: bool = False) -> str:
    head = "".join(f"<th class='{_class(m.name)}'>{escape(m.short)}</th>" for m in methods)
    out = [f"<table><tr><th></th>{head}<th>wins</th></tr>"]
    for line in lines:
        says, unit = SCORES[line.score]
        name = f"{says} [{unit}]" if unit else says
        first = f"{line.case}: {name}" if by_case else name if by_score else line.case
        cells = "".join(cell_of(line, m.name) for m in methods)
        out.append(f"<tr><td>{escape(first)}</td>{cells}<td>{escape(line.won_by)}</td></tr>")
    return "\n".join([*out, "</table>"])


def cell_of(line: Line, method: str) -> str:
    median, ninety = line.medians.get(method), line.ninety.get(method)
    best = " best" if method in line.winners else ""
    if median is None:
        return f"<td class='{_class(method)}'>-</td>"
    spread = "-" if ninety is None else f"{ninety:.3g}"
    return f"<td class='{_class(method)}{best}'>{median:.3g} <small>{spread}</small></td>"


def _class(method: str) -> str:
    return "ours" if method == OURS else "bound" if method_named(method).bound else ""


def _described(methods: Sequence[Method], settings: dict[str, Settings]) -> str:
    rows = []
    for m in methods:
        values = ", ".join(f"{k} {v:g}" for k, v in settings[m.name].items()) or "as shipped"
        rows.append(f"<li><b>{escape(m.short)}</b> ({escape(m.name)}): {escape(m.says)}; {escape(values)}</li>")
    return "<ul>" + "".join(rows) + "</ul>"


def _failures(rows: Sequence[dict[str, Any]]) -> str:
    ends = []
    for r in rows:
        if not r["finished"]:
            ends.append(
                f"<li>{escape(r['method'])}, {escape(r['case'])}, seed {r['seed']}: {escape(r['message'])}</li>"
            )
    return f"<h2>Runs that did not finish: {len(ends)}</h2><ul>{''.join(ends)}</ul>"


def _errors(lines: Sequence[Line], methods: Sequence[Method]) -> Any:
    """Force error by case, a mark for every method."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.5), layout="constrained")
    axis = figure.subplots()
    for i, m in enumerate(methods):
        values = [line.medians.get(m.name) for line in lines]
        style = {"ms": 11, "zorder": 3} if m.name == OURS else {"ms": 6}
        axis.plot(range(len(lines)), values, _mark(i), label=m.short, color=_colour(m, i), ls="none", **style)
    axis.set_xticks(range(len(lines)), [line.case for line in lines], rotation=20)
    axis.set(yscale="log", ylabel="force error, rms over the wipe [N]")
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8, ncols=6, loc="upper center", bbox_to_anchor=(0.5, 1.2))
    return figure


def _traces(case: str, rows: Sequence[dict[str, Any]], methods: Sequence[Method]) -> Any:
    """Force over time of the first seed that kept it, each method in its own panel."""
    from matplotlib.figure import Figure

    across = 4
    down = -(-len(methods) // across)
    figure = Figure(figsize=(12, 1.9 * down), layout="constrained")
    panels = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False).ravel()
    for i, (axis, m) in enumerate(zip(panels, methods, strict=False)):
        kept = [r["trace"] for r in rows if r["case"] == case and r["method"] == m.name and "trace" in r]
        if kept:
            axis.plot(kept[0]["t"], kept[0]["wanted"], color="0.6", lw=1)
            axis.plot(kept[0]["t"], kept[0]["force"], color=_colour(m, i), lw=1)
            axis.set_ylim(-0.5, _SHOWN * max(kept[0]["wanted"]))
        axis.set_title(m.short, fontsize=9)
        axis.grid(alpha=0.3)
    for axis in panels[len(methods) :]:
        axis.set_visible(False)
    figure.suptitle(f"{case}: force on the table [N] over time from contact [s]", fontsize=10)
    return figure


def _colour(method: Method, i: int) -> str:
    return "#008877" if method.name == OURS else "0.5" if method.bound else f"C{i % 10}"


def _mark(i: int) -> str:
    return "*Dsv^o<>PXph"[i % 12]


def _picture(figure: Any) -> str:
    out = BytesIO()
    figure.savefig(out, dpi=100, format="png")
    return f"<img alt='' src='data:image/png;base64,{base64.b64encode(out.getvalue()).decode()}'>"

# SPDX-License-Identifier: Apache-2.0
"""report.html: one file, no links to anything outside it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from seed_core.spatial import Array
from seed_sysid.fit.analysis import Analysis
from seed_sysid.report import figures as plots
from seed_sysid.stiffness_map import AXES, CHANNELS, LOAD_UNITS, UNITS

_STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:70em;margin:2em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;font-variant-numeric:tabular-nums}
td,th{padding:.2em .8em;text-align:right;border-bottom:1px solid #ddd}
td:first-child,th:first-child{text-align:left}.warn{background:#fff4e0;padding:.4em 1em;border-left:4px solid #e08a00}
svg{max-width:100%;height:auto}details{margin:1em 0}.small{font-size:12px}"""


def write_report(path: Path, a: Analysis, figures: dict[str, Any]) -> None:
    """Write the report whole or not at all."""
    part = path.with_suffix(".html.part")
    part.write_text(render(a, figures), encoding="utf-8")
    part.replace(path)


def render(a: Analysis, figures: dict[str, Any]) -> str:
    """The report as HTML."""
    truth = [np.array([*t["rotation"], *t["translation"]]) for t in figures.get("truth_all_grips", ())] or None
    held, dump = a.data.header, escape(json.dumps(figures, indent=1))
    body = [
        f"<h1>Stiffness of {escape(held.hand or 'the hand')} holding {escape(held.tool or 'the sensor')}</h1>",
        f"<p>{_abstract(a)}</p>",
        *(f'<p class="warn">{escape(w)}</p>' for w in a.warnings),
        "<h2>Stiffness</h2>",
        _stiffness_table(a, truth),
        "<h2>Stiffness against pressure, pressure against width</h2>",
        plots.stiffness_against_pressure(a, truth),
        plots.pressure_against_width(a),
        "<h2>Samples</h2><p>Single-axis poses, sensor bias and frame offset taken off; lines are the fit.</p>",
        plots.load_against_displacement(a),
        "<h2>Residuals</h2>",
        plots.residuals(a),
        _channel_table(a),
        "<h2>Is the stiffness diagonal and positive? (Assumption 2)</h2>",
        f"<p>{_verdict(a)}</p>",
        plots.couplings(a),
        "<h2>Sensor</h2>",
        _sensor_table(figures),
        f"<details><summary>All samples ({len(a.data.samples)})</summary>{_sample_table(a)}</details>",
        f"<details><summary>All figures (JSON)</summary><pre class='small'>{dump}</pre></details>",
    ]
    head = f"<head><meta charset='utf-8'><title>Grasp stiffness</title><style>{_STYLE}</style></head>"
    return f"<!DOCTYPE html><html lang='en'>{head}<body>{''.join(body)}</body></html>\n"


def _abstract(a: Analysis) -> str:
    minutes = (a.problem.time[-1] - a.problem.time[0]) / 60.0
    return (
        f"{len(a.data.samples)} poses at {len(a.grips)} grips in {minutes:.0f} min; {a.source} poses; "
        f"{a.problem.parameters.model} model; condition number {a.solution.condition:.1f}; "
        f"{len(a.outliers)} outliers left out. "
        f"Recorded {escape(a.data.header.created or 'at an unknown time')}."
    )


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """An HTML table of texts."""
    cells = "".join(f"<th>{escape(h)}</th>" for h in head)
    lines = "".join("<tr>" + "".join(f"<td>{escape(c)}</td>" for c in row) + "</tr>" for row in rows)
    return f"<table><tr>{cells}</tr>{lines}</table>"


def _stiffness_table(a: Analysis, truth: list[Array] | None) -> str:
    rows = []
    for g in range(len(a.grips)):
        state = f"{1e3 * a.widths[g]:.1f} mm, {a.pressures[g]:.1f} hPa"
        for j, axis in enumerate(AXES):
            k, half = a.solution.value.stiffness[g, j], a.solution.half_width[g, j]
            row = [state if j == 0 else "", axis, f"{k:.4g}", f"± {half:.2g}", f"{half / k:.2%}", UNITS[j]]
            rows.append(row + ([f"{truth[g][j]:.4g}", f"{k / truth[g][j] - 1.0:+.2%}"] if truth else []))
    head = ["grip", "axis", "stiffness", f"{a.problem.parameters.confidence:.0%} interval", "relative", "unit"]
    return table([*head, "true", "error"] if truth else head, rows)


def _channel_table(a: Analysis) -> str:
    head = ["channel", "residual (1 std)", "left-out poses (rms)", "of their spread", "R²"]
    rows = [
        [name, f"{s:.3g} {unit}", f"{lo:.3g} {unit}", f"{share:.2%}", f"{r2:.5f}"]
        for name, unit, s, lo, share, r2 in zip(
            CHANNELS, LOAD_UNITS, a.solution.noise, a.left_out, a.left_out_share, a.solution.r_squared, strict=True
        )
    ]
    return table(head, rows)


def _verdict(a: Analysis) -> str:
    if a.assumption.holds:
        return (
            f"Yes: the full symmetric fit couples no two axes by more than {np.abs(a.assumption.coupling).max():.2f}, "
            f"and its smallest scaled eigenvalue is {a.assumption.eigenvalues.min():.2f}."
        )
    return escape(" ".join(a.assumption.warnings)) + "."


def _sensor_table(figures: dict[str, Any]) -> str:
    rows = [
        [name, *(f"{v:.4g}" for v in figures[group][key]), unit]
        for name, group, key, unit in (
            ("frame offset: turn", "frame_offset", "rotation_deg", "deg"),
            ("frame offset: shift", "frame_offset", "translation_mm", "mm"),
            ("bias: torque", "bias", "torque", "N m"),
            ("bias: force", "bias", "force", "N"),
            ("drift over the run: torque", "drift", "torque", "N m"),
            ("drift over the run: force", "drift", "force", "N"),
        )
    ]
    return table(["", "x", "y", "z", "unit"], rows)


def _sample_table(a: Analysis) -> str:
    xi, load = plots.generalised_loads(a)
    xi = xi * np.repeat([180.0 / np.pi, 1e3], 3)
    digits = (2,) * 6 + (3,) * 3 + (2,) * 3
    rows = []
    for s, values, good in zip(a.data.samples, np.hstack([xi, load]), a.solution.inlier, strict=True):
        cells = [f"{v:.{d}f}" for v, d in zip(values, digits, strict=True)]
        rows.append([s.key, *cells, f"{s.settle:.1f}", "" if good else "outlier"])
    units = ["deg"] * 3 + ["mm"] * 3
    head = ["pose", *(f"{n} [{u}]" for n, u in zip(AXES, units, strict=True))]
    head += [f"load {n} [{u}]" for n, u in zip(AXES, LOAD_UNITS, strict=True)]
    return f"<div class='small'>{table([*head, 'settle', ''], rows)}</div>"

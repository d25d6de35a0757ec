# SPDX-License-Identifier: Apache-2.0
"""The files that an identification leaves: stiffness.yaml, models of the wrench, summary.json and report.html."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from seed_core.config import ConfigError
from seed_core.hysteretic.file import hysteretic_file, save_hysteretic
from seed_core.membrane.map_file import save_membrane_map
from seed_core.program.files import write_text
from seed_core.spatial import Array
from seed_core.stiffness_file import save_stiffness
from seed_sysid.fit.analysis import Analysis
from seed_sysid.fit.hysteretic_fit import fit_hysteretic
from seed_sysid.report import figures as plots
from seed_sysid.report.summary import stiffness_file
from seed_sysid.stiffness_map import AXES, CHANNELS, LOAD_UNITS, UNITS

_SENSOR = (  # where it stands in the summary, and its unit
    ("frame offset: turn", "frame_offset", "rotation_deg", "deg"),
    ("frame offset: shift", "frame_offset", "translation_mm", "mm"),
    ("bias: torque", "bias", "torque", "N m"),
    ("bias: force", "bias", "force", "N"),
    ("drift over the run: torque", "drift", "torque", "N m"),
    ("drift over the run: force", "drift", "force", "N"),
)


def write_results(folder: Path, a: Analysis, figures: dict[str, Any], date: str) -> None:
    """Write all of them; a YAML file that is there already is kept as .previous.yaml.

    Args:
        folder: made if it is not there.
        a: the analysis.
        figures: its summary, with what else is known (the truth, the clocks).
        date: ISO 8601.

    Raises:
        DatasetError: an axis is undetermined, and there is no membrane map; nothing is written then.
    """
    result = None if a.undetermined and a.membrane is not None else stiffness_file(a, date)
    folder.mkdir(parents=True, exist_ok=True)
    stiffness = folder / "stiffness.yaml"
    if stiffness.exists():
        stiffness.replace(stiffness.with_suffix(".previous.yaml"))
    if result is not None:
        save_stiffness(stiffness, result)
    _write_hysteretic_spring(folder, a, date)
    _write_membrane_map(folder, a, date)
    write_text(folder / "summary.json", json.dumps(figures, indent=1) + "\n")
    write_text(folder / "report.html", render(a, figures))


def _write_hysteretic_spring(folder: Path, a: Analysis, date: str) -> None:
    """hysteretic_spring.yaml of the middle grip; none where the data do not determine one."""
    file = folder / "hysteretic_spring.yaml"
    if file.exists():
        file.replace(file.with_suffix(".previous.yaml"))
    if a.undetermined:
        return
    try:
        spring = fit_hysteretic(a).identified
    except ConfigError:
        return
    head, g = a.data.header, a.nominal
    pressure, width = (float(np.nan_to_num(v[g])) for v in (a.pressures, a.widths))
    save_hysteretic(
        file, hysteretic_file(spring, head.hand or "hand", head.tool or "tool", date, max(pressure, 0.0), width)
    )


def _write_membrane_map(folder: Path, a: Analysis, date: str) -> None:
    """membrane_map.yaml beside the stiffness; one that is there is kept, and does not pass for this run's."""
    file = folder / "membrane_map.yaml"
    if file.exists():
        file.replace(file.with_suffix(".previous.yaml"))
    if a.membrane is not None:
        save_membrane_map(file, replace(a.membrane.file, date=date))


def render(a: Analysis, figures: dict[str, Any]) -> str:
    """The report as HTML."""
    truth = [np.array([*t["rotation"], *t["translation"]]) for t in figures.get("truth_all_grips", ())] or None
    template = Template(files("seed_sysid").joinpath("templates/report.html").read_text(encoding="utf-8"))
    return template.substitute(
        hand=escape(a.data.header.hand or "the hand"),
        tool=escape(a.data.header.tool or "the sensor"),
        abstract=_abstract(a),
        warnings="".join(f'<p class="warn">{escape(w)}</p>' for w in a.warnings),
        stiffness_table=_stiffness_table(a, truth),
        stiffness_figure=plots.stiffness_against_pressure(a, truth),
        pressure_figure=plots.pressure_against_width(a),
        load_figure=plots.load_against_displacement(a),
        residual_figure=plots.residuals(a),
        channel_table=_channel_table(a),
        membrane=_membrane(a),
        verdict=_verdict(a),
        coupling_figure=plots.couplings(a),
        sensor_table=_table(
            ["", "x", "y", "z", "unit"],
            ([name, *(f"{v:.4g}" for v in figures[group][key]), unit] for name, group, key, unit in _SENSOR),
        ),
        samples=len(a.data.samples),
        sample_table=_sample_table(a),
        figures=escape(json.dumps(figures, indent=1)),
    )


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """An HTML table of texts."""
    cells = "".join(f"<th>{escape(h)}</th>" for h in head)
    lines = "".join("<tr>" + "".join(f"<td>{escape(c)}</td>" for c in row) + "</tr>" for row in rows)
    return f"<table><tr>{cells}</tr>{lines}</table>"


def _abstract(a: Analysis) -> str:
    minutes = (a.problem.time[-1] - a.problem.time[0]) / 60.0
    return (
        f"{len(a.data.samples)} poses at {len(a.grips)} grips in {minutes:.0f} min; {a.source} poses; "
        f"{a.problem.parameters.model} model; condition number {a.solution.condition:.1f}; "
        f"{len(a.outliers)} outliers left out. "
        f"Recorded {escape(a.data.header.created or 'at an unknown time')}."
    )


def _stiffness_table(a: Analysis, truth: list[Array] | None) -> str:
    rows = []
    for g, j in np.ndindex(len(a.grips), 6):
        k, half = a.solution.value.stiffness[g, j], a.solution.half_width[g, j]
        state = f"{1e3 * a.widths[g]:.1f} mm, {a.pressures[g]:.1f} hPa" if j == 0 else ""
        row = [state, AXES[j], f"{k:.4g}", f"± {half:.2g}", f"{half / k:.2%}", UNITS[j]]
        rows.append(row + ([f"{truth[g][j]:.4g}", f"{k / truth[g][j] - 1.0:+.2%}"] if truth else []))
    head = ["grip", "axis", "stiffness", f"{a.problem.parameters.confidence:.0%} interval", "relative", "unit"]
    return _table([*head, "true", "error"] if truth else head, rows)


def _channel_table(a: Analysis) -> str:
    head = ["channel", "residual (1 std)", "left-out poses (rms)", "of their spread", "R²"]
    s = a.solution
    figures = zip(CHANNELS, LOAD_UNITS, s.noise, a.left_out, a.left_out_share, s.r_squared, strict=True)
    return _table(
        head,
        (
            [name, f"{noise:.3g} {unit}", f"{left_out:.3g} {unit}", f"{share:.2%}", f"{r_squared:.5f}"]
            for name, unit, noise, left_out, share, r_squared in figures
        ),
    )


def _membrane(a: Analysis) -> str:
    if a.membrane is None:
        return f"<p>{escape(a.membrane_refused or 'No sample tells what the membranes did.')}</p>"
    rows = ([name, *(f"{v:.1%}" for v in share)] for name, share in a.membrane.shares.items())
    return _table(["model", *CHANNELS], rows)


def _verdict(a: Analysis) -> str:
    if a.assumption.holds:
        return (
            f"Yes: the full symmetric fit couples no two axes by more than {np.abs(a.assumption.coupling).max():.2f}, "
            f"and its smallest scaled eigenvalue is {a.assumption.eigenvalues.min():.2f}."
        )
    return escape(" ".join(a.assumption.warnings)) + "."


def _sample_table(a: Analysis) -> str:
    xi, load = plots.generalised_loads(a)
    values = np.hstack([np.rad2deg(xi[:, :3]), 1e3 * xi[:, 3:], load])
    head = ["pose", *(f"{n} [{u}]" for n, u in zip(AXES, ("deg",) * 3 + ("mm",) * 3, strict=True))]
    head += [f"load {n} [{u}]" for n, u in zip(AXES, LOAD_UNITS, strict=True)]
    digits = (2,) * 6 + (3,) * 3 + (2,) * 3
    rows = (
        [
            s.key,
            *(f"{v:.{d}f}" for v, d in zip(row, digits, strict=True)),
            f"{s.settle:.1f}",
            "" if good else "outlier",
        ]
        for s, row, good in zip(a.data.samples, values, a.solution.inlier, strict=True)
    )
    return _table([*head, "settle", ""], rows)

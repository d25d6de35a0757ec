# SPDX-License-Identifier: Apache-2.0
"""Force and torque over the last seconds: wanted, and measured with two deviations to either side."""

from typing import Any, NamedTuple

import numpy as np
import viser
from viser import uplot

from seed_bringup.page.state import SPAN, History
from seed_core.spatial import Array

AXES = "xyz"
HEIGHT = 150  # [px]
EMPTY = (np.array((-SPAN, 0.0)), *(np.full(2, np.nan),) * 4)


class Kind(NamedTuple):
    """What one plot shows: the rows of it in (force, torque), its axis while nothing is wanted, and its looks."""

    name: str
    unit: str
    rows: slice
    usual: int
    color: str
    least: float  # [unit] of the vertical axis


KINDS = (
    Kind("Force", "N", slice(0, 3), 2, "#e26a2c", 2.0),
    Kind("Torque", "N m", slice(3, 6), 3, "#8054be", 0.2),
)


class Plots:
    """Two plots; `show` what was until now."""

    def __init__(self, gui: viser.GuiApi, history: History) -> None:
        self._history = history
        self._titles, self._plots = [], []
        for kind in KINDS:
            self._titles.append(gui.add_html(_title(kind, kind.usual, None)))
            self._plots.append(gui.add_uplot(EMPTY, _series(kind), **_looks(kind, history.span)))

    def show(self, now: float) -> None:
        """now: the newest stamp [s]."""
        for kind, title, plot in zip(KINDS, self._titles, self._plots, strict=True):
            axis = self._history.axis(kind.rows, kind.usual)
            data = self._history.series(axis, now)
            plot.data = data if len(data[0]) else EMPTY
            low, high = _range(data, kind.least)
            scales = {
                "x": uplot.Scale(time=False, range=(-self._history.span, 0.0)),
                "y": uplot.Scale(range=(low, high)),
            }
            if plot.scales != scales:
                plot.scales = scales
            last = (float(data[1][-1]), float(data[2][-1])) if len(data[0]) else None
            text = _title(kind, axis - kind.rows.start, last)
            if title.content != text:
                title.content = text


def _series(kind: Kind) -> tuple[uplot.Series, ...]:
    hidden = uplot.Series_Points(show=False)
    return (
        uplot.Series(label="s"),
        uplot.Series(label="wanted", stroke="#475467", width=1.5, dash=(6.0, 4.0), points=hidden),
        uplot.Series(label="measured", stroke=kind.color, width=2.0, points=hidden),
        uplot.Series(label="low", stroke="transparent", width=0.0, points=hidden),
        uplot.Series(label="high", stroke="transparent", width=0.0, points=hidden),
    )


def _looks(kind: Kind, span: float) -> dict[str, Any]:
    grid = uplot.Axis_Grid(stroke="#eef0f3", width=1.0)
    return {
        "bands": (uplot.Band(series=(4.0, 3.0), fill=kind.color + "2e"),),
        "scales": {"x": uplot.Scale(time=False, range=(-span, 0.0)), "y": uplot.Scale(range=(-kind.least, kind.least))},
        "axes": (
            uplot.Axis(stroke="#667085", grid=grid, size=30.0),
            uplot.Axis(stroke="#667085", grid=grid, size=44.0),
        ),
        "legend": uplot.Legend(show=False),
        "height": HEIGHT,
        "padding": (6, 8, 0, 0),
    }


def _range(data: tuple[Array, ...], least: float) -> tuple[float, float]:
    """Round limits of the vertical axis, which hardly ever change."""
    values = np.concatenate([d[np.isfinite(d)] for d in data[1:3]]) if len(data[0]) else np.zeros(0)
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
    step = least * 2.0 ** max(np.ceil(np.log2(max(high - low, least) / (2.0 * least))), 0.0)
    return float(np.floor(min(low, 0.0) / step - 0.2) * step), float(np.ceil(max(high, 0.0) / step + 0.2) * step)


def _title(kind: Kind, axis: int, last: tuple[float, float] | None) -> str:
    digits = 1 if kind.unit == "N" else 2
    axis -= 0 if axis < 3 else 3
    numbers = (
        ""
        if last is None
        else f'<b style="color:{kind.color}">{last[1]:.{digits}f}</b> of <b>{last[0]:.{digits}f}</b> {kind.unit}'
    )
    return (
        f'<div class="seed-row"><span>{kind.name} {AXES[axis]} <small>[{kind.unit}], task frame</small></span>'
        f"<span>{numbers}</span></div>"
    )

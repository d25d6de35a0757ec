# SPDX-License-Identifier: Apache-2.0
"""report.html: one file that opens without a network."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from string import Template
from typing import Any, NamedTuple


class Column(NamedTuple):
    """A figure of a score: where it stands in it, and how it is shown."""

    name: str
    unit: str
    path: tuple[str, ...]
    digits: int
    sign: int = 1


COLUMNS = (
    Column("force error rms", "N", ("force_z", "rmse"), 2),
    Column("mean pressing force", "N", ("force_z", "mean"), 2, sign=-1),  # z points out of the table
    Column("largest force error", "N", ("force_z", "max_abs_error"), 2),
    Column("torque rms", "N m", ("torque_x", "rmse"), 3),
    Column("lean rms", "deg", ("lean_deg", "rms"), 1),
    Column("path error rms", "mm", ("path_rmse_mm",), 1),
)
NAMES = {
    "seed": ("SEED", ""),
    "open_loop": ("open loop", "the taught path, barely touching the table where it should be"),
    "welded": ("welded", "tool bolted to the gripper, ideal force sensor"),
}


@dataclass(frozen=True)
class Picture:
    """A PNG with its caption."""

    png: bytes
    caption: str


@dataclass(frozen=True)
class Report:
    """What the page shows; texts are plain and escaped here, figures are SVG."""

    title: str
    subtitle: str
    held: bool
    scores: Mapping[str, Mapping[str, Any]]
    force_figure: str
    pose_figure: str
    pictures: Sequence[Picture]
    details: Mapping[str, str]
    replay: str = ""  # name of the file beside this one
    source: str = "tactile images"  # of the relative pose

    def html(self) -> str:
        """The page."""
        template = Template(files("seed_bringup").joinpath("templates/report.html").read_text(encoding="utf-8"))
        own = next(iter(self.scores.values()))
        return template.substitute(
            title=escape(self.title),
            heading=escape(self.title),
            subtitle=escape(self.subtitle),
            verdict="force held" if self.held else "force not held",
            verdict_class="" if self.held else "no",
            cards=_cards(own),
            force_figure=self.force_figure,
            pose_figure=self.pose_figure,
            table=table(self.scores, f"this run: {self.source} in the loop"),
            source=escape(self.source),
            pictures="".join(_picture(p) for p in self.pictures) or "<p>None were taken.</p>",
            details=self._details(),
        )

    def _details(self) -> str:
        rows = [f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in self.details.items()]
        if self.replay:
            rows.append(f'<dt>3-D replay</dt><dd><a href="{escape(self.replay)}">{escape(self.replay)}</a></dd>')
        return "".join(rows)


def value(score: Mapping[str, Any], path: Sequence[str]) -> float | None:
    """A number of a score by its keys; None where it has none."""
    here: Any = score
    for key in path:
        here = here.get(key) if isinstance(here, Mapping) else None
    return None if here is None else float(here)


def _number(score: Mapping[str, Any], column: Column) -> str:
    number = value(score, column.path)
    return "-" if number is None or number != number else f"{column.sign * number:.{column.digits}f}"


def _cards(score: Mapping[str, Any]) -> str:
    cards = [COLUMNS[i] for i in (0, 3, 4, 5)]
    return "".join(f'<div class="card"><b>{_number(score, c)} {c.unit}</b><span>{c.name}</span></div>' for c in cards)


def table(scores: Mapping[str, Mapping[str, Any]], own_words: str) -> str:
    """The scores as an HTML table, the first row being the run's own."""
    head = "".join(f"<th>{c.name} [{c.unit}]</th>" for c in COLUMNS)
    rows = []
    for i, (key, score) in enumerate(scores.items()):
        name, words = NAMES.get(key, (key, ""))
        words = words or own_words
        cells = "".join(f"<td>{_number(score, c)}</td>" for c in COLUMNS)
        own = ' class="own"' if i == 0 else ""
        rows.append(f"<tr{own}><td>{escape(name)}<small>{escape(words)}</small></td>{cells}</tr>")
    return f"<table><thead><tr><th></th>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def text_table(scores: Mapping[str, Mapping[str, Any]]) -> str:
    """The scores as lines for a terminal."""
    lines = [f"{'':<11}" + "".join(f"{f'{c.name} [{c.unit}]':>26}" for c in COLUMNS if c.name in SHORT)]
    for key, score in scores.items():
        cells = [f"{_number(score, c):>26}" for c in COLUMNS if c.name in SHORT]
        lines.append(f"{NAMES.get(key, (key, ''))[0]:<11}" + "".join(cells))
    return "\n".join(lines)


SHORT = ("force error rms", "torque rms", "lean rms")


def _picture(picture: Picture) -> str:
    data = base64.b64encode(picture.png).decode()
    return (
        f'<figure><img alt="{escape(picture.caption)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{escape(picture.caption)}</figcaption></figure>"
    )

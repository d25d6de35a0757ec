# SPDX-License-Identifier: Apache-2.0
"""report.html, one file that opens without a network, and the scores as a table for the terminal."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from math import isnan
from string import Template
from typing import Any, NamedTuple


class Column(NamedTuple):
    """A figure of a score: where it stands in it, and how it is shown."""

    name: str
    unit: str
    path: tuple[str, ...]
    digits: int
    scale: float = 1.0
    card: bool = False  # at the head of the report
    terminal: bool = False


COLUMNS = (
    Column("force error rms", "N", ("force_z", "rmse"), 2, card=True, terminal=True),
    Column("believed error rms", "N", ("believed_z", "rmse"), 2, card=True, terminal=True),
    Column("truth in band", "%", ("believed_z", "in_band"), 0, scale=100.0, card=True, terminal=True),
    Column("mean pressing force", "N", ("force_z", "mean"), 2, scale=-1.0),  # z points out of the table
    Column("largest force error", "N", ("force_z", "max_abs_error"), 2),
    Column("torque rms", "N m", ("torque_x", "rmse"), 3, card=True, terminal=True),
    Column("lean rms", "deg", ("lean_deg", "rms"), 1, card=True, terminal=True),
    Column("path error rms", "mm", ("path_rmse_mm",), 1, card=True),
)
BELIEF = (
    "What the table felt, and what the controller took it for. The orange band is two standard deviations that the "
    "controller states, either way; the truth should lie in it for 95 % of the time. Shaded: the scored stretch."
)
PATH = "Seen from above, in the work frame: where the tip was to go, and where it went. Colour: how firmly it pressed."
EXPLAINED = {
    "open_loop": "For comparison, <b>open loop</b>: the arm follows the taught path and nobody looks at the force.",
    "welded": "And <b>welded</b>: the tool is bolted to the gripper, without anything soft between, and the force is "
    "controlled with an ideal force sensor; where the tool touches with more than a point, its torque shows what is "
    "lost without the bubbles' softness.",
}
SHIFTED = "Their curves are moved so that first contact coincides; each is scored over this phase of its own run."
NAMES = {
    "seed": ("SEED", ""),
    "open_loop": ("open loop", "the taught path, barely touching the table where it should be"),
    "welded": ("welded", "tool bolted to the gripper, ideal force sensor"),
}
Score = Mapping[str, Any]


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
    scores: Mapping[str, Score]
    force_figure: str
    pose_figure: str
    pictures: Sequence[Picture]
    details: Mapping[str, str]
    belief_figure: str = ""  # of true and believed force
    hidden: str = ""  # what was hidden and what was found, in words
    replay: str = ""  # name of the file beside this one
    asked: str = ""  # in a sentence
    happened: str = ""  # in another
    setup: bytes = b""  # PNG of the cell
    path_figure: str = ""
    phase: str = "wipe"  # that is scored
    source: str = "tactile images"  # of the relative pose

    def html(self) -> str:
        """The page."""
        template = Template(files("seed_bringup").joinpath("templates/report.html").read_text(encoding="utf-8"))
        own = next(iter(self.scores.values()))
        cards = [(_number(own, c), c) for c in _columns(self.scores) if c.card]
        explained = [EXPLAINED[name] for name in self.scores if name in EXPLAINED]
        details = {name: escape(value) for name, value in self.details.items()}
        return template.substitute(
            title=escape(self.title),
            subtitle=escape(self.subtitle),
            verdict="force held" if self.held else "force not held",
            verdict_class="" if self.held else "no",
            story=self._story(),
            phase=escape(self.phase),
            compared=" ".join((*explained, SHIFTED)) if explained else "",
            path=_section("Path on the table", PATH, self.path_figure) if self.path_figure else "",
            cards="".join(f'<div class="card"><b>{n} {c.unit}</b><span>{c.name}</span></div>' for n, c in cards),
            hidden=_section("A hidden world", escape(self.hidden)) if self.hidden else "",
            belief=_section("True and believed force", BELIEF, self.belief_figure) if self.belief_figure else "",
            force_figure=self.force_figure,
            pose_figure=self.pose_figure,
            table=_table(self.scores, f"this run: {self.source} in the loop"),
            source=escape(self.source),
            pictures="".join(_figure(p) for p in self.pictures) or "<p>None were taken.</p>",
            details="".join(f"<dt>{escape(name)}</dt><dd>{value}</dd>" for name, value in details.items()),
        )

    def _story(self) -> str:
        """What was asked, what happened, the set-up as a picture, and the way to the replay."""
        words = "".join(f"<p><b>{name}</b> {escape(text)}</p>" for name, text in self._sentences() if text)
        if self.replay:
            words += f'<p><a class="play" href="{escape(self.replay)}">&#9654; Watch the run in 3-D</a></p>'
        if self.setup:
            data = base64.b64encode(self.setup).decode()
            words += f'<img class="setup" alt="The cell during the task" src="data:image/png;base64,{data}">'
        return f'<section class="story">{words}</section>' if words else ""

    def _sentences(self) -> tuple[tuple[str, str], ...]:
        return ("Asked:", self.asked), ("Happened:", self.happened)


def _columns(scores: Mapping[str, Score]) -> list[Column]:
    """Those of which the first score knows something."""
    own = next(iter(scores.values()))
    return [c for c in COLUMNS if own.get(c.path[0]) is not None]


def _section(head: str, words: str, figure: str = "") -> str:
    return f"<section><h2>{head}</h2>\n<p>{words}</p>\n{figure}</section>"


def _number(score: Score, column: Column) -> str:
    """A number of a score as text; a dash where it has none."""
    value: Any = score
    for key in column.path:
        value = value.get(key) if isinstance(value, Mapping) else None
    return "-" if value is None or isnan(value) else f"{column.scale * value:.{column.digits}f}"


def _table(scores: Mapping[str, Score], own_words: str) -> str:
    """The scores as an HTML table, the first row being the run's own."""
    columns = _columns(scores)
    head = "".join(f"<th>{c.name} [{c.unit}]</th>" for c in columns)
    rows: list[str] = []
    for key, score in scores.items():
        name, words = NAMES.get(key, (key, ""))
        cells = "".join(f"<td>{_number(score, c)}</td>" for c in columns)
        own = "" if rows else ' class="own"'
        rows.append(f"<tr{own}><td>{escape(name)}<small>{escape(words or own_words)}</small></td>{cells}</tr>")
    return f"<table><thead><tr><th></th>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def text_table(scores: Mapping[str, Score]) -> str:
    """The scores as lines for a terminal."""
    columns = [c for c in _columns(scores) if c.terminal]
    lines = [f"{'':<11}" + "".join(f"{f'{c.name} [{c.unit}]':>26}" for c in columns)]
    for key, score in scores.items():
        lines.append(f"{NAMES.get(key, (key, ''))[0]:<11}" + "".join(f"{_number(score, c):>26}" for c in columns))
    return "\n".join(lines)


def _figure(picture: Picture) -> str:
    data, caption = base64.b64encode(picture.png).decode(), escape(picture.caption)
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{data}"><figcaption>{caption}</figcaption></figure>'
    )

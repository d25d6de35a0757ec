# SPDX-License-Identifier: Apache-2.0
"""The looks of the page: one sheet of styles, and pieces of HTML with all text escaped."""

from collections.abc import Iterable
from html import escape

from seed_bringup.page.words import Headline

STYLE = """<style>
.seed-row {display: flex; justify-content: space-between; align-items: baseline; padding: 0.35em 0.85em 0 0.85em;
  font-size: 0.82em; color: #344054; gap: 0.8em}
.seed-row small {color: #667085} .seed-row b {font-variant-numeric: tabular-nums}
.seed-status {margin: 0.1em 0.7em 0.6em 0.7em; padding: 0.7em 0.9em; border-radius: 6px; border-left: 5px solid #98a2b3;
  background: #f5f6f8; color: #1d2939; font-size: 0.85em; line-height: 1.4; overflow-wrap: anywhere}
.seed-status h3 {margin: 0 0 0.15em 0; font-size: 1.25em; font-weight: 650} .seed-status p {margin: 0.25em 0 0 0}
.seed-status .todo {font-weight: 600}
.seed-good {border-color: #2e9e6b; background: #eef8f3} .seed-busy {border-color: #266ea4; background: #eef5fa}
.seed-warn {border-color: #d9912a; background: #fdf6ea} .seed-bad {border-color: #cc3b34; background: #fdefee}
.seed-table {width: calc(100% - 1.4em); margin: 0 0.7em 0.5em 0.7em; border-collapse: collapse; font-size: 0.82em}
.seed-table td {padding: 0.22em 0.15em; border-bottom: 1px solid #eef0f3; vertical-align: top; color: #344054}
.seed-table td:first-child {color: #667085; white-space: nowrap; padding-right: 0.9em}
.seed-table td:last-child {text-align: right; font-variant-numeric: tabular-nums; overflow-wrap: anywhere}
.seed-said {margin: 0 0.85em 0.5em 0.85em; font-size: 0.8em; line-height: 1.35; color: #475467}
.seed-said p {margin: 0.2em 0; overflow-wrap: anywhere} .seed-said .no {color: #b42318}
.seed-note {margin: 0.1em 0.85em 0.6em 0.85em; font-size: 0.76em; line-height: 1.35; color: #667085}
div:has(> button[id="@STOP@"]) {position: sticky; top: 0; z-index: 20; background: white; padding-top: 0.5em}
button[id="@STOP@"] {height: 3.4em; font-size: 1.05em; letter-spacing: 0.04em}
/* Stop is first to Tab to and cannot be folded away; fonts and drawing by software need no remark over the picture */
[data-dock-region-collapse="left"], [data-dock-region="left"] [data-dock-strip] button, #webgl-software-rendering {
  display: none !important}
[data-dock-region="left"] button[style*="gray-filled"] {background: #e9ecf0; color: #344054}
[data-dock-region="left"] button[style*="gray-filled"]:hover {background: #dde1e7}
button:focus-visible {outline: 3px solid #101828 !important; outline-offset: 2px}
</style>"""


def sheet(stop: str) -> str:
    """The styles; stop: id of the Stop button."""
    return STYLE.replace("@STOP@", escape(stop))


def status(found: Headline) -> str:
    """The state in words."""
    text = "".join(
        f'<p class="{kind}">{escape(words)}</p>' for kind, words in (("", found.text), ("todo", found.todo)) if words
    )
    return f'<div class="seed-status seed-{found.level}" role="status"><h3>{escape(found.word)}</h3>{text}</div>'


def table(rows: Iterable[tuple[str, str]]) -> str:
    """Names and values."""
    lines = "".join(f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in rows)
    return f'<table class="seed-table">{lines}</table>'


def said(lines: Iterable[tuple[bool, str]]) -> str:
    """What the cell answered, the newest first; True: it did what was asked."""
    words = "".join(f'<p class="{"yes" if good else "no"}">{escape(text)}</p>' for good, text in lines)
    return f'<div class="seed-said" role="log">{words}</div>'


def note(text: str) -> str:
    """A small remark."""
    return f'<div class="seed-note">{escape(text)}</div>'
